"""Calibration targets: layout, detection, checks of a picture, printable PDF."""

from calibration.targets.detect import Detection, Rejection, detect
from calibration.targets.gather import Gathered, Picture, gather
from calibration.targets.layout import (
    Charuco,
    Chessboard,
    CircleGrid,
    MeasuredLength,
    Target,
    caliper,
    nominal,
    target_of_print,
)
from calibration.targets.pdf import (
    PAPERS_MM,
    target_pdf,
    target_sheet,
    write_target_pdf,
)

__all__ = [
    "PAPERS_MM",
    "Charuco",
    "Chessboard",
    "CircleGrid",
    "Detection",
    "Gathered",
    "MeasuredLength",
    "Picture",
    "Rejection",
    "Target",
    "caliper",
    "detect",
    "gather",
    "nominal",
    "target_of_print",
    "target_pdf",
    "target_sheet",
    "write_target_pdf",
]
