"""Cameras, target and robot in space, seen from two sides."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

from calibration.report.canvas import (
    AXIS_COLOURS,
    BLUE,
    GREEN,
    INK,
    ORANGE,
    SOFT,
    as_svg,
    new_figure,
)

if TYPE_CHECKING:
    from calibration.report.canvas import Drawn
    from calibration.report.plots import Scene
    from mvp.geometry import FloatArray

_SIDES = ((22, -60), (12, 25))
_ROLES = {"target": GREEN, "part": GREEN, "robot": SOFT, "axes": INK}
_NAMED = 8
_TICKS = 5
_ZOOM = 0.92


def scene(plot: Scene) -> Drawn:
    """Two views of the same scene, true to scale."""
    figure = new_figure(9.0, 4.6, packed=False)
    points = _everything(plot)
    low, high = points.min(axis=0), points.max(axis=0)
    cameras = float(np.median(plot.cameras[:, 2, 3]))
    upside_down = cameras < float(np.median(points[:, 2]))
    for number, (up, around) in enumerate(_SIDES):
        axes = Axes3D(figure, (0.5 * number, 0.0, 0.48, 1.0))
        figure.add_axes(axes)
        _draw(axes, plot)
        _true_to_scale(axes, low, high, upside_down=upside_down)
        axes.view_init(up, around)
    return as_svg(figure, f"{plot.title}: {len(plot.cameras)} cameras")


def frustums(plot: Scene) -> FloatArray:
    """(n, 5, 3): apex and the four corners of every camera's field of view."""
    x, y = plot.half_angles
    corners = np.array([[0, 0, 0], [-x, -y, 1], [x, -y, 1], [x, y, 1], [-x, y, 1]])
    local = corners * plot.reach_mm
    turned = np.einsum("nij,kj->nki", plot.cameras[:, :3, :3], local)
    return np.asarray(turned + plot.cameras[:, None, :3, 3])


def _everything(plot: Scene) -> FloatArray:
    lines = [line for outline in plot.outlines for line in outline.lines_mm]
    cameras = frustums(plot).reshape(-1, 3)
    return np.concatenate([cameras, *[line.reshape(-1, 3) for line in lines]])


def _draw(axes: Axes3D, plot: Scene) -> None:
    shapes = frustums(plot)
    edges = [shape[[0, corner]] for shape in shapes for corner in (1, 2, 3, 4)] + [
        shape[[1, 2, 3, 4, 1]] for shape in shapes
    ]
    axes.add_collection3d(Line3DCollection(edges, colors=BLUE, lw=0.5, alpha=0.7))
    tops = [shape[[0, 1, 2]] for shape in shapes]
    axes.add_collection3d(Poly3DCollection(tops, color=ORANGE, alpha=0.5, lw=0))
    for outline in plot.outlines:
        colours = AXIS_COLOURS if outline.role == "axes" else _ROLES[outline.role]
        axes.add_collection3d(
            Line3DCollection(list(outline.lines_mm), colors=colours, lw=1.1)
        )
    if len(shapes) <= _NAMED:
        for shape, name in zip(shapes, plot.names, strict=True):
            axes.text(*shape[0], name.replace("$", r"\$")[:14], fontsize=6, color=INK)
    axes.set_xlabel("x", fontsize=8, color=SOFT)
    axes.set_ylabel("y", fontsize=8, color=SOFT)
    axes.set_zlabel("z", fontsize=8, color=SOFT)
    axes.tick_params(labelsize=6, colors=SOFT, pad=0)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_major_locator(MaxNLocator(_TICKS))


def _true_to_scale(
    axes: Axes3D, low: FloatArray, high: FloatArray, *, upside_down: bool
) -> None:
    span = np.maximum(high - low, 0.08 * float((high - low).max()))
    middle = (low + high) / 2
    axes.set_xlim(middle[0] - span[0] / 2, middle[0] + span[0] / 2)
    axes.set_ylim(middle[1] - span[1] / 2, middle[1] + span[1] / 2)
    axes.set_zlim(middle[2] - span[2] / 2, middle[2] + span[2] / 2)
    axes.set_box_aspect(span, zoom=_ZOOM)
    if upside_down:
        axes.invert_yaxis()
        axes.invert_zaxis()
