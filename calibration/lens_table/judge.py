"""Whether a lens table may be used, and what to do when not."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibration.lens_table.zoom_curves import WORDS
from calibration.verdict import Cause, Limit, Verdict, judged

if TYPE_CHECKING:
    from collections.abc import Iterator

    from calibration.lens_table.hysteresis import Hysteresis
    from calibration.lens_table.tables import LensTables
    from mvp.optics import AxisName

_MORE_VIEWS = "take more pictures with the target tilted by 30 deg and filling 80 %"
_D = Limit("d-uncertain", "one sigma of d", "%", 0.05, 0.2, _MORE_VIEWS)
_FOCUS = Limit(
    "d-against-depth-of-focus",
    "one sigma of the sharp place, as a share of the depth of focus c d / a,",
    "%",
    10.0,
    33.0,
    _MORE_VIEWS,
)
_E = Limit(
    "pupil-offset-uncertain",
    "one sigma of the pupil offset",
    "mm",
    0.3,
    1.0,
    "measure the sharp-focus distance at the two ends of the focus range again",
)
_A = Limit(
    "iris-uncertain",
    "one sigma of the pupil's diameter",
    "%",
    3.0,
    10.0,
    "sweep further out of focus at that iris",
)
_REPEAT = Limit(
    "focus-not-repeatable",
    "the focus motor's repeatability, as a share of the depth of focus c d / a,",
    "%",
    10.0,
    33.0,
    "look for play in the focus drive, or close the iris",
)
_LEAST_FILL = 0.4
_TABLED = ("one-pupil-offset", "parfocal")

_WRONG = {
    "constant-over-focus": "check the stated uncertainties; a lens that breathes (f changes "
    "with the focus) is known no better than is stated here",
    "one-pupil-offset": "measure more focus settings at every zoom, or calibrate only "
    "the zoom that is used: [lens_calibration] focuses, zooms, f_mm of the cell file",
    "parfocal": "measure more focus settings at every zoom, or calibrate only the zoom "
    "that is used: [lens_calibration] focuses, zooms, f_mm of the cell file",
    "one-table": "calibrate a narrower zoom range, or the zoom that is used alone: "
    "[lens_calibration] zooms and f_mm of the cell file",
    "pupil-follows": "do not shift a hand-eye result by d; calibrate it at each setting",
    "smooth-focus": "let the target fill more of the picture and fit each node alone",
}


_MORE_STEPS = " ([lens_calibration] zooms, focuses, irises of the cell file)"


def judge_lens(tables: LensTables) -> Verdict:
    """GO, MARGINAL or NO-GO with causes."""
    fit = tables.fit
    d_share = 100 * float((fit.d_sigma_mm / fit.d_mm).max())
    depth_share = 100 * float((tables.sharp_sigma_mm / tables.depth_of_focus_mm).max())
    iris = tables.curves["iris"].nodes
    return judged(
        _D.check(d_share),
        _FOCUS.check(depth_share),
        _E.check(fit.e_sigma_mm),
        _A.check(100 * float((iris.sigma_mm / iris.values_mm).max())),
        _assumptions(tables),
        _curves(tables),
        _sides(tables),
        _temperature(tables),
        _changes(tables),
    )


def _assumptions(tables: LensTables) -> Iterator[Cause]:
    fit = tables.fit
    for test in fit.tests:
        if test.contradicted and not (fit.freedom and test.code in _TABLED):
            yield Cause(
                test.code,
                "marginal",
                f"the data contradict that {test.assumption} "
                f"(probability {test.probability:.1g})",
                _WRONG[test.code],
            )
    least = float(fit.seen.fill.min())
    if fit.way == "per-node" and least < _LEAST_FILL:
        yield Cause(
            "target-too-small",
            "marginal",
            f"the target fills {100 * least:.0f} % of the picture, below 40 %",
            "use a larger target, or fit all nodes together",
        )


def _curves(tables: LensTables) -> Iterator[Cause]:
    for name, curve in tables.curves.items():
        again = f"measure the {name} axis again, at more steps{_MORE_STEPS}"
        if len(curve.nodes.steps) == 1:
            continue
        if not curve.monotone:
            message = f"the {name} table does not rise or fall throughout"
            yield Cause("not-monotone", "no-go", message, again)
        elif np.isnan(curve.left_out_sigmas):
            message = f"two steps of {name} cannot show how well it is interpolated"
            yield Cause("interpolation-untested", "marginal", message, again)
        else:
            what = f"the error of left-out {name} nodes, by their sigma,"
            limit = Limit("interpolation-poor", what, "", 2.0, 10.0, again)
            yield from limit.check(curve.left_out_sigmas)
    if tables.round_trip_steps > 1:
        message = f"steps come back {tables.round_trip_steps} steps off"
        yield Cause(
            "round-trip", "no-go", message, f"measure fewer settings{_MORE_STEPS}"
        )


def _changes(tables: LensTables) -> Iterator[Cause]:
    """What the zoom changes beside f, and how well that is interpolated."""
    for name, curve in tables.by_zoom.curves.items():
        what = WORDS[name]
        yield Cause(
            f"zoom-changes-{name.split('_')[0].replace('pupil', 'e')}",
            "go",
            f"the zoom changes {what}; the table holds it for every zoom",
            "nothing",
        )
        again = f"measure more zooms{_MORE_STEPS}"
        if np.isnan(curve.left_out_sigmas):
            words = f"two zooms cannot show how well {what} is interpolated"
            yield Cause("interpolation-untested", "marginal", words, again)
        else:
            words = f"the error of {what} at left-out zooms, by its sigma,"
            limit = Limit("interpolation-poor", words, "", 2.0, 10.0, again)
            yield from limit.check(curve.left_out_sigmas)


def _sides(tables: LensTables) -> Iterator[Cause]:
    measured = tables.measured
    for name in tables.curves:
        if len(tables.curves[name].nodes.steps) == 1:
            continue
        if name not in measured.hysteresis:
            yield Cause(
                "hysteresis-not-measured",
                "marginal",
                f"{name} was not approached from both sides",
                f"approach some steps of {name} from both sides, twice or more each",
            )
        else:
            yield from _one_side(tables, name, measured.hysteresis[name])


def _one_side(tables: LensTables, name: AxisName, found: Hysteresis) -> Iterator[Cause]:
    if found.width_steps < -3 * found.width_sigma_steps:
        yield Cause(
            "sides-swapped",
            "no-go",
            f"{name} runs ahead of its motor by {-found.width_steps:.1f} steps",
            "check that readings from below and from above were not mixed up",
        )
    side = tables.measured.approach.get(name, "from_below")
    if found.side != side:
        yield Cause(
            "other-side-repeats-better",
            "go",
            f"{name} repeats better {found.side.replace('_', ' ')}",
            f"measure the table {found.side.replace('_', ' ')}",
        )
    if name == "focus":
        nodes = tables.curves[name].nodes
        slope = np.abs(tables.curves[name].slope_mm(nodes.steps)).max()
        play = found.repeatability_steps * float(slope)
        yield from _REPEAT.check(100 * play / float(tables.depth_of_focus_mm.min()))


def _temperature(tables: LensTables) -> Iterator[Cause]:
    if tables.measured.conditions.temperature_c is None:
        yield Cause(
            "temperature-unknown",
            "go",
            "the temperature is unknown, so a later change cannot be noticed",
            "state the temperature, or connect a thermometer",
        )
