"""Numbers as people read them, in messages, tables and reports, and words that were mistyped."""

from __future__ import annotations

import difflib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Collection

BYTE_UNITS = ("KiB", "MiB", "GiB", "TiB")
SIMILAR = 5  # words that are looked at for the one that was meant


def thousands(number: int) -> str:
    """Return a count in groups of three digits: 1 234 567."""
    return f"{number:,}".replace(",", " ")


def byte_size(size: int) -> str:
    """Return a number of bytes, >= 0, in the largest binary unit that leaves at least 1 as it is written."""
    if size < 1024:
        return "1 byte" if size == 1 else f"{size} bytes"
    amount = float(size)
    for unit in BYTE_UNITS:
        amount /= 1024
        if round(amount, 1) < 1024 or unit == BYTE_UNITS[-1]:
            break
    return f"{amount:.1f} {unit}"


def counted(number: int, noun: str) -> str:
    """Return a count with its noun, which takes an s unless there is one of it: 1 cache, 2 caches."""
    return f"{thousands(number)} {noun}{'' if number == 1 else 's'}"


def fraction_text(number: float) -> str:
    """A number, as 1/n where it is one: 0.25 is 1/4."""
    inverse = round(1.0 / number) if 0.0 < number < 1.0 else 0
    return f"1/{inverse}" if inverse > 1 and abs(number * inverse - 1.0) < 1e-9 else f"{number:g}"


def percentage(share: float) -> str:
    """A share of 0 to 1 in per cent with two digits, never rounded to nothing: 0.82 %, 0.0016 %, 100 %."""
    return f"{100 * share:.2g} %" if share < 0.995 else "100 %"


def duration(seconds: float) -> str:
    """An estimated duration with two digits, in the unit that people use for it: 0.6 s, 45 s, 4 min, 2.5 h."""
    length, unit = (1.0, "s") if seconds < 90.0 else (60.0, "min") if seconds < 5400.0 else (3600.0, "h")
    return f"{float(f'{seconds / length:.2g}'):g} {unit}"


def probably_meant(written: str, known: Collection[str]) -> str | None:
    """The only known word that begins so; else of similar ones that which begins alike the longest, or None."""
    begun = [word for word in known if word.startswith(written)]
    if len(begun) == 1:
        return begun[0]
    similar = difflib.get_close_matches(written, known, n=SIMILAR)  # the most similar first
    return max(similar, key=lambda word: _letters_alike(written, word), default=None)


def _letters_alike(one: str, other: str) -> int:
    """How many letters two words begin with alike."""
    longest = min(len(one), len(other))
    return next((i for i in range(longest) if one[i] != other[i]), longest)


def about_unknown_keys(unknown: Collection[str], known: Collection[str]) -> str:
    """What a file with unknown keys is told: ``has the unknown key 'colour'; did you mean 'color'? Known are …``."""
    near = [word for key in unknown if (word := probably_meant(key, known)) is not None]
    meant = f"did you mean {', '.join(map(repr, near))}? Known are" if near else "known are"
    keys = "the unknown key" if len(unknown) == 1 else "unknown keys"
    return f"has {keys} {', '.join(map(repr, unknown))}; {meant} {', '.join(sorted(known))}."
