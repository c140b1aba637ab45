"""Result models of calibrations: data only."""

from mvp.calibrated.models import (
    AxisTable,
    CameraCalibration,
    LensTableCalibration,
    Provenance,
    Quality,
    RigidCalibration,
)

__all__ = [
    "AxisTable",
    "CameraCalibration",
    "LensTableCalibration",
    "Provenance",
    "Quality",
    "RigidCalibration",
]
