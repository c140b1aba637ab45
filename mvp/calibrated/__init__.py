"""Result models of calibrations: data only."""

from mvp.calibrated.models import (
    AchievableSet,
    AchievableZoom,
    AxisTable,
    CameraCalibration,
    LensNodeResult,
    LensTableCalibration,
    LensValidity,
    NamedCovariance,
    Provenance,
    Quality,
    RigidCalibration,
    Validity,
    VerdictCause,
    ViewResidual,
)

__all__ = [
    "AchievableSet",
    "AchievableZoom",
    "AxisTable",
    "CameraCalibration",
    "LensNodeResult",
    "LensTableCalibration",
    "LensValidity",
    "NamedCovariance",
    "Provenance",
    "Quality",
    "RigidCalibration",
    "Validity",
    "VerdictCause",
    "ViewResidual",
]
