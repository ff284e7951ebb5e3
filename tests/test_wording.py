"""Numbers are written with at most four digits before the unit, and counts agree with their nouns."""

from __future__ import annotations

import pytest

from isosample.wording import byte_size, counted, duration, percentage, probably_meant, thousands


@pytest.mark.parametrize(
    ("size", "written"),
    [
        (0, "0 bytes"),
        (1, "1 byte"),
        (1023, "1023 bytes"),
        (1024, "1.0 KiB"),
        (1536, "1.5 KiB"),
        (1024 * 1024 - 1, "1.0 MiB"),  # not "1024.0 KiB"
        (5 << 20, "5.0 MiB"),
        (3 << 30, "3.0 GiB"),
        (2 << 40, "2.0 TiB"),
        (5000 << 40, "5000.0 TiB"),  # no larger unit
    ],
)
def test_bytes_are_written_in_the_largest_unit_that_leaves_one(size: int, written: str) -> None:
    assert byte_size(size) == written


def test_counts_have_groups_of_three_digits() -> None:
    assert [thousands(number) for number in (0, 999, 1000, 1234567)] == ["0", "999", "1 000", "1 234 567"]


def test_one_of_a_thing_is_no_plural() -> None:
    assert [counted(number, "cache") for number in (0, 1, 2, 1000)] == [
        "0 caches",
        "1 cache",
        "2 caches",
        "1 000 caches",
    ]


def test_shares_are_never_rounded_to_nothing() -> None:
    shares = (0.0, 1.6e-5, 0.001, 0.0082, 0.25, 0.994, 0.996, 1.0)
    written = ["0 %", "0.0016 %", "0.1 %", "0.82 %", "25 %", "99 %", "100 %", "100 %"]
    assert [percentage(share) for share in shares] == written


def test_durations_are_in_the_unit_that_people_use() -> None:
    spans = (0.0, 0.034, 3.14, 47.0, 89.9, 90.0, 97.0, 240.0, 5390.0, 5400.0, 9000.0, 1e6)
    written = [
        "0 s",
        "0.034 s",
        "3.1 s",
        "47 s",
        "90 s",
        "1.5 min",
        "1.6 min",
        "4 min",
        "90 min",
        "1.5 h",
        "2.5 h",
    ]
    assert [duration(span) for span in spans] == [*written, "280 h"]


OPTIONS = ["--shading", "--shape", "--size", "--step", "--elevation", "--table-size", "--table-dtype"]


@pytest.mark.parametrize(
    ("written", "meant"),
    [
        ("--shade", "--shading"),  # five letters of it, though --shape is one letter away
        ("--shap", "--shape"),
        ("--sise", "--size"),
        ("--elev", "--elevation"),
        ("--e", "--elevation"),
        ("--table", "--table-size"),  # both begin so: the more similar one
        ("--wavelength", None),
    ],
)
def test_the_word_that_begins_alike_was_probably_meant(written: str, meant: str | None) -> None:
    assert probably_meant(written, OPTIONS) == meant
