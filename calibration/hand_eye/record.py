"""From a hand-eye solution to its file."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibration.results import quality_of
from mvp.calibrated import RigidCalibration, Validity, ViewResidual
from mvp.errors import CalibrationError

if TYPE_CHECKING:
    from calibration.hand_eye.data import HandEyeData
    from calibration.hand_eye.result import HandEyeResult, HandEyeSolution
    from mvp.calibrated import Provenance, Quality
    from mvp.geometry import FloatArray

_NORMAL_95 = 1.96


def hand_eye_calibration(
    result: HandEyeResult,
    data: HandEyeData,
    *,
    provenance: Provenance,
    stand_off_mm: float,
    reference_d_mm: float,
    reference_f_mm: float,
    validity: Validity | None = None,
) -> RigidCalibration:
    """The file of a hand-eye calibration.

    Args:
        result: with a solution.
        data: what it was made from; names the views.
        provenance: where it comes from.
        stand_off_mm: distance for which the 95 % error is stated.
        reference_d_mm: image distance of the lens in all pictures.
        reference_f_mm: its focal length.
        validity: conditions; none when left out.

    Raises:
        CalibrationError: the views gave no solution; says why and what to do.
    """
    found = result.solution
    if found is None:
        raise CalibrationError(
            f"no hand-eye transform to store: {'; '.join(result.verdict.reasons)}",
            hint=result.verdict.next_action,
        )
    return RigidCalibration(
        schema="mvp-cell/hand-eye/1",
        provenance=provenance,
        quality=_quality(result, found, data, stand_off_mm),
        target=found.moving_from_camera.target,
        source="camera",
        matrix=found.moving_from_camera.matrix.tolist(),
        covariance=found.covariance.tolist(),
        reference_d_mm=reference_d_mm,
        reference_f_mm=reference_f_mm,
        validity=validity or Validity(),
    )


def _quality(
    result: HandEyeResult,
    found: HandEyeSolution,
    data: HandEyeData,
    stand_off_mm: float,
) -> Quality:
    return quality_of(
        result.verdict,
        found.estimate,
        weakest=found.weakest.words,
        rms_px=found.rms_px,
        error_95_mm=_NORMAL_95 * found.error_mm(stand_off_mm),
        out_of_sample_mm=float(np.sqrt((found.left_out_mm**2).mean())),
        views=[
            ViewResidual(name=name, rms_px=float(rms), rms_mm=float(error))
            for name, rms, error in zip(
                data.seen.names, _of_views(found, data), found.left_out_mm, strict=True
            )
        ],
    )


def _of_views(found: HandEyeSolution, data: HandEyeData) -> FloatArray:
    """(n,), root mean square of the distance of a point in each view, px."""
    squares = (found.errors_px**2).sum(axis=1)
    counts = np.bincount(data.seen.view)
    return np.asarray(np.sqrt(np.bincount(data.seen.view, squares) / counts))
