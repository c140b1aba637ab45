"""The report of a camera calibration."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibration.camera_uncertainty import projection_uncertainty
from calibration.poses import Poses
from calibration.projection import CAMERA_NAMES
from calibration.report.model import Quantity, ReportData
from calibration.report.plots import (
    BudgetPart,
    Coverage,
    ErrorBudget,
    ResidualField,
    ViewBars,
    WorkMap,
)
from calibration.report.shapes import (
    NORMAL_95,
    target_scene,
    tilts_of,
)

if TYPE_CHECKING:
    from calibration.camera import CameraEstimate
    from calibration.camera_uncertainty import ProjectionUncertainty
    from calibration.observations import Observations
    from calibration.report.model import About
    from calibration.report.plots import Plot

_MAP_GRID = (19, 25)
_WORDS = {
    "fx_px": "principal distance, x",
    "fy_px": "principal distance, y",
    "cx_px": "principal point, x",
    "cy_px": "principal point, y",
    "k1": "radial distortion k1",
    "k2": "radial distortion k2",
    "p1": "tangential distortion p1",
    "p2": "tangential distortion p2",
    "k3": "radial distortion k3",
}


def camera_report(
    found: CameraEstimate,
    seen: Observations,
    about: About,
    *,
    distance_mm: float,
    target_share: float = 0.0,
) -> ReportData:
    """Everything that the page of a camera calibration shows.

    Args:
        found: the result.
        seen: what it was made from.
        about: device, day, pictures.
        distance_mm: working distance from the entrance pupil.
        target_share: one sigma of the target's size, by its size.
    """
    work = _on_the_work(found, seen, distance_mm)
    return ReportData(
        "camera",
        about,
        _headline(work, distance_mm),
        found.verdict,
        _quantities(found),
        tuple(_plots(found, seen, work, distance_mm)),
        notes=(
            f"Worst determined combination: {found.weakest.words}.",
            "The principal distances belong to the lens setting of these pictures.",
            *_shape_words(found),
            *_target_words(target_share),
        ),
    )


def _shape_words(found: CameraEstimate) -> tuple[str, ...]:
    words = found.shape.words if found.shape else ""
    return (f"{words[0].upper()}{words[1:]}.",) if words else ()


def _target_words(share: float) -> tuple[str, ...]:
    if not share:
        return ()
    return (
        f"The size of the target is known to {100 * share:.2g} % (one sigma). That does not "
        "touch this result, but lengths and poses found with the target share it.",
    )


def _on_the_work(
    found: CameraEstimate, seen: Observations, distance_mm: float
) -> ProjectionUncertainty | None:
    """None where the distortion is so wrong that some pixels see nothing."""
    size = (seen.width_px, seen.height_px)
    try:
        return projection_uncertainty(
            found.camera,
            found.camera_covariance,
            size_px=size,
            distance_mm=distance_mm,
            grid=_MAP_GRID,
        )
    except ValueError:
        return None


def _headline(work: ProjectionUncertainty | None, distance_mm: float) -> str:
    if work is None:
        return (
            "The distortion folds over inside the picture: the result makes no sense."
        )
    worst = NORMAL_95 * float(work.refitted_mm.max())
    middle = NORMAL_95 * float(np.median(work.refitted_mm))
    return (
        f"At {distance_mm:.0f} mm a point is known to {middle:.2g} mm in most of the "
        f"picture and to {worst:.2g} mm in its worst corner (95 %)."
    )


def _quantities(found: CameraEstimate) -> tuple[Quantity, ...]:
    rows = [_row(found, name) for name in CAMERA_NAMES]
    rows.append(
        Quantity("residual (RMS of a point)", found.rms_px, None, "px", "data used")
    )
    if found.out_of_sample_px is not None:
        left = "views that took no part"
        rows.append(
            Quantity("residual, held out", found.out_of_sample_px, None, "px", left)
        )
    rows.append(Quantity("noise of a coordinate", found.sigma_px, None, "px"))
    return tuple(rows)


def _row(found: CameraEstimate, name: str) -> Quantity:
    sigma = found.sigma_of(name)
    unit = "px" if name.endswith("px") else ""
    value = float(getattr(found.camera, name))
    held = "" if sigma > 0 else "held"
    return Quantity(_WORDS[name], value, sigma or None, unit, held)


def _plots(
    found: CameraEstimate,
    seen: Observations,
    work: ProjectionUncertainty | None,
    distance_mm: float,
) -> list[Plot]:
    size = (seen.width_px, seen.height_px)
    plots: list[Plot] = [
        ViewBars(
            "residual of each view (RMS)", "px", found.view_names, found.view_rms_px
        ),
        ResidualField(seen.pixels, found.errors_px, size, found.sigma_px),
        Coverage.of(seen.pixels, size),
        tilts_of(found.state.rotation, seen.names),
    ]
    if work is not None:
        plots.append(WorkMap(work.pixels, work.refitted_mm, distance_mm))
        plots.append(_budget(found, work))
    there = Poses(found.state.rotation, found.state.translation_mm)
    return [*plots, target_scene(there, found.camera, seen, seen.names)]


def _budget(found: CameraEstimate, work: ProjectionUncertainty) -> ErrorBudget:
    spread = float(np.sqrt((work.refitted_mm**2).mean()))
    noise = found.sigma_px * work.mm_per_px
    return ErrorBudget(
        work.distance_mm,
        "a single point, across the line of sight",
        (
            BudgetPart("calibration", spread, "this result, mean over the picture"),
            BudgetPart("pixel noise", noise, f"{found.sigma_px:.3g} px of one point"),
        ),
    )
