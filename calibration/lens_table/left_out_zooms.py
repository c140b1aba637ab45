"""How well a low degree over the zoom foretells a zoom that was left out.

A pupil offset or a shift of x that is a line or a parabola over the zoom is fitted with
all nodes at once. Here the whole fit is made again without the nodes of one zoom, and
what it foretells there is held against a fit in which every zoom stands for itself.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from calibration.lens_table.lens_models import ZoomFreedom, able, fitted, per_node
from calibration.lens_table.nodes import NodeSet

if TYPE_CHECKING:
    from typing import TypeAlias

    from calibration.lens_table.lens_models import Prior
    from mvp.geometry import FloatArray, IntArray

    Changed: TypeAlias = Literal["pupil_offset_mm", "focus_shift_mm"]

_X, _E = 1, 2


def left_out_zooms(
    seen: NodeSet, prior: Prior, freedom: ZoomFreedom, name: Changed
) -> tuple[FloatArray, float]:
    """Foretold less measured at every inner zoom, and that by its sigma.

    Args:
        seen: all nodes.
        prior: mean and one standard deviation of e known beforehand.
        freedom: the degrees that were chosen.
        name: of what is foretold.

    Returns:
        Errors (z - 2,), mm, and their root mean square by what each should scatter;
        none and 0 where the nodes do not bear one fit for each zoom or one without it.
    """
    whole = len(seen.zoom_steps) - 1
    of_e = name == "pupil_offset_mm"
    free = ZoomFreedom(
        whole if of_e else freedom.own_e, freedom.shifted if of_e else whole
    )
    measured = _fit(seen, prior, free, name)
    if measured is None:
        return np.zeros(0), 0.0
    found = [
        _one_left_out(seen, prior, freedom, name, zoom, measured)
        for zoom in range(1, whole)
    ]
    pairs = [pair for pair in found if pair is not None]
    if not pairs or len(pairs) < len(found):
        return np.zeros(0), 0.0
    errors, sigmas = np.array(pairs).T
    return np.asarray(errors), float(np.sqrt(np.mean((errors / sigmas) ** 2)))


def _one_left_out(
    seen: NodeSet,
    prior: Prior,
    freedom: ZoomFreedom,
    name: Changed,
    zoom: int,
    measured: tuple[FloatArray, FloatArray],
) -> tuple[float, float] | None:
    """Error and sigma at one zoom, by its index."""
    nodes = zip(seen.nodes, seen.zoom_of, strict=True)
    rest = NodeSet.of([node for node, own in nodes if own != zoom])
    foretold = _fit(rest, prior, freedom, name)
    degree = freedom.own_e if name == "pupil_offset_mm" else freedom.shifted
    if len(rest.zoom_steps) <= degree or foretold is None:
        return None
    weights = _weights(rest.zoom_steps, int(seen.zoom_steps[zoom]), degree)
    own = np.eye(len(seen.zoom_steps))[zoom]
    if name == "focus_shift_mm":
        # A shift counts from a zoom of the fit's own choice: here both from the one before.
        weights[zoom - 1] -= 1
        own[zoom - 1] -= 1
    (there, there_cov), (here, here_cov) = foretold, measured
    variance = weights @ there_cov @ weights + own @ here_cov @ own
    return float(weights @ there - own @ here), float(np.sqrt(variance))


def _fit(
    seen: NodeSet, prior: Prior, freedom: ZoomFreedom, name: Changed
) -> tuple[FloatArray, FloatArray] | None:
    """The value at every zoom and its covariance; None where the nodes do not bear it."""
    if not able(seen, freedom):
        return None
    model = per_node(seen, prior, freedom)
    found = fitted(model.problem)
    if found is None:
        return None
    of, rows = (_E, model.e) if name == "pupil_offset_mm" else (_X, model.shift)
    block = model.problem.block(found.estimate.covariance, of)
    values = rows @ model.problem.parameters(found.state, of)
    return np.asarray(values), np.asarray(rows @ block @ rows.T)


def _weights(steps: IntArray, step: int, degree: int) -> FloatArray:
    """(z,): how a polynomial through values at the steps gives its value at another."""
    middle, span = float(np.mean(steps)), float(np.ptp(steps)) or 1.0
    there = np.vander((steps - middle) / span, degree + 1)
    here = np.vander(np.array([(step - middle) / span]), degree + 1)[0]
    return np.asarray(np.linalg.lstsq(there.T, here, rcond=None)[0])
