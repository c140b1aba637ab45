"""What the zoom changes beside f, as curves over its steps, where the data ask for it.

Pupil offset and the shift of x come from the separation of f, d and e; the principal
point and k1 (OpenCV's) from the cameras of all nodes at a zoom together.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import chi2

from calibration.lens_table.interpolation import AxisCurve, AxisNodes, free_curve
from calibration.lens_table.left_out_zooms import left_out_zooms
from calibration.lens_table.lens_models import IMPROBABLE
from mvp.calibrated import ZoomTable

if TYPE_CHECKING:
    from collections.abc import Mapping

    from calibration.lens_table.left_out_zooms import Changed
    from calibration.lens_table.nodes import NodeSet
    from calibration.lens_table.separation import LensFit
    from mvp.geometry import FloatArray

WORDS = {
    "pupil_offset_mm": "the pupil offset",
    "focus_shift_mm": "x = d - f",
    "centre_x_px": "the principal point (x)",
    "centre_y_px": "the principal point (y)",
    "k1": "the distortion k1",
}
_PAIR = ("centre_x_px", "centre_y_px")


@dataclass(frozen=True, eq=False)
class ByZoom:
    """Curves by the names of ``ZoomTable``; only what the zoom changes.

    Attributes:
        curves: their values and errors in the unit of the name.
    """

    curves: Mapping[str, AxisCurve]

    def table(self) -> ZoomTable | None:
        """As the planner reads it; None where the zoom changes nothing else."""
        if not self.curves:
            return None
        first = next(iter(self.curves.values()))
        return ZoomTable(
            steps=[int(step) for step in first.table_steps],
            standard_deviation={
                name: float(curve.nodes.sigma_mm.max())
                for name, curve in self.curves.items()
            },
            left_out={
                name: float(np.sqrt(np.mean(curve.left_out_mm**2)))
                for name, curve in self.curves.items()
                if len(curve.left_out_mm)
            },
            **{
                name: [float(value) for value in curve.table_mm]
                for name, curve in self.curves.items()
            },
        )


def curves_by_zoom(
    fit: LensFit, e_prior_mm: tuple[float, float] | None = None
) -> ByZoom:
    """Those that the data ask for; every one at the same steps.

    Args:
        fit: of f, x and e.
        e_prior_mm: with which it was made.
    """
    seen = fit.seen
    if len(seen.zoom_steps) < 2:
        return ByZoom({})
    found: dict[str, AxisCurve] = {}
    shift = fit.shift_mm, fit.shift_sigma_mm
    offset = fit.e_of_zoom_mm, fit.e_of_zoom_sigma_mm
    known: tuple[tuple[Changed, int, tuple[FloatArray, FloatArray]], ...] = (
        ("pupil_offset_mm", fit.freedom.own_e, offset),
        ("focus_shift_mm", fit.freedom.shifted, shift),
    )
    for name, degree, told in known:
        if degree:
            curve = _drawn(seen, *told)
            if degree < len(seen.zoom_steps) - 1:
                # No zoom was fitted for itself: leaving a node out of the curve, which
                # is a polynomial, would tell nothing.
                errors, sigmas = left_out_zooms(seen, e_prior_mm, fit.freedom, name)
                curve = replace(curve, left_out_mm=errors, left_out_sigmas=sigmas)
            found[name] = curve
    for names in (_PAIR, ("k1",)):
        means = {of: _of_cameras(seen, of) for of in names}
        if any(_differs(values, sigma) for values, sigma in means.values()):
            found |= {of: _drawn(seen, *pair) for of, pair in means.items()}
    return ByZoom(found)


def _drawn(seen: NodeSet, values: FloatArray, sigma: FloatArray) -> AxisCurve:
    # The shift of one zoom is zero by definition, but not better known than others.
    floor = np.where(sigma > 0, sigma, np.median(sigma[sigma > 0]))
    return free_curve(AxisNodes(seen.zoom_steps, values, floor))


def _of_cameras(seen: NodeSet, name: str) -> tuple[FloatArray, FloatArray]:
    """Weighted means (z,) of the nodes of each zoom, and their sigmas.

    Nodes that scatter more than they say, as a centre does that moves with the focus,
    widen the sigma.
    """
    values, variance = _of_nodes(seen, name)
    means, sigmas = [], []
    for zoom in range(len(seen.zoom_steps)):
        mine = seen.zoom_of == zoom
        weight = 1 / variance[mine]
        mean = float((weight * values[mine]).sum() / weight.sum())
        scatter = float((weight * (values[mine] - mean) ** 2).sum())
        factor = max(scatter / max(int(mine.sum()) - 1, 1), 1.0)
        means.append(mean)
        sigmas.append(np.sqrt(factor / weight.sum()))
    return np.array(means), np.array(sigmas)


def _of_nodes(seen: NodeSet, name: str) -> tuple[FloatArray, FloatArray]:
    """(n,) value and variance in every node."""
    if name == "k1":
        scale = seen.values[:, 0] ** 2
        return seen.values[:, 3] * scale, seen.covariances[:, 3, 3] * scale**2
    of = 1 + _PAIR.index(name)
    return seen.values[:, of], seen.covariances[:, of, of]


def _differs(values: FloatArray, sigma: FloatArray) -> bool:
    """Beyond chance from one value for all."""
    weight = 1 / sigma**2
    off = values - (weight * values).sum() / weight.sum()
    return float(chi2.sf((weight * off**2).sum(), len(values) - 1)) < IMPROBABLE
