"""From estimates to the result models of ``mvp.calibrated``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibration.projection import CAMERA_NAMES
from mvp.calibrated import (
    CameraCalibration,
    NamedCovariance,
    Quality,
    VerdictCause,
    ViewResidual,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibration.camera import CameraEstimate
    from calibration.estimate import Estimate
    from calibration.verdict import Verdict
    from mvp.calibrated import Provenance, Validity
    from mvp.geometry import FloatArray
    from mvp.optics import Sensor

FILE_NAMES = {"cx_px": "centre_x_px", "cy_px": "centre_y_px"}


def quality_of(
    verdict: Verdict,
    estimate: Estimate,
    *,
    weakest: str = "",
    rms_px: float | None = None,
    rms_mm: float | None = None,
    error_95_mm: float | None = None,
    out_of_sample_px: float | None = None,
    out_of_sample_mm: float | None = None,
    views: Sequence[ViewResidual] = (),
) -> Quality:
    """Everything that a file says about how good a result is.

    Args:
        verdict: with its causes.
        estimate: gives condition, weakest direction, chi-square.
        weakest: replaces the estimate's weakest direction, where only some of its
            parameters are of interest.
        rms_px: residual in the picture.
        rms_mm: residual on the work.
        error_95_mm: error at the working distance that 95 % stay below.
        out_of_sample_px: RMS error on data that took no part.
        out_of_sample_mm: the same on the work.
        views: residuals by view.
    """
    return Quality(
        verdict=verdict.grade,
        rms_px=rms_px,
        rms_mm=rms_mm,
        error_95_mm=error_95_mm,
        reasons=verdict.reasons,
        causes=_causes(verdict),
        next_action=verdict.next_action,
        condition=estimate.condition,
        weakest_direction=weakest or estimate.weakest.words,
        chi_square=estimate.chi_square,
        degrees_of_freedom=estimate.degrees_of_freedom,
        chi_square_probability=estimate.probability,
        out_of_sample_px=out_of_sample_px,
        out_of_sample_mm=out_of_sample_mm,
        views=list(views),
    )


def refused(verdict: Verdict) -> Quality:
    """Of what gave no result: nothing but why, and what to do about it."""
    return Quality(
        verdict="no-go",
        reasons=verdict.reasons,
        causes=_causes(verdict),
        next_action=verdict.next_action,
    )


def _causes(verdict: Verdict) -> list[VerdictCause]:
    """Without remarks that do not lower the grade."""
    return [
        VerdictCause(
            code=cause.code,
            grade="no-go" if cause.grade == "no-go" else "marginal",
            message=cause.message,
            action=cause.action,
        )
        for cause in verdict.ordered
        if cause.grade != "go"
    ]


def named_covariance(names: Sequence[str], covariance: FloatArray) -> NamedCovariance:
    """A covariance for a file."""
    return NamedCovariance(parameters=list(names), matrix=covariance.tolist())


def camera_calibration(
    found: CameraEstimate,
    *,
    sensor: Sensor,
    provenance: Provenance,
    error_95_mm: float | None = None,
    validity: Validity | None = None,
) -> CameraCalibration:
    """The file of a camera calibration.

    Args:
        found: the result; its principal distance belongs to one lens setting.
        sensor: size and pitch.
        provenance: where it comes from.
        error_95_mm: at the working distance (see ``projection_uncertainty``).
        validity: conditions; none when left out.
    """
    camera = found.camera
    spread = np.sqrt(np.diag(found.camera_covariance))
    deviations = {
        FILE_NAMES.get(name, name): float(value)
        for name, value in zip(CAMERA_NAMES, spread, strict=True)
        if value > 0
    }
    limits = {} if validity is None else {"validity": validity}
    return CameraCalibration(
        schema="mvp-cell/camera/1",
        provenance=provenance,
        quality=_camera_quality(found, error_95_mm),
        width_px=sensor.width_px,
        height_px=sensor.height_px,
        pitch_x_um=1000 * sensor.pitch_x_mm,
        pitch_y_um=1000 * sensor.pitch_y_mm,
        centre_x_px=camera.cx_px,
        centre_y_px=camera.cy_px,
        k1=camera.k1,
        k2=camera.k2,
        p1=camera.p1,
        p2=camera.p2,
        k3=camera.k3,
        standard_deviation=deviations,
        reference_fx_px=camera.fx_px,
        reference_fy_px=camera.fy_px,
        covariance=named_covariance(CAMERA_NAMES, found.camera_covariance),
        **limits,
    )


def _camera_quality(found: CameraEstimate, error_95_mm: float | None) -> Quality:
    views = [
        ViewResidual(name=name, rms_px=float(rms))
        for name, rms in zip(found.view_names, found.view_rms_px, strict=True)
    ]
    return quality_of(
        found.verdict,
        found.estimate,
        weakest=found.weakest.words,
        rms_px=found.rms_px,
        error_95_mm=error_95_mm,
        out_of_sample_px=found.out_of_sample_px,
        views=views,
    )
