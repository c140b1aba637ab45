"""Numbers as people read them: as many digits as their uncertainty allows."""

from __future__ import annotations

import math

_PLAIN_DIGITS = 4
_MOST_DECIMALS = 12


def value_text(value: float, sigma: float | None) -> str:
    """The value, rounded to the second digit of its sigma.

    Args:
        value: any number.
        sigma: one standard deviation; None or 0: not known, four digits are given.
    """
    if not math.isfinite(value):
        return "infinite" if math.isinf(value) else "not known"
    if not sigma or not math.isfinite(sigma):
        return f"{value:.{_PLAIN_DIGITS}g}"
    return f"{value:z.{decimals(sigma)}f}"


def sigma_text(sigma: float | None) -> str:
    """Two digits; a dash where it is not known."""
    if sigma is None or not math.isfinite(sigma):
        return "–"
    return f"{sigma:.{decimals(sigma)}f}" if sigma else "0"


def decimals(sigma: float) -> int:
    """Digits behind the point, so that two digits of sigma show."""
    if sigma <= 0:
        return _PLAIN_DIGITS
    first = math.floor(math.log10(sigma))
    return min(max(1 - first, 0), _MOST_DECIMALS)
