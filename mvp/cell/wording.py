"""Figures the way people say them, the same on the terminal and in the report."""

from __future__ import annotations

from mvp.planning.chance import DRAWS


def chance_text(probability: float) -> str:
    """A probability from draws; when none failed it is a bound (rule of three)."""
    if probability > 0:
        return f"{100 * probability:.2g} %"
    return f"below {100 * 3 / DRAWS:.2g} %"


def error_text(key: str) -> str:
    """``position_1_mm`` in words: 1 mm of position."""
    name, _, amount = key.partition("_")
    return f"{amount.replace('_', ' ')} of {name}" if amount else name
