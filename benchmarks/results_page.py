"""The page of results: sections that programs renew, and notes in them that stay.

A section begins with `## `, a part of it with `### `. What stands in either after a line `NOTES` is kept when the
section is renewed; everything else is the program's, and replaced.
"""

from __future__ import annotations

import re

NOTES = "<!-- notes: no program writes what follows up to the next heading -->"


def with_section(page: str, section: str) -> str:
    """The page with a section in place of the one whose heading begins with the same words, or at the end.

    What follows a comma or a colon in a heading says how much was measured and may differ.
    """
    parts = _split(page, "## ")
    for place, part in enumerate(parts):
        if _name(part) == _name(section):
            parts[place] = _with_notes(section, part)
            return _joined(parts)
    return _joined([*parts, section])


def with_head(page: str, head: str) -> str:
    """The page with another text before its first section."""
    return _joined([head, *(part for part in _split(page, "## ") if part.startswith("## "))])


def sections(report: str, told: str) -> list[str]:
    """A report by its headings, each section with a line about machine and commit."""
    found = [part for part in _split(report, "## ") if part.startswith("## ")]
    return [part.replace("\n", f"\n\n{told}", 1) for part in found]


def _with_notes(section: str, old: str) -> str:
    """The section with the notes of the old one: each in its part, or under its heading where that is not renewed."""
    parts = _split(section, "#{2,3} ")
    place = 0
    for part in _split(old, "#{2,3} "):
        kept = "".join(part.partition(NOTES)[1:])
        here = next((number for number, one in enumerate(parts) if _name(one) == _name(part)), None)
        if here is not None:
            place = here
            parts[here] = _joined([parts[here], kept])
        elif kept:
            place += 1
            parts.insert(place, _joined([part.partition("\n")[0], kept]))
    return _joined(parts)


def _split(text: str, heading: str) -> list[str]:
    """A text before every heading."""
    return re.split(rf"^(?={heading})", text, flags=re.MULTILINE)


def _name(part: str) -> str:
    return re.split(r"[,:\n]", part, maxsplit=1)[0].strip()


def _joined(parts: list[str]) -> str:
    return "\n\n".join(part.strip() for part in parts if part.strip()) + "\n"
