"""Checked kinds of values that the configuration files share."""

from __future__ import annotations

from typing import Annotated, TypeAlias

from pydantic import AfterValidator, Field

_LARGEST_MM = 1e7

Name: TypeAlias = Annotated[
    str, Field(min_length=1, max_length=80, pattern=r"^[^\x00-\x1f/\\]+$")
]
Millimetres: TypeAlias = Annotated[float, Field(ge=-_LARGEST_MM, le=_LARGEST_MM)]
Point: TypeAlias = tuple[Millimetres, Millimetres, Millimetres]
Positive: TypeAlias = Annotated[float, Field(gt=0)]
NotNegative: TypeAlias = Annotated[float, Field(ge=0)]


def _ordered(value: float | tuple[float, float]) -> float | tuple[float, float]:
    if isinstance(value, tuple) and value[0] > value[1]:
        raise ValueError(
            f"the lower bound {value[0]:g} is above the upper bound {value[1]:g}"
        )
    return value


FixedOrRange: TypeAlias = Annotated[
    Positive | tuple[Positive, Positive], AfterValidator(_ordered)
]


def bounds(value: float | tuple[float, float]) -> tuple[float, float]:
    """A fixed value as an interval of no width."""
    return value if isinstance(value, tuple) else (value, value)


def check_corners(low: Point, high: Point, what: str) -> None:
    """Refuse a box that is inside out.

    Raises:
        ValueError: a low corner above its high corner.
    """
    for axis, a, b in zip("xyz", low, high, strict=True):
        if a >= b:
            raise ValueError(
                f"{what}: low_mm must be below high_mm on every axis, "
                f"but on {axis} it is {a:g} against {b:g}"
            )
