"""Result models of calibrations, and what a target shows: data only."""

from mvp.calibrated.lens_grid import LensGrid
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
    TemperatureSource,
    Validity,
    VerdictCause,
    ViewResidual,
)
from mvp.calibrated.session_result import (
    PointResiduals,
    ResultComparison,
    ResultDifference,
)
from mvp.calibrated.target_print import MeasuredTarget, TargetKind, TargetPrint
from mvp.calibrated.zoom_table import ZoomTable

__all__ = [
    "AchievableSet",
    "AchievableZoom",
    "AxisTable",
    "CameraCalibration",
    "LensGrid",
    "LensNodeResult",
    "LensTableCalibration",
    "LensValidity",
    "MeasuredTarget",
    "NamedCovariance",
    "PointResiduals",
    "Provenance",
    "Quality",
    "ResultComparison",
    "ResultDifference",
    "RigidCalibration",
    "TargetKind",
    "TargetPrint",
    "TemperatureSource",
    "Validity",
    "VerdictCause",
    "ViewResidual",
    "ZoomTable",
]
