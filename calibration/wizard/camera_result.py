"""The result of a camera session, from its folder alone."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from calibration.camera import CameraEstimate, calibrate_camera, held_out_errors_px
from calibration.camera_uncertainty import projection_uncertainty
from calibration.observations import Observations
from calibration.projection import CAMERA_NAMES
from calibration.report import about_session, camera_report, render_report
from calibration.results import camera_calibration
from calibration.verdict import Verdict
from calibration.wizard.before import kept, line_of
from calibration.wizard.camera_views import result_options
from calibration.wizard.comparison import compare_cameras
from calibration.wizard.lookout import target_of
from calibration.wizard.points import points_of
from calibration.wizard.provenance import provenance_of, validity_of
from calibration.wizard.verification import HeldOutView, Verification
from calibration.wizard.working import setting_of
from mvp.errors import CalibrationError
from mvp.wizard import Outcome

if TYPE_CHECKING:
    from calibration.camera_uncertainty import ProjectionUncertainty
    from calibration.wizard.comparison import Comparison
    from calibration.wizard.session_store import SessionStore
    from mvp.calibrated import CameraCalibration, Provenance

FEWEST = 3
_NORMAL_95 = 1.96
_WHAT = "a point's place by the others of its view"


def outcome_of(store: SessionStore) -> Outcome:
    """Camera, verdict and everything that the report shows.

    Raises:
        CalibrationError: too few usable views, or none gives a pose.
    """
    samples = store.usable()
    if len(samples) < FEWEST:
        raise CalibrationError(
            f"{len(samples)} usable view(s) cannot calibrate a camera",
            hint=f"take at least {FEWEST}; go on with --resume",
            where=str(store.path),
        )
    facts, setting = store.facts, setting_of(store)
    seen = store.observations(samples)
    found = calibrate_camera(seen, result_options(facts))
    held = _held_out(store, found)
    causes = (*found.verdict.causes, *held.causes())
    found = replace(found, verdict=Verdict(causes))
    distance = setting.stand_off_mm(facts)
    work = _on_the_work(found, seen, distance)
    document = camera_calibration(
        found,
        sensor=facts.sensor,
        provenance=_provenance(store, len(samples)),
        error_95_mm=_NORMAL_95 * float(work.refitted_mm.max()) if work else None,
        validity=validity_of(store),
    )
    compared = compare_cameras(facts.camera, document, distance_mm=distance)
    return Outcome(
        "camera",
        document,
        document.quality,
        tuple(_lines(found, document, held, compared, distance)),
        {
            "result": found,
            "seen": seen,
            "verification": held,
            "comparison": compared,
        },
        points=points_of(samples, found.errors_px),
        comparison=kept(compared),
    )


def _held_out(store: SessionStore, found: CameraEstimate) -> Verification:
    """Views that had no part: half of their points foretell the other half."""
    samples = store.usable("verification")
    if not samples:
        return Verification(_WHAT, ())
    seen = store.observations(samples)
    shape = found.shape.shape if found.shape else None
    views = []
    for number, name in enumerate(seen.names):
        errors = held_out_errors_px(found.camera, seen.of_views([number]), shape)
        rms = float(np.sqrt((errors**2).sum(axis=1).mean()))
        views.append(HeldOutView(name, rms, np.sqrt(2) * found.sigma_px, "px"))
    return Verification(_WHAT, tuple(views))


def _on_the_work(
    found: CameraEstimate, seen: Observations, distance_mm: float
) -> ProjectionUncertainty | None:
    """None where the distortion folds over inside the picture."""
    try:
        return projection_uncertainty(
            found.camera,
            found.camera_covariance,
            size_px=(seen.width_px, seen.height_px),
            distance_mm=distance_mm,
        )
    except ValueError:
        return None


def page_of(store: SessionStore, outcome: Outcome) -> str:
    """The report of a result."""
    found, seen = outcome.details["result"], outcome.details["seen"]
    if not (isinstance(found, CameraEstimate) and isinstance(seen, Observations)):
        raise TypeError("not the outcome of a camera session")
    distance = setting_of(store).stand_off_mm(store.facts)
    target = target_of(store.facts)
    data = camera_report(
        found,
        seen,
        about_session(store, outcome.document, distance_mm=distance),
        distance_mm=distance,
        target_share=target.square_sigma_mm / target.square_mm,
    )
    held = outcome.details["verification"]
    words = (held.words,) if isinstance(held, Verification) else ()
    return render_report(replace(data, notes=(*data.notes, *words)))


def _provenance(store: SessionStore, views: int) -> Provenance:
    """The arm has no part in it."""
    method = f"{views} views of a target, chosen by what they tell"
    stamp = provenance_of(store, "camera", method)
    mine = {k: v for k, v in stamp.serial_numbers.items() if k != "arm"}
    return stamp.model_copy(update={"serial_numbers": mine})


def _lines(
    found: CameraEstimate,
    document: CameraCalibration,
    held: Verification,
    compared: Comparison,
    distance_mm: float,
) -> list[str]:
    """In words and millimetres."""
    sigma = dict(
        zip(CAMERA_NAMES, np.sqrt(np.diag(found.camera_covariance)), strict=True)
    )
    pitch = document.pitch_x_um / 1000
    camera = found.camera
    lines = [
        f"principal distance {pitch * camera.fx_px:.4f} +- "
        f"{pitch * sigma['fx_px']:.4f} mm at this lens setting; principal point "
        f"({camera.cx_px:.2f}, {camera.cy_px:.2f}) +- ({sigma['cx_px']:.2f}, "
        f"{sigma['cy_px']:.2f}) px; k1 {camera.k1:.4f} +- {sigma['k1']:.4f}",
        f"{len(found.view_names)} views; residual {found.rms_px:.3f} px, a coordinate is "
        f"found to {found.sigma_px:.3f} px",
    ]
    if document.quality.error_95_mm is not None:
        lines.append(
            f"at {distance_mm:.0f} mm a point is known to "
            f"{document.quality.error_95_mm:.3f} mm in the worst corner of the picture "
            "(95 %)"
        )
    if found.shape is not None and found.shape.words:
        lines.append(found.shape.words)
    return [*lines, held.words, line_of(compared)]
