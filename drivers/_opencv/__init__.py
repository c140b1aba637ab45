"""OpenCV's VideoCapture, tamed: sources, a reader thread, exposure controls."""

from drivers._opencv.controls import Exposure, FixedExposure, HttpExposure, V4l2Exposure
from drivers._opencv.reader import Reader, Reading
from drivers._opencv.replay import Replay
from drivers._opencv.source import (
    Kind,
    OpenedSource,
    SourceSettings,
    kind_of,
    open_source,
    v4l2_devices,
)

__all__ = [
    "Exposure",
    "FixedExposure",
    "HttpExposure",
    "Kind",
    "OpenedSource",
    "Reader",
    "Reading",
    "Replay",
    "SourceSettings",
    "V4l2Exposure",
    "kind_of",
    "open_source",
    "v4l2_devices",
]
