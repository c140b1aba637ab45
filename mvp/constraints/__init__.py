"""Margins of a batch of views: one file per constraint, all with the same shape."""

from mvp.constraints.base import (
    N_COORDINATES,
    SHIFT,
    TURN,
    Constraint,
    Kind,
    Report,
    Reporting,
    Rows,
    margin_report,
    worst_of,
)
from mvp.constraints.clearance import CameraClearance
from mvp.constraints.enclosing import enclosing_sphere
from mvp.constraints.field_of_view import (
    FieldOfViewCircle,
    FieldOfViewRectangle,
    half_extents_mm,
)
from mvp.constraints.focus import FocusFar, FocusNear
from mvp.constraints.lens_range import LensBound, LensRange
from mvp.constraints.reach import Reach
from mvp.constraints.resolution import Resolution
from mvp.constraints.sigma import (
    ErrorModel,
    Uncertainty,
    correlated_deviation,
    margin_deviation,
    rows_index,
    sigma_index,
    worst_deviation,
    worst_spread,
)
from mvp.constraints.visibility import Visibility
from mvp.constraints.workspace import Workspace

__all__ = [
    "N_COORDINATES",
    "SHIFT",
    "TURN",
    "CameraClearance",
    "Constraint",
    "ErrorModel",
    "FieldOfViewCircle",
    "FieldOfViewRectangle",
    "FocusFar",
    "FocusNear",
    "Kind",
    "LensBound",
    "LensRange",
    "Reach",
    "Report",
    "Reporting",
    "Resolution",
    "Rows",
    "Uncertainty",
    "Visibility",
    "Workspace",
    "correlated_deviation",
    "enclosing_sphere",
    "half_extents_mm",
    "margin_deviation",
    "margin_report",
    "rows_index",
    "sigma_index",
    "worst_deviation",
    "worst_of",
    "worst_spread",
]
