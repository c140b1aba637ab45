"""Vector overlays on a captured picture, so that lines stay sharp when zoomed or printed.

The picture is embedded once per view and referred to by every close-up. Everything that
ends up in markup passes through ``escape`` or number formatting.
"""

from __future__ import annotations

import base64
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np
from markupsafe import Markup, escape

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from mvp.geometry import FloatArray

_BAND = 3.2  # a predicted line is a band that shows beside the measured line on it
_COLOURS = {"predicted": "#2b8cff", "measured": "#ff7a00"}


Role: TypeAlias = Literal["predicted", "measured"]


@dataclass(frozen=True, eq=False)
class Polyline:
    """Points (n, 2) in pixels, drawn as predicted or measured; ends get dots."""

    points_px: FloatArray
    role: Role
    label: str = ""
    closed: bool = False


@dataclass(frozen=True)
class Crop:
    """A part of the picture: left, top, width, height in pixels."""

    left: float
    top: float
    width: float
    height: float


def data_uri(path: Path) -> str:
    """A PNG file as text that a page can embed."""
    return "data:image/png;base64," + base64.b64encode(path.read_bytes()).decode()


def whole_picture(
    name: str, uri: str, size_px: tuple[int, int], lines: Sequence[Polyline]
) -> Markup:
    """The picture with its lines; defines the image for later close-ups."""
    width, height = size_px
    image = Markup(
        '<image id="{}" href="{}" width="{}" height="{}" '
        'style="image-rendering:pixelated"/>'
    ).format(name, uri, width, height)
    crop = Crop(-0.5, -0.5, width, height)
    return _svg(
        crop,
        Markup('<g transform="translate(-0.5 -0.5)">') + image + Markup("</g>"),
        lines,
        stroke=max(width, height) / 330,
    )


def close_up(name: str, lines: Sequence[Polyline], size_px: tuple[int, int]) -> Markup:
    """The surroundings of some lines, enlarged; refers to the picture by name."""
    points = np.concatenate([line.points_px for line in lines])
    low, high = points.min(axis=0), points.max(axis=0)
    side = max(24.0, 1.35 * float((high - low).max()))
    middle = (low + high) / 2
    side = min(side, float(min(size_px)))
    left, top = np.clip(middle - side / 2, -0.5, np.array(size_px) - 0.5 - side)
    image = Markup('<g transform="translate(-0.5 -0.5)"><use href="#{}"/></g>')
    crop = Crop(float(left), float(top), side, side)
    return _svg(crop, image.format(name), lines, stroke=side / 150)


def _svg(
    crop: Crop, image: Markup, lines: Sequence[Polyline], *, stroke: float
) -> Markup:
    box = f"{crop.left:.3f} {crop.top:.3f} {crop.width:.3f} {crop.height:.3f}"
    body = Markup("").join(_line(line, stroke) for line in lines)
    return Markup('<svg viewBox="{}" role="img">{}{}</svg>').format(box, image, body)


def _line(line: Polyline, stroke: float) -> Markup:
    points = np.asarray(line.points_px, dtype=np.float64).reshape(-1, 2)
    text = " ".join(f"{x:.3f},{y:.3f}" for x, y in points)
    colour = _COLOURS[line.role]
    tag = "polygon" if line.closed else "polyline"
    predicted = line.role == "predicted"
    shape = Markup(
        '<{} points="{}" fill="none" stroke="{}" stroke-width="{:.3f}" '
        'stroke-opacity="{}"><title>{}</title></{}>'
    ).format(
        Markup(tag),
        text,
        colour,
        stroke * (_BAND if predicted else 1.0),
        0.85 if predicted else 1,
        escape(line.label),
        Markup(tag),
    )
    if line.closed:
        return shape
    dot = Markup('<circle cx="{:.3f}" cy="{:.3f}" r="{:.3f}" fill="{}"/>')
    ends = [dot.format(x, y, 2.0 * stroke, colour) for x, y in points[[0, -1]]]
    return shape + Markup("").join(ends)
