"""f, d and e from two or more focus settings, and whether they may be believed.

One e, and one curve of x over the focus, for every zoom as long as the data bear that;
else every zoom has its own e, or adds a shift to x, or both.

Two ways: every node for itself, or, where the target filled too little of the picture for
that, all nodes together as a lens on a helicoid (x a low polynomial of the focus steps,
centre linear in them, k1 constant).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np
from scipy.stats import chi2

from calibration.lens_table.lens_models import (
    IMPROBABLE,
    NOTHING,
    LensModel,
    ZoomFreedom,
    fitted,
    lowest_degree,
    needed_freedom,
    per_node,
    unshared,
)
from calibration.lens_table.nodes import NodeSet
from mvp.errors import CalibrationError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibration.estimate import Estimate, Fit
    from calibration.lens_table.nodes import LensNode
    from calibration.lens_table.optics_model import OpticsProblem
    from mvp.geometry import FloatArray

Way: TypeAlias = Literal["per-node", "global"]

_LEAST_FILL = 0.4
_NEAREST_SHARP = 1.5


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
        return self.probability < IMPROBABLE


@dataclass(frozen=True, eq=False)
class LensFit:
    """f of every zoom, x of every focus, d of every node, and e.

    Attributes:
        seen: the nodes.
        way: how they were combined.
        degree: of x in the focus steps (global), or None.
        f_mm: (z,); ``f_sigma_mm`` one standard deviation.
        x_mm: (k,), the extension d - f at the focus steps; with ``x_sigma_mm``. At the
            middle zoom where the zoom shifts it.
        d_mm: (n,), at the nodes; with ``d_sigma_mm``.
        sharp_sigma_mm: (n,), one standard deviation of the image distance of an object at
            the sharp distance less d, f, x and e together.
        e_mm: pupil offset, that of the middle zoom; with ``e_sigma_mm``, the largest.
        freedom: what the zoom changes beside f.
        e_of_zoom_mm: (z,), pupil offset at every zoom; with ``e_of_zoom_sigma_mm``.
        shift_mm: (z,), what every zoom adds to x; with ``shift_sigma_mm``.
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
    freedom: ZoomFreedom
    e_of_zoom_mm: FloatArray
    e_of_zoom_sigma_mm: FloatArray
    shift_mm: FloatArray
    shift_sigma_mm: FloatArray
    node_values: FloatArray
    tests: tuple[AssumptionTest, ...]
    estimate: Estimate

    @property
    def e_of_node_mm(self) -> FloatArray:
        """(n,): pupil offset at every node."""
        return np.asarray(self.e_of_zoom_mm[self.seen.zoom_of])

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
    freedom, base = needed_freedom(seen, e_prior_mm)
    degree, found, model = None, base, per_node(seen, e_prior_mm, freedom)
    if chosen == "global":
        degree, found, model = lowest_degree(seen, e_prior_mm, freedom)
    if found is None:
        raise CalibrationError(
            "the lens has more unknowns than were measured",
            hint="measure the sharp-focus distance at more focus settings",
        )
    wide = _Wide.of(seen, e_prior_mm)
    tests = (
        *wide.of_a_constant_lens(),
        *_tests_of_the_model(seen, e_prior_mm, freedom, (base, found), wide),
    )
    told = _described(seen, chosen, degree, model, found)
    told = replace(told, freedom=freedom, tests=tests)
    return _widened(told, model, found, wide)


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


