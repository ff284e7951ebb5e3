"""Renewing the page of results replaces what programs write, and loses nothing else."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
if not (ROOT / "benchmarks").is_dir():
    pytest.skip("the benchmarks are not here", allow_module_level=True)
sys.path.insert(0, str(ROOT))
from benchmarks.results_page import NOTES, sections, with_head, with_section  # noqa: E402

PAGE = f"""# Results

What it is.

## First, 256²

old first

{NOTES}

noted first

## Rays

### Times, 512²

old times

{NOTES}

noted times

### By hand

{NOTES}

all of it noted

### Gone

old

### Errors

old errors

## Large with 256³ samples: uint8

old 256

## Large with 1024³ samples: uint8

old 1024
"""


def headings(page: str) -> list[str]:
    return re.findall(r"^#{1,3} .*$", page, flags=re.MULTILINE)


def test_a_section_is_replaced_up_to_its_notes() -> None:
    page = with_section(PAGE, "## First, 512²\n\nnew first\n")
    assert page == PAGE.replace("First, 256²", "First, 512²").replace("old first", "new first")


def test_parts_keep_their_notes_and_those_that_no_program_writes_their_place() -> None:
    page = with_section(
        PAGE, "## Rays\n\n### Times, 1024²\n\nnew times\n\n### Errors\n\nnew errors\n\n### More\n\nmore\n"
    )
    expected = PAGE.replace("Times, 512²", "Times, 1024²").replace("old times", "new times")
    expected = expected.replace("### Gone\n\nold\n\n", "").replace(
        "old errors\n", "new errors\n\n### More\n\nmore\n"
    )
    assert page == expected


def test_sections_that_differ_before_the_colon_are_two() -> None:
    page = with_section(PAGE, "## Large with 256³ samples: uint16\n\nnew 256\n")
    assert page == PAGE.replace("256³ samples: uint8", "256³ samples: uint16").replace("old 256", "new 256")


def test_a_new_section_comes_last() -> None:
    assert with_section(PAGE, "## New\n\ntext\n") == f"{PAGE}\n## New\n\ntext\n"


def test_another_head_changes_nothing_else() -> None:
    page = with_head(PAGE, "# Results\n\nWhat it is now.\n")
    assert page == PAGE.replace("What it is.", "What it is now.")


def test_every_section_of_a_report_says_what_it_was_measured_on() -> None:
    report = "## One\n\ntable\n\n### Part\n\ntable\n\n## Two\n\ntable\n"
    found = sections(report, "a machine\n")
    assert [part.partition("\n\ntable")[0] for part in found] == [
        "## One\n\na machine",
        "## Two\n\na machine",
    ]
    assert headings("".join(found)) == ["## One", "### Part", "## Two"]


def test_renewing_the_page_of_this_checkout_by_empty_sections_keeps_all_notes() -> None:
    page = (ROOT / "benchmarks" / "RESULTS.md").read_text(encoding="utf-8")
    notes = [part.partition(NOTES)[2].strip() for part in re.split(r"^(?=#{1,3} )", page, flags=re.MULTILINE)]
    renewed = page
    for heading in headings(page):
        if heading.startswith("## "):
            renewed = with_section(renewed, f"{heading}\n\nrenewed\n")
    assert any(notes)
    assert all(note in renewed for note in notes)
    assert [one for one in headings(renewed) if one[:3] == "## "] == [
        one for one in headings(page) if one[:3] == "## "
    ]
