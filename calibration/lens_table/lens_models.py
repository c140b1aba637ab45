"""Models of a lens on its motors, and which of them the nodes ask for.

x = d - f follows the focus; the zoom may add a shift to it, and change the pupil offset.
The simplest model is taken that no wider one improves beyond chance.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import chi2

from calibration.estimate import Fit, fit
from calibration.lens_table.optics_model import (
    Bases,
    OpticsProblem,
    each_zoom,
    polynomial,
    same_for,
    start_state,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from calibration.lens_table.nodes import NodeSet
    from mvp.geometry import FloatArray

    Prior = tuple[float, float] | None

IMPROBABLE = 1e-3
_UNLIKELY = 0.05
_LOW_DEGREES = (0, 1, 2)
_HIGHEST_DEGREE = 4
_LEAST_SETTINGS = 2


@dataclass(frozen=True)
class ZoomFreedom:
    """What the zoom changes beside f: degrees of polynomials over its steps.

    0 is no change; one less than there are zooms leaves every zoom to itself.

    Attributes:
        own_e: of the pupil offset.
        shifted: of the shift that is added to x.
    """

    own_e: int = 0
    shifted: int = 0

    def __bool__(self) -> bool:
        return self.own_e + self.shifted > 0


NOTHING = ZoomFreedom()


@dataclass(frozen=True, eq=False)
class LensModel:
    """A problem, and what its parameters of x and e are about.

    Attributes:
        problem: over all nodes.
        focus: (k, .) x of every focus step at the reference zoom.
        shift: (z, .) what every zoom adds to it.
        e: (z, .) pupil offset of every zoom.
    """

    problem: OpticsProblem
    focus: FloatArray
    shift: FloatArray
    e: FloatArray


def per_node(
    seen: NodeSet,
    prior: Prior,
    freedom: ZoomFreedom = NOTHING,
    *,
    pupil_follows: bool = False,
) -> LensModel:
    """Every node has its own centre and k1; x is shared by focus."""
    own = np.eye(len(seen))
    steps = np.eye(len(seen.focus_steps))
    return _model(seen, prior, freedom, steps, (own, own, own), pupil_follows)


def unshared(seen: NodeSet, prior: Prior, *, own_e: bool) -> OpticsProblem:
    """Every node has its own x, too."""
    own, one = np.eye(len(seen)), np.ones((len(seen), 1))
    e = same_for(seen.zoom_of) if own_e else one
    return OpticsProblem(seen, Bases(own, e, own, own, own), prior)


def together(
    seen: NodeSet, prior: Prior, freedom: ZoomFreedom, degree: int
) -> LensModel:
    """All nodes as a helicoid: x a polynomial, centre lines, k1 constant at a zoom."""
    steps = seen.focus_steps[seen.focus_of]
    highest = int(np.bincount(seen.zoom_of).min() > 1)
    line = each_zoom(seen.zoom_of, polynomial(steps, highest))
    k1 = each_zoom(seen.zoom_of, np.ones((len(seen), 1)))
    along = polynomial(seen.focus_steps, degree)
    return _model(seen, prior, freedom, along, (line, line, k1), follows=False)


def lowest_degree(
    seen: NodeSet, prior: Prior, freedom: ZoomFreedom
) -> tuple[int, Fit[FloatArray], LensModel]:
    """The lowest degree of x that the next one does not improve beyond chance."""
    highest = min(_HIGHEST_DEGREE, len(seen.focus_steps) - 1)
    model = together(seen, prior, freedom, 1)
    found = fit(model.problem, start_state(model.problem))
    for degree in range(2, highest + 1):
        richer = together(seen, prior, freedom, degree)
        better = fit(richer.problem, start_state(richer.problem))
        gain = found.estimate.chi_square - better.estimate.chi_square
        if chi2.sf(gain, 1) >= IMPROBABLE:
            return degree - 1, found, model
        model, found = richer, better
    return highest, found, model


def fitted(problem: OpticsProblem) -> Fit[FloatArray] | None:
    """The fit, or None where there are more unknowns than measurements."""
    start = start_state(problem)
    if problem.residuals(start).size < len(problem.names):
        return None
    return fit(problem, start)


def needed_freedom(
    seen: NodeSet, prior: Prior
) -> tuple[ZoomFreedom, Fit[FloatArray] | None]:
    """The simplest model that no wider one improves beyond chance, and its fit.

    First whether the zoom changes e, x or both; then by how low a degree. A node at the
    end of the zoom alone hardly tells e and x apart: a low degree does where it fits.
    """
    full = len(seen.zoom_steps) - 1
    slope = min(full, 1)
    corners = [(0, 0), (full, 0), (0, full), (slope, slope), (full, full)]
    fits = _fits(seen, prior, dict.fromkeys(ZoomFreedom(*c) for c in corners))
    if NOTHING not in fits:
        return NOTHING, None
    kept = [f for f in fits if not any(_worse(fits[f], g) for g in fits.values())]
    chosen = _simplest(kept, fits)
    if not chosen or prior is not None:
        return chosen, fits[chosen]
    low = [
        ZoomFreedom(e, x)
        for e in _LOW_DEGREES
        for x in _LOW_DEGREES
        if e <= chosen.own_e and x <= chosen.shifted and (e or x)
    ]
    fits |= _fits(seen, prior, dict.fromkeys(low))
    good = [f for f in low if f in fits]
    good = [f for f in good if not _worse(fits[f], fits[chosen], _UNLIKELY)]
    chosen = _simplest([*good, chosen], fits)
    return chosen, fits[chosen]


def _fits(
    seen: NodeSet, prior: Prior, wanted: Iterable[ZoomFreedom]
) -> dict[ZoomFreedom, Fit[FloatArray]]:
    """Of those that the nodes can determine."""
    tried = {
        f: fitted(per_node(seen, prior, f).problem) for f in wanted if able(seen, f)
    }
    return {f: found for f, found in tried.items() if found is not None}


def _simplest(
    kept: Sequence[ZoomFreedom], fits: Mapping[ZoomFreedom, Fit[FloatArray]]
) -> ZoomFreedom:
    return min(kept, key=lambda f: (f.own_e + f.shifted, fits[f].estimate.chi_square))


def _worse(
    narrow: Fit[FloatArray], wide: Fit[FloatArray], least: float = IMPROBABLE
) -> bool:
    """Beyond chance, with the noise that the wider one leaves."""
    own, other = narrow.estimate, wide.estimate
    freedom = own.degrees_of_freedom - other.degrees_of_freedom
    if freedom <= 0:
        return False
    gain = (own.chi_square - other.chi_square) / max(other.variance_factor, 1.0)
    return float(chi2.sf(max(gain, 0.0), freedom)) < least


def able(seen: NodeSet, freedom: ZoomFreedom) -> bool:
    """Whether the nodes can determine it."""
    full = len(seen.zoom_steps) - 1
    sharp = seen.zoom_of[seen.measured("sharp_mm")[0]]
    settings = np.bincount(sharp, minlength=full + 1).min()
    if freedom.own_e + freedom.shifted == 2 * full > 0 and settings < _LEAST_SETTINGS:
        return False
    shifts = _shifts(seen, freedom.shifted)[seen.zoom_of]
    basis = np.hstack([same_for(seen.focus_of), shifts])
    return bool(np.linalg.matrix_rank(basis) == basis.shape[1])


def _shifts(seen: NodeSet, degree: int) -> FloatArray:
    """(z, degree): the shift of every zoom from the middle one's, which has none."""
    count = len(seen.zoom_steps)
    if degree == count - 1:
        return np.asarray(np.delete(np.eye(count), count // 2, axis=1))
    powers = polynomial(seen.zoom_steps, degree)[:, 1:]
    return np.asarray(powers - powers[count // 2])


def _offsets(seen: NodeSet, degree: int) -> FloatArray:
    """(z, degree + 1): the pupil offset of every zoom."""
    if degree == len(seen.zoom_steps) - 1:
        return np.eye(degree + 1)
    return polynomial(seen.zoom_steps, degree)


def _model(
    seen: NodeSet,
    prior: Prior,
    freedom: ZoomFreedom,
    along: FloatArray,
    rest: tuple[FloatArray, FloatArray, FloatArray],
    follows: bool,
) -> LensModel:
    zooms = len(seen.zoom_steps)
    shifts, e = _shifts(seen, freedom.shifted), _offsets(seen, freedom.own_e)
    x = np.hstack([along[seen.focus_of], shifts[seen.zoom_of]])
    problem = OpticsProblem(
        seen, Bases(x, e[seen.zoom_of], *rest), prior, pupil_follows=follows
    )
    return LensModel(
        problem,
        np.hstack([along, np.zeros((len(along), shifts.shape[1]))]),
        np.hstack([np.zeros((zooms, along.shape[1])), shifts]),
        e,
    )