def _described(
    seen: NodeSet,
    way: Way,
    degree: int | None,
    model: LensModel,
    found: Fit[FloatArray],
) -> LensFit:
    covariance, problem = found.estimate.covariance, model.problem
    d_rows, _ = problem.optics_rows(found.state)
    f, x, _ = problem.unknowns(found.state)
    x_block, e_block = (problem.block(covariance, of) for of in (1, 2))
    own_x, own_e = (problem.parameters(found.state, of) for of in (1, 2))
    e_sigma = _sigma(model.e, e_block)
    e_of_zoom = np.asarray(model.e @ own_e)
    return LensFit(
        seen,
        way,
        degree,
        problem.parameters(found.state, 0),
        np.sqrt(np.diag(problem.block(covariance, 0))),
        np.asarray(model.focus @ own_x),
        _sigma(model.focus, x_block),
        f + x,
        _sigma(d_rows, covariance),
        _sigma(problem.defocus_rows(found.state), covariance) * (f + x),
        float(e_of_zoom[len(e_of_zoom) // 2]),
        float(e_sigma.max()),
        NOTHING,
        e_of_zoom,
        e_sigma,
        np.asarray(model.shift @ own_x),
        _sigma(model.shift, x_block),
        problem.node_values(found.state),
        (),
        found.estimate,
    )


def _sigma(rows: FloatArray, covariance: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(np.einsum("ni,ij,nj->n", rows, covariance, rows)))


@dataclass(frozen=True, eq=False)
class _Wide:
    """What the widest models make of the nodes; None where the nodes are too few.

    Attributes:
        same: one e, x by focus.
        own_x: one e, x of every node.
        own_both: e of every zoom, x of every node; with its problem.
    """

    same: Fit[FloatArray] | None
    own_x: Fit[FloatArray] | None
    own_both: Fit[FloatArray] | None
    problem: OpticsProblem

    @classmethod
    def of(cls, seen: NodeSet, prior: tuple[float, float] | None) -> _Wide:
        problem = unshared(seen, prior, own_e=True)
        same = fitted(per_node(seen, prior).problem)
        if len(seen.zoom_steps) == 1 and len(seen) == len(seen.focus_steps):
            return cls(same, same, same, problem)
        own_x = fitted(unshared(seen, prior, own_e=False))
        return cls(same, own_x, fitted(problem), problem)

    def of_a_constant_lens(self) -> tuple[AssumptionTest, ...]:
        """Nested models, from the freest that the data determine to the constant one."""
        return (
            _against_noise(
                "constant-over-focus",
                "f and e are the same at every focus",
                self.own_both,
            ),
            _against(
                "one-pupil-offset",
                "e is the same at every zoom",
                self.own_x,
                self.own_both,
            ),
            _against(
                "parfocal", "x = d - f is the same at every zoom", self.same, self.own_x
            ),
        )


def _tests_of_the_model(
    seen: NodeSet,
    prior: tuple[float, float] | None,
    freedom: ZoomFreedom,
    fits: tuple[Fit[FloatArray] | None, Fit[FloatArray]],
    wide: _Wide,
) -> list[AssumptionTest]:
    """Of the model that is used: with every node for itself, and as fitted."""
    base, found = fits
    following = base
    if len(seen.measured("pupil_mm")[0]):
        model = per_node(seen, prior, freedom, pupil_follows=True)
        following = fitted(model.problem)
    tests = [
        _against("pupil-follows", "the pupil moves with d", following, base),
        _against(
            "one-table",
            "d - f is a curve over the focus and one shift for each zoom",
            base if freedom else None,
            wide.own_both,
        ),
    ]
    if found is not base:
        words = "x, centre and k1 follow the focus smoothly"
        tests.append(_against("smooth-focus", words, found, base))
    return tests


def _widened(
    told: LensFit, model: LensModel, found: Fit[FloatArray], wide: _Wide
) -> LensFit:
    """Sigmas that take in what a contradicted model gets wrong.

    The noise that is left over is in the covariance; by how much f, d and e differ from
    those of the widest model is not.
    """
    broken = ("one-table",) if told.freedom else ("one-pupil-offset", "parfocal")
    wrong = any(told.test(code).contradicted for code in broken)
    if not wrong or wide.own_both is None:
        return told
    seen, state = told.seen, wide.own_both.state
    f, x, e = wide.problem.unknowns(state)
    f_off = wide.problem.parameters(state, 0) - told.f_mm
    d_off, e_off = f + x - told.d_mm, e - told.e_of_node_mm
    x_off = np.abs(d_off - f_off[seen.zoom_of])
    near = x / (f**2 + x * (f - e))
    own_f, own_x, own_e = model.problem.unknowns(found.state)
    m = own_x / own_f
    defocus = m - (own_f + own_x - own_e * m) * near
    by_focus, by_zoom = (np.zeros(n) for n in (len(told.x_mm), len(told.f_mm)))
    np.maximum.at(by_focus, seen.focus_of, x_off)
    np.maximum.at(by_zoom, seen.zoom_of, np.abs(e_off))
    e_sigma = np.hypot(told.e_of_zoom_sigma_mm, by_zoom)
    return replace(
        told,
        f_sigma_mm=np.hypot(told.f_sigma_mm, f_off),
        x_sigma_mm=np.hypot(told.x_sigma_mm, by_focus),
        d_sigma_mm=np.hypot(told.d_sigma_mm, d_off),
        sharp_sigma_mm=np.hypot(told.sharp_sigma_mm, defocus * told.d_mm),
        e_sigma_mm=float(e_sigma.max()),
        e_of_zoom_sigma_mm=e_sigma,
    )


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
