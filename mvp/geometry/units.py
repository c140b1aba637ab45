"""Units of length in CAD files, and what a size says about them."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Literal, TypeAlias

if TYPE_CHECKING:
    from mvp.geometry.box import Box

Units: TypeAlias = Literal["mm", "in", "m"]
UnitsSource: TypeAlias = Literal["given", "file", "guessed"]

MM_PER: dict[Units, float] = {"mm": 1.0, "in": 25.4, "m": 1000.0}

# Outside this range a part does not fit in front of a camera on an arm.
_SMALL_MM, _LARGE_MM = 5.0, 3000.0
_NOTE = re.compile(
    rb"units?\s*[:=]?\s*\b(millimet(?:er|re)s?|mm|inch(?:es)?|in|met(?:er|re)s?|m)\b",
    re.IGNORECASE,
)
_STEP_SI = re.compile(rb"SI_UNIT\s*\(\s*(\.\w+\.|\$)\s*,\s*\.METRE\.\s*\)")
_STEP_INCH = re.compile(rb"CONVERSION_BASED_UNIT\s*\(\s*'INCH'", re.IGNORECASE)


def noted_units(head: bytes) -> Units | None:
    """Units that a comment or header of a mesh file names, if any."""
    found = _NOTE.search(head)
    if found is None:
        return None
    word = found.group(1).lower()
    return "mm" if word.startswith(b"mil") or word == b"mm" else _inch_or_metre(word)


def _inch_or_metre(word: bytes) -> Units:
    return "in" if word.startswith(b"in") else "m"


def step_units(content: bytes) -> Units | None:
    """The length unit that a STEP file declares, None for one that is not in use here."""
    if _STEP_INCH.search(content):
        return "in"
    prefixes = {match.group(1) for match in _STEP_SI.finditer(content)}
    if b".MILLI." in prefixes:
        return "mm"
    return "m" if b"$" in prefixes else None


def size_text(bounds: Box) -> str:
    """The part's size in mm and inches, for a person to compare with the drawing."""
    mm = " x ".join(f"{value:.4g}" for value in bounds.size_mm)
    inch = " x ".join(f"{value / 25.4:.3g}" for value in bounds.size_mm)
    return f"{mm} mm ({inch} in)"


def size_warnings(bounds: Box, units: Units, source: UnitsSource) -> tuple[str, ...]:
    """What is suspicious about a size, as if units were off by 25.4 or 1000."""
    largest = float(bounds.size_mm.max())
    if _SMALL_MM <= largest <= _LARGE_MM:
        return ()
    other = [
        f"{largest * MM_PER[unit] / MM_PER[units]:.4g} mm if the file is in {unit}"
        for unit in MM_PER
        if unit != units
        and _SMALL_MM <= largest * MM_PER[unit] / MM_PER[units] <= _LARGE_MM
    ]
    how = "small" if largest < _SMALL_MM else "large"
    told = "; it would be " + ", or ".join(other) if other else ""
    return (
        f"the part is unusually {how}: {largest:.4g} mm with units {units} ({source})"
        f"{told}. Give the units if this is wrong.",
    )
