"""Part, visibility region and viewpoints with viewing vectors (the paper's Figs. 6-10)."""

from __future__ import annotations

from dataclasses import dataclass
from io import BytesIO
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from mvp.cell.durable import write_durably
from mvp.cell.figures.illustrate import Drawing, Surface, draw, eye_around
from mvp.geometry import Box

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from matplotlib.axes import Axes

    from mvp.geometry import FloatArray, TriangleMesh

PART = (0.74, 0.77, 0.82)
FIXTURE = (0.86, 0.80, 0.70)
REGION = (0.20, 0.55, 0.90)
_FEATURE = "#d6261e"
_VIEW = "#0b6b3a"
_DPI = 100


@dataclass(frozen=True, eq=False)
class Viewpoint:
    """An arrow in the picture: position (3,) mm and direction (3,), part frame."""

    label: str
    position_mm: FloatArray
    direction: FloatArray


@dataclass(frozen=True, eq=False)
class SceneParts:
    """What a scene picture shows; everything in the part frame, mm."""

    part: TriangleMesh
    fixtures: Sequence[TriangleMesh] = ()
    region: TriangleMesh | None = None
    outlines_mm: Sequence[FloatArray] = ()
    viewpoints: Sequence[Viewpoint] = ()


def scene_picture(
    parts: SceneParts,
    path: Path,
    *,
    title: str = "",
    forward: Sequence[float] | None = None,
    frame: Box | None = None,
    size_px: tuple[int, int] = (900, 680),
) -> Path:
    """Draw the scene and write it as a PNG.

    Args:
        parts: what to show.
        path: the file to write.
        title: a line above the picture.
        forward: viewing direction of the picture; by default one from which every
            viewing vector is seen from the side.
        frame: what the picture must contain; default everything but the region,
            which is cut at the edge of the picture.
        size_px: columns and rows.

    Raises:
        OutputError: the file cannot be written.
    """
    surfaces = [Surface(parts.part, PART)]
    surfaces += [Surface(mesh, FIXTURE) for mesh in parts.fixtures]
    if parts.region is not None and len(parts.region.faces):
        surfaces.append(Surface(parts.region, REGION, opacity=0.16))
    box = frame or _frame(parts)
    forward = _side_on(parts.viewpoints) if forward is None else forward
    drawing = draw(surfaces, eye_around(box, forward=forward, size_px=size_px))
    figure, axes = _canvas(drawing)
    _outlines(axes, drawing, parts.outlines_mm)
    _viewpoints(axes, drawing, parts.viewpoints, box)
    _scale_bar(axes, drawing)
    if title:
        axes.text(14, 26, title, fontsize=12, weight="bold", va="center")
    picture = BytesIO()
    figure.savefig(picture, dpi=_DPI, format=path.suffix.removeprefix("."))
    write_durably(path, picture.getvalue())
    return path


def _side_on(views: Sequence[Viewpoint]) -> Sequence[float]:
    """The direction, from slightly above, that shortens viewing vectors least."""
    azimuth = np.deg2rad(np.arange(30, 390, 15))
    tilt = np.deg2rad(28.0)
    forwards = np.stack(
        [
            np.cos(azimuth) * np.cos(tilt),
            np.sin(azimuth) * np.cos(tilt),
            np.full_like(azimuth, -np.sin(tilt)),
        ],
        axis=1,
    )
    along = [np.abs(forwards @ view.direction) for view in views]
    worst = np.max([*along, np.zeros(len(forwards))], axis=0)
    return [float(value) for value in forwards[np.argmin(worst)]]


def _frame(parts: SceneParts) -> Box:
    points = [parts.part.vertices_mm]
    points += [view.position_mm[None] for view in parts.viewpoints]
    box = Box.around(np.concatenate(points))
    return Box.around(box.corners(), grow_mm=0.06 * box.diagonal_mm)


def _canvas(drawing: Drawing) -> tuple[Figure, Axes]:
    columns, rows = drawing.eye.size_px
    figure = Figure(figsize=(columns / _DPI, rows / _DPI), dpi=_DPI)
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.imshow(np.clip(drawing.rgb, 0, 1), interpolation="nearest")
    axes.set_xlim(-0.5, columns - 0.5)
    axes.set_ylim(rows - 0.5, -0.5)
    axes.axis("off")
    return figure, axes


def _outlines(axes: Axes, drawing: Drawing, outlines: Sequence[FloatArray]) -> None:
    for outline in outlines:
        pixels, _ = drawing.eye.project(_densely(outline))
        hidden = drawing.hidden(_densely(outline), slack_mm=2 * drawing.eye.mm_per_px)
        axes.plot(*pixels.T, color=_FEATURE, lw=1.0, ls=(0, (2, 2)), alpha=0.8)
        shown = np.where(hidden[:, None], np.nan, pixels)
        axes.plot(*shown.T, color=_FEATURE, lw=2.6, solid_capstyle="round")


def _densely(outline: FloatArray, *, points: int = 60) -> FloatArray:
    """The same polyline with more points, so that it can be hidden in parts."""
    if len(outline) == 1:
        return outline
    length = np.concatenate(
        [[0.0], np.cumsum(np.linalg.norm(np.diff(outline, axis=0), axis=1))]
    )
    at = np.linspace(0, length[-1], points)
    return np.stack([np.interp(at, length, outline[:, k]) for k in range(3)], axis=1)


def _viewpoints(
    axes: Axes, drawing: Drawing, views: Sequence[Viewpoint], box: Box
) -> None:
    for view in views:
        tip = view.position_mm + 0.13 * box.diagonal_mm * view.direction
        (start, end), _ = drawing.eye.project(np.stack([view.position_mm, tip]))
        axes.annotate(
            "",
            xy=end,
            xytext=start,
            arrowprops={"arrowstyle": "-|>", "lw": 2.0, "color": _VIEW},
        )
        axes.plot(*start, "o", ms=7, color=_VIEW, mec="white")
        axes.annotate(
            view.label,
            xy=start,
            xytext=(8, 8),
            textcoords="offset points",
            fontsize=11,
            weight="bold",
            color=_VIEW,
            bbox={"boxstyle": "round,pad=0.2", "fc": "white", "ec": "none"},
        )


def _scale_bar(axes: Axes, drawing: Drawing) -> None:
    columns, rows = drawing.eye.size_px
    span = 0.22 * columns * drawing.eye.mm_per_px
    decade = 10.0 ** np.floor(np.log10(span))
    length = decade * max(n for n in (1, 2, 5) if n * decade <= span)
    end = 18 + length / drawing.eye.mm_per_px
    axes.plot([18, end], [rows - 18] * 2, color="#1d2530", lw=2)
    axes.text((18 + end) / 2, rows - 26, f"{length:g} mm", ha="center", fontsize=10)
