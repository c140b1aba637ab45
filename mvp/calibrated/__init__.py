"""Result models of calibrations: data only."""

from mvp.calibrated.models import (
    AchievableSet,
    AchievableZoom,
    AxisTable,
    CameraCalibration,
    LensNodeResult,
    LensTableCalibration,
    LensValidity,
    Provenance,
    Quality,
    RigidCalibration,
)

__all__ = [
    "AchievableSet",
    "AchievableZoom",
    "AxisTable",
    "CameraCalibration",
    "LensNodeResult",
    "LensTableCalibration",
    "LensValidity",
    "Provenance",
    "Quality",
    "RigidCalibration",
]
