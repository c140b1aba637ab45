"""Figures the way people say them, the same on the terminal and in the report."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from mvp.planning.chance import DRAWS

if TYPE_CHECKING:
    from mvp.planning.plan import ErrorSpread, KeptProbability

_CERTAIN = 1e-9


def chance_text(probability: float) -> str:
    """A probability from draws; when none failed it is a bound (rule of three)."""
    if probability > 0:
        return f"{100 * probability:.2g} %"
    return f"below {100 * 3 / DRAWS:.2g} %"


def error_text(key: str) -> str:
    """``position_1_mm`` in words: 1 mm of position."""
    name, _, amount = key.partition("_")
    return f"{amount.replace('_', ' ')} of {name}" if amount else name


def probability_lines(found: KeptProbability) -> list[str]:
    """In words: what is how probable, and which errors were reckoned with."""
    all_of_it = f"all of this holds with a probability of {kept_text(found.together)}"
    if 1 - found.together >= _CERTAIN:
        weakest = found.weakest.replace("_", " ")
        all_of_it += f"; {weakest} is the least sure"
    return [
        all_of_it,
        f"95 % of the time the camera is off by less than {spread_text(found.spread)}",
    ]


def spread_text(spread: ErrorSpread) -> str:
    """How far the camera may be off, and who says so."""
    named = ", ".join(spread.sources).replace("_", " ")
    source = f"calibrations: {named}" if named else "stated in [uncertainty]"
    return f"{spread.position_95_mm:.2g} mm, {spread.angle_95_deg:.2g} deg ({source})"


def kept_text(probability: float) -> str:
    """A probability in percent, with as many digits as what is missing to 1 needs."""
    missing = 1 - probability
    if missing < _CERTAIN:
        return "100 %"
    digits = max(0, -math.floor(math.log10(100 * missing)))
    return f"{100 * probability:.{digits}f} %"


def look_first(cause: str | None, check_first: str, declared_axes: str) -> str:
    """What to look at first; a picture cannot tell a wrong mark from a moved part.

    Args:
        cause: what the picture points to.
        check_first: what it is by itself.
        declared_axes: of the arm, of which only a person says where they are.
    """
    if cause != "misalignment" or not declared_axes:
        return check_first
    return (
        f"were the axes {declared_axes} at their marks when the controller was switched "
        f"on? nothing measures them, and every picture is off alike; {check_first}"
    )
