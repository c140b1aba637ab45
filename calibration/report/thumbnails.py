"""Small versions of pictures, with the points that were found in them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np
from markupsafe import Markup

from calibration.report.canvas import as_jpeg

if TYPE_CHECKING:
    from calibration.report.model import Photo

_WIDTH_PX = 260
_QUALITY = 80
_MOST_POINTS = 150
_MARK = "#ff9a1f"


def thumbnail(photo: Photo) -> Markup | None:
    """An SVG with the picture and its points; None where there is no picture."""
    if photo.grey is None:
        return None
    grey = np.asarray(photo.grey, dtype=np.uint8)
    rows, columns = grey.shape
    scale = min(1.0, _WIDTH_PX / columns)
    size = (max(round(columns * scale), 1), max(round(rows * scale), 1))
    small = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    coded = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1]
    drawn = as_jpeg(coded.tobytes(), photo.name)
    points = np.asarray(photo.points_px, dtype=np.float64).reshape(-1, 2)
    every = -(-len(points) // _MOST_POINTS) or 1
    radius = 0.011 * columns
    dots = Markup("").join(
        Markup('<circle cx="{:.1f}" cy="{:.1f}" r="{:.1f}"/>').format(x, y, radius)
        for x, y in points[::every]
    )
    return Markup(
        '<svg viewBox="-0.5 -0.5 {} {}" role="img" aria-label="{}">'
        '<image x="-0.5" y="-0.5" href="{}" width="{}" height="{}"/>'
        '<g fill="none" stroke="{}" stroke-width="{:.1f}">{}</g></svg>'
    ).format(
        columns, rows, photo.name, drawn.uri, columns, rows, _MARK, radius / 2, dots
    )
