"""What a comparison of two calibrations says: differences, sigmas, words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np
from scipy.stats import chi2, norm

if TYPE_CHECKING:
    from mvp.calibrated import Provenance
    from mvp.geometry import FloatArray

Kind: TypeAlias = Literal["camera", "lens", "hand-eye", "part"]

ALARM_SIGMAS = 3.0
_RANK_SHARE = 1e-12


@dataclass(frozen=True)
class Difference:
    """One quantity, new less previous.

    Attributes:
        name: what differs, and where.
        change: in ``unit``.
        sigma: one standard deviation of the change if nothing changed; None where one of
            the results does not say how good it is.
        unit: of both.
    """

    name: str
    change: float
    sigma: float | None
    unit: str

    @property
    def sigmas(self) -> float | None:
        """Size of the change by its standard deviation."""
        if self.sigma is None:
            return None
        return abs(self.change) / self.sigma if self.sigma > 0 else float("inf")


@dataclass(frozen=True)
class Comparison:
    """Two results of one kind.

    Attributes:
        kind: of both.
        previous_date: ISO 8601.
        date: of the new one.
        differences: the one that matters most first; empty when nothing can be compared.
        sigmas: of all differences together: the number of standard deviations of one
            normal number that is as improbable; None where it is not known.
        remarks: what makes the comparison doubtful or impossible.
        words: one or two sentences.
    """

    kind: Kind
    previous_date: str
    date: str
    differences: tuple[Difference, ...]
    sigmas: float | None
    remarks: tuple[str, ...]
    words: str

    @property
    def alarm(self) -> bool:
        """The change is too large for chance."""
        return self.sigmas is not None and self.sigmas > ALARM_SIGMAS


def compared(
    kind: Kind,
    before: Provenance,
    now: Provenance,
    found: tuple[Difference, ...],
    sigmas: float | None,
    remarks: tuple[str, ...],
) -> Comparison:
    """What two results of one kind say of each other; the main difference first."""
    if before.origin == "nominal":
        remarks = (*remarks, "the previous values were nominal, not measured")
    words = _words(kind, found[0], sigmas, before)
    return Comparison(kind, before.date, now.date, found, sigmas, remarks, words)


def _words(
    kind: Kind, first: Difference, sigmas: float | None, before: Provenance
) -> str:
    size = (
        f"{first.name[0].upper()}{first.name[1:]}: {abs(first.change):.3g} {first.unit}"
    )
    if sigmas is None:
        return (
            f"{size}. One of the two results does not say how good it is, so nobody can "
            "tell whether this is chance."
        )
    if sigmas <= ALARM_SIGMAS:
        return (
            f"{size}. All changes together are as usual as {sigmas:.1f} standard "
            "deviations of one number: the two results agree."
        )
    if before.origin == "nominal":
        end = (
            "the device is not what its data sheet or an imported file says; use the "
            "measured values."
        )
    elif kind == "part":
        end = f"the part stands elsewhere than on {before.date}."
    else:
        end = (
            f"something has changed since {before.date}. Find out what (a blow, a loose "
            "screw, another lens setting, temperature) before relying on either."
        )
    many = f"{sigmas:.1f}" if sigmas < 100 else "more than 100"
    return (
        f"{size}. All changes together are as unusual as {many} standard deviations of one "
        f"number: {end}"
    )


def incomparable(
    kind: Kind, before: Provenance, now: Provenance, why: tuple[str, ...]
) -> Comparison:
    """Why two results have nothing to say of each other."""
    words = f"Not to be compared with the result of {before.date}: {'; '.join(why)}."
    return Comparison(kind, before.date, now.date, (), None, why, words)


def other_device(before: Provenance, now: Provenance) -> tuple[str, ...]:
    """A result measured on another device; nominal ones belong to none."""
    if before.device_serial == now.device_serial or before.origin == "nominal":
        return ()
    return (f"it belongs to device {before.device_serial}, not {now.device_serial}",)


def equivalent_sigmas(change: FloatArray, spread: FloatArray) -> float:
    """Sigmas of one normal number as improbable as this change of several numbers."""
    scale = np.sqrt(np.diag(spread))
    free = scale > 0
    if not free.any():
        return float("inf") if change.any() else 0.0
    scaled = change[free] / scale[free]
    values, vectors = np.linalg.eigh(
        spread[np.ix_(free, free)] / np.outer(*[scale[free]] * 2)
    )
    known = values > _RANK_SHARE * values[-1]
    square = float((((vectors.T @ scaled)[known]) ** 2 / values[known]).sum())
    log_probability = float(chi2.logsf(square, int(known.sum())))
    if log_probability < -700:
        return float(np.sqrt(square))
    return float(norm.isf(np.exp(log_probability) / 2))


def length_along(
    name: str,
    change: FloatArray,
    jacobian: FloatArray,
    spread: FloatArray | None,
    unit: str,
) -> Difference:
    """Length of a change, and its standard deviation in that direction."""
    length = float(np.linalg.norm(change))
    if spread is None:
        return Difference(name, length, None, unit)
    own = jacobian @ spread @ jacobian.T
    if length == 0:
        return Difference(name, 0.0, float(np.sqrt(np.linalg.eigvalsh(own)[-1])), unit)
    direction = change / length
    return Difference(name, length, float(np.sqrt(direction @ own @ direction)), unit)


def both_sigmas(before: float, now: float) -> float | None:
    """Of a difference; None where one of the two is not stated."""
    return float(np.hypot(before, now)) if before > 0 and now > 0 else None
