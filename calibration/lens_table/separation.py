"""f, d and e from two or more focus settings, and whether they may be believed.

Two ways: every node for itself, or, where the target filled too little of the picture for
that, all nodes together as a lens on a helicoid (x a low polynomial of the focus steps,
centre linear in them, k1 constant).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np
from scipy.stats import chi2

from calibration.estimate import Estimate, Fit, fit
from calibration.lens_table.nodes import NodeSet
from calibration.lens_table.optics_model import (
    Bases,
    OpticsProblem,
    each_zoom,
    polynomial,
    same_for,
    start_state,
)
from mvp.errors import CalibrationError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibration.lens_table.nodes import LensNode
    from mvp.geometry import FloatArray

Way: TypeAlias = Literal["per-node", "global"]

_LEAST_FILL = 0.4
_NEAREST_SHARP = 1.5
_IMPROBABLE = 1e-3
_HIGHEST_DEGREE = 4


@dataclass(frozen=True)
class AssumptionTest:
    """Whether the data contradict something that the table takes for granted.

    Attributes:
        code: stable name for programs.
        assumption: in words.
        chi_square: by how much it worsens the fit.
        degrees_of_freedom: of that; 0 when the data cannot test it.
        probability: of at least that much, if it holds; 1 when it is not tested.
    """

    code: str
    assumption: str
    chi_square: float
    degrees_of_freedom: int
    probability: float

    @property
    def tested(self) -> bool:
        """The data had a say."""
        return self.degrees_of_freedom > 0

    @property
    def contradicted(self) -> bool:
        """Less probable than 0.1 %."""
        return self.probability < _IMPROBABLE


@dataclass(frozen=True, eq=False)
class LensFit:
    """f of every zoom, x of every focus, d of every node, and e.

    Attributes:
        seen: the nodes.
        way: how they were combined.
        degree: of x in the focus steps (global), or None.
        f_mm: (z,); ``f_sigma_mm`` one standard deviation.
        x_mm: (k,), the extension d - f at the focus steps; with ``x_sigma_mm``.
        d_mm: (n,), at the nodes; with ``d_sigma_mm``.
        sharp_sigma_mm: (n,), one standard deviation of the image distance of an object at
            the sharp distance less d, f, x and e together.
        e_mm: pupil offset; with ``e_sigma_mm``.
        node_values: (n, 4) of ``NODE_NAMES`` as fitted.
        tests: of what was taken for granted.
        estimate: covariance, condition, weakest direction, chi-square of the fit.
    """

    seen: NodeSet
    way: Way
    degree: int | None
    f_mm: FloatArray
    f_sigma_mm: FloatArray
    x_mm: FloatArray
    x_sigma_mm: FloatArray
    d_mm: FloatArray
    d_sigma_mm: FloatArray
    sharp_sigma_mm: FloatArray
    e_mm: float
    e_sigma_mm: float
    node_values: FloatArray
    tests: tuple[AssumptionTest, ...]
    estimate: Estimate

    def test(self, code: str) -> AssumptionTest:
        """The test of that code."""
        return next(test for test in self.tests if test.code == code)


def separate(
    nodes: Sequence[LensNode],
    *,
    way: Way | None = None,
    e_prior_mm: tuple[float, float] | None = None,
) -> LensFit:
    """Separate f, d and e.

    Args:
        nodes: at one or more zooms; two or more focus settings.
        way: None takes "global" when any target filled less than 40 % of the picture.
        e_prior_mm: mean and one standard deviation known beforehand (a datasheet).

    Raises:
        CalibrationError: the data cannot separate them.
    """
    seen = NodeSet.of(nodes)
    _check(seen, e_prior_mm)
    chosen: Way = way or ("global" if (seen.fill < _LEAST_FILL).any() else "per-node")
    degree, found, problem = None, None, _per_node(seen, e_prior_mm)
    if chosen == "global":
        degree, found, problem = _lowest_degree(seen, e_prior_mm)
    found = found or fit(problem, start_state(problem))
    return _described(seen, chosen, degree, problem, found)


def _check(seen: NodeSet, e_prior_mm: tuple[float, float] | None) -> None:
    settings = np.bincount(seen.zoom_of)
    if settings.max() < 2 and e_prior_mm is None:
        raise CalibrationError(
            "one focus setting cannot tell f, d and the pupil offset apart",
            hint="calibrate at least two focus settings, far apart, at one zoom",
        )
    rows, _, _ = seen.measured("sharp_mm")
    missing = sorted(set(range(len(seen.zoom_steps))) - set(seen.zoom_of[rows]))
    if missing:
        steps = ", ".join(str(seen.zoom_steps[zoom]) for zoom in missing)
        raise CalibrationError(
            f"no sharp-focus distance was measured at zoom {steps}",
            hint="sweep the distance or the focus for best contrast at each zoom",
        )
    _check_units(seen)
    unknowns = len(seen.zoom_steps) + len(seen.focus_steps) + 1
    facts = len(seen) + len(rows) + (e_prior_mm is not None)
    if facts < unknowns:
        raise CalibrationError(
            f"{unknowns} unknowns of the lens from {facts} measurements",
            hint="measure the sharp-focus distance at more focus settings",
        )


def _check_units(seen: NodeSet) -> None:
    """A sharp place is never as near as the sensor."""
    rows, sharp, _ = seen.measured("sharp_mm")
    f_cal = seen.values[rows, 0]
    wrong = sharp < _NEAREST_SHARP * f_cal
    if wrong.any():
        node, index = seen.nodes[rows[wrong][0]], int(np.flatnonzero(wrong)[0])
        raise CalibrationError(
            f"at zoom {node.zoom}, focus {node.focus} the sharp distance is "
            f"{sharp[index]:.4g} mm and the principal distance {f_cal[index]:.4g} mm: "
            "one of them is in another unit",
            hint="give sharp distances and the pixel pitch in millimetres",
        )


def _per_node(
    seen: NodeSet,
    e_prior_mm: tuple[float, float] | None,
    *,
    own_x: bool = False,
    own_e: bool = False,
    pupil_follows: bool = False,
) -> OpticsProblem:
    """Every node has its own centre and k1; x and e are shared or not."""
    own, one = np.eye(len(seen)), np.ones((len(seen), 1))
    x = own if own_x else same_for(seen.focus_of)
    e = same_for(seen.zoom_of) if own_e else one
    return OpticsProblem(seen, Bases(x, e, own, own, own), e_prior_mm, pupil_follows)


def _global(
    seen: NodeSet, e_prior_mm: tuple[float, float] | None, degree: int
) -> OpticsProblem:
    steps = seen.focus_steps[seen.focus_of]
    one = np.ones((len(seen), 1))
    highest = int(np.bincount(seen.zoom_of).min() > 1)
    line = each_zoom(seen.zoom_of, polynomial(steps, highest))
    bases = Bases(
        polynomial(steps, degree), one, line, line, each_zoom(seen.zoom_of, one)
    )
    return OpticsProblem(seen, bases, e_prior_mm)


def _lowest_degree(
    seen: NodeSet, e_prior_mm: tuple[float, float] | None
) -> tuple[int, Fit[FloatArray], OpticsProblem]:
    """The lowest degree that the next one does not improve beyond chance."""
    highest = min(_HIGHEST_DEGREE, len(seen.focus_steps) - 1)
    problem = _global(seen, e_prior_mm, 1)
    found = fit(problem, start_state(problem))
    for degree in range(2, highest + 1):
        richer = _global(seen, e_prior_mm, degree)
        better = fit(richer, start_state(richer))
        gain = found.estimate.chi_square - better.estimate.chi_square
        if chi2.sf(gain, 1) >= _IMPROBABLE:
            return degree - 1, found, problem
        problem, found = richer, better
    return highest, found, problem


def _described(
    seen: NodeSet,
    way: Way,
    degree: int | None,
    problem: OpticsProblem,
    found: Fit[FloatArray],
) -> LensFit:
    covariance = found.estimate.covariance
    d_rows, x_rows = problem.optics_rows(found.state)
    f, x, e = problem.unknowns(found.state)
    first = np.unique(seen.focus_of, return_index=True)[1]
    e_block = problem.block(covariance, 2)
    return LensFit(
        seen,
        way,
        degree,
        problem.parameters(found.state, 0),
        np.sqrt(np.diag(problem.block(covariance, 0))),
        x[first],
        _sigma(x_rows[first], covariance),
        f + x,
        _sigma(d_rows, covariance),
        _sigma(problem.defocus_rows(found.state), covariance) * (f + x),
        float(e[0]),
        float(np.sqrt(e_block[0, 0])),
        problem.node_values(found.state),
        _tests(seen, problem, found),
        found.estimate,
    )


def _sigma(rows: FloatArray, covariance: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(np.einsum("ni,ij,nj->n", rows, covariance, rows)))


def _tests(
    seen: NodeSet, problem: OpticsProblem, found: Fit[FloatArray]
) -> tuple[AssumptionTest, ...]:
    """Nested models, from the freest that the data determine to the one that is used."""
    prior = problem.e_prior_mm
    shared = found if problem.bases.x.shape[1] == len(seen.focus_steps) else None
    same = _fitted(_per_node(seen, prior), shared)
    one_zoom = same if len(seen.zoom_steps) == 1 else None
    own_x = _fitted(_per_node(seen, prior, own_x=True), one_zoom)
    own_both = _fitted(_per_node(seen, prior, own_x=True, own_e=True), one_zoom)
    unseen = same if not len(seen.measured("pupil_mm")[0]) else None
    following = _fitted(_per_node(seen, prior, pupil_follows=True), unseen)
    tests = [
        _against_noise(
            "constant-over-focus", "f and e are the same at every focus", own_both
        ),
        _against("one-pupil-offset", "e is the same at every zoom", own_x, own_both),
        _against("parfocal", "x = d - f is the same at every zoom", same, own_x),
        _against("pupil-follows", "the pupil moves with d", following, same),
    ]
    if found is not shared:
        words = "x, centre and k1 follow the focus smoothly"
        tests.append(_against("smooth-focus", words, found, same))
    return tuple(tests)


def _fitted(
    problem: OpticsProblem, known: Fit[FloatArray] | None = None
) -> Fit[FloatArray] | None:
    """The fit, or None where there are more unknowns than measurements."""
    if known is not None:
        return known
    start = start_state(problem)
    if problem.residuals(start).size < len(problem.names):
        return None
    return fit(problem, start)


def _against(
    code: str,
    assumption: str,
    narrow: Fit[FloatArray] | None,
    wide: Fit[FloatArray] | None,
) -> AssumptionTest:
    """By how much a narrower model fits worse than a wider one."""
    if narrow is None or wide is None:
        return _judged(code, assumption, 0.0, 0)
    gain = narrow.estimate.chi_square - wide.estimate.chi_square
    freedom = narrow.estimate.degrees_of_freedom - wide.estimate.degrees_of_freedom
    return _judged(code, assumption, gain, freedom)


def _against_noise(
    code: str, assumption: str, found: Fit[FloatArray] | None
) -> AssumptionTest:
    """Whether what is left over is as small as the stated noise."""
    if found is None:
        return _judged(code, assumption, 0.0, 0)
    how = found.estimate
    return _judged(code, assumption, how.chi_square, how.degrees_of_freedom)


def _judged(
    code: str, assumption: str, chi_square: float, freedom: int
) -> AssumptionTest:
    if freedom <= 0:
        return AssumptionTest(code, assumption, 0.0, 0, 1.0)
    worse = max(chi_square, 0.0)
    return AssumptionTest(
        code, assumption, worse, freedom, float(chi2.sf(worse, freedom))
    )
