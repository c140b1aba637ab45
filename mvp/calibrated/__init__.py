"""Result models of calibrations, and what a target shows: data only."""

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
from mvp.calibrated.target_print import TargetKind, TargetPrint

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
    "TargetKind",
    "TargetPrint",
    "Validity",
    "VerdictCause",
    "ViewResidual",
]
