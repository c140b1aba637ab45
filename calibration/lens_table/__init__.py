"""Lens tables from measurements: f, d, a, e, hysteresis, and how good they are."""

from calibration.lens_table.aperture import (
    ApertureResult,
    BlurShots,
    defocus,
    measure_aperture,
)
from calibration.lens_table.export import LensIdentity, calibration_file
from calibration.lens_table.from_views import (
    PixelGrid,
    filled_share,
    node_from_views,
)
from calibration.lens_table.hysteresis import BothSides, Hysteresis, measure_hysteresis
from calibration.lens_table.interpolation import (
    AxisCurve,
    AxisNodes,
    CurveKind,
    best_curve,
)
from calibration.lens_table.judge import judge_lens
from calibration.lens_table.nodes import LensNode, Measured
from calibration.lens_table.separation import AssumptionTest, LensFit, separate
from calibration.lens_table.tables import (
    Conditions,
    LensMeasurements,
    LensTables,
    build_tables,
    round_trip_steps,
)
from calibration.lens_table.travel import (
    TravelPrior,
    TravelResult,
    camera_from_tool,
    measure_travel,
    next_direction,
)
from calibration.lens_table.travel_problem import TravelShots

__all__ = [
    "ApertureResult",
    "AssumptionTest",
    "AxisCurve",
    "AxisNodes",
    "BlurShots",
    "BothSides",
    "Conditions",
    "CurveKind",
    "Hysteresis",
    "LensFit",
    "LensIdentity",
    "LensMeasurements",
    "LensNode",
    "LensTables",
    "Measured",
    "PixelGrid",
    "TravelPrior",
    "TravelResult",
    "TravelShots",
    "best_curve",
    "build_tables",
    "calibration_file",
    "camera_from_tool",
    "defocus",
    "filled_share",
    "judge_lens",
    "measure_aperture",
    "measure_hysteresis",
    "measure_travel",
    "next_direction",
    "node_from_views",
    "round_trip_steps",
    "separate",
]
