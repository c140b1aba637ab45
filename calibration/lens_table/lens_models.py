"""Models of a lens on its motors, and which of them the nodes ask for.

x = d - f follows the focus; the zoom may add a shift to it, and have a pupil offset of its
own. The simplest model is taken that no wider one improves beyond chance.
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
    from calibration.lens_table.nodes import NodeSet
    from mvp.geometry import FloatArray

    Prior = tuple[float, float] | None

IMPROBABLE = 1e-3
_HIGHEST_DEGREE = 4
_LEAST_SETTINGS = 2


@dataclass(frozen=True)
class ZoomFreedom:
    """What the zoom changes beside f.

    Attributes:
        own_e: every zoom has its pupil offset.
        shifted: every zoom adds a shift to x.
    """

    own_e: bool = False
    shifted: bool = False

    def __bool__(self) -> bool:
        return self.own_e or self.shifted


NOTHING = ZoomFreedom()
_EVERY = (NOTHING, ZoomFreedom(True), ZoomFreedom(False, True), ZoomFreedom(True, True))


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
    """The simplest model that no wider one improves beyond chance, and its fit."""
    tried = {f: fitted(per_node(seen, prior, f).problem) for f in _able(seen)}
    fits = {f: found for f, found in tried.items() if found is not None}
    if NOTHING not in fits:
        return NOTHING, None
    kept = [f for f in fits if not any(_worse(fits[f], g) for g in fits.values())]
    chosen = min(kept, key=lambda f: (f.own_e + f.shifted, fits[f].estimate.chi_square))
    return chosen, fits[chosen]


def _worse(narrow: Fit[FloatArray], wide: Fit[FloatArray]) -> bool:
    """Beyond chance, with the noise that the wider one leaves."""
    own, other = narrow.estimate, wide.estimate
    freedom = own.degrees_of_freedom - other.degrees_of_freedom
    if freedom <= 0:
        return False
    gain = (own.chi_square - other.chi_square) / max(other.variance_factor, 1.0)
    return float(chi2.sf(max(gain, 0.0), freedom)) < IMPROBABLE


def _able(seen: NodeSet) -> list[ZoomFreedom]:
    """Those that the nodes can determine; the widest last."""
    if len(seen.zoom_steps) == 1:
        return [NOTHING]
    sharp = seen.zoom_of[seen.measured("sharp_mm")[0]]
    settings = np.bincount(sharp, minlength=len(seen.zoom_steps)).min()
    basis = np.hstack([same_for(seen.focus_of), _zooms(seen)[seen.zoom_of]])
    linked = np.linalg.matrix_rank(basis) == basis.shape[1]
    return [
        f
        for f in _EVERY
        if (linked or not f.shifted)
        and (settings >= _LEAST_SETTINGS or not (f.own_e and f.shifted))
    ]


def _zooms(seen: NodeSet) -> FloatArray:
    """(z, z - 1): the shift of every zoom from the middle one's, which has none."""
    zooms = np.eye(len(seen.zoom_steps))
    return np.asarray(np.delete(zooms, len(zooms) // 2, axis=1))


def _model(
    seen: NodeSet,
    prior: Prior,
    freedom: ZoomFreedom,
    along: FloatArray,
    rest: tuple[FloatArray, FloatArray, FloatArray],
    follows: bool,
) -> LensModel:
    zooms = len(seen.zoom_steps)
    shifts = _zooms(seen) if freedom.shifted else np.zeros((zooms, 0))
    e = np.eye(zooms) if freedom.own_e else np.ones((zooms, 1))
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
