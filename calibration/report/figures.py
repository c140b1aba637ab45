"""The flat figures of a calibration report."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.patches import Rectangle, Wedge
from scipy.interpolate import PchipInterpolator

from calibration.report.canvas import (
    AXIS_COLOURS,
    BAND,
    BLUE,
    GREEN,
    HEAT,
    INK,
    LINE,
    RED,
    SOFT,
    as_svg,
    new_figure,
    plain,
)
from calibration.report.plots import GRID_COLUMNS, GRID_ROWS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from calibration.report.canvas import Drawn
    from calibration.report.plots import (
        Coverage,
        LensCurve,
        NodeErrors,
        ResidualField,
        Slack,
        Tilts,
        WorkMap,
    )
    from mvp.geometry import FloatArray, IntArray

_WIDE_IN, _NARROW_IN = 9.0, 4.6
_ARROW_SHARE = 0.05
_MOST_ARROWS = 1500
_NAMED = 40


def residual_field(plot: ResidualField) -> Drawn:
    """Arrows and heat map side by side."""
    width, height = plot.size_px
    figure = new_figure(_WIDE_IN, 0.43 * _WIDE_IN * height / width + 0.75)
    left, right = figure.subplots(1, 2)
    size = np.linalg.norm(plot.errors_px, axis=1)
    typical = max(float(np.sqrt((size**2).mean())), 1e-9)
    scale = _ARROW_SHARE * width / typical
    chosen = _thinned(len(size))
    arrows = left.quiver(
        *plot.pixels[chosen].T,
        *(scale * plot.errors_px[chosen]).T,
        size[chosen],
        angles="xy",
        scale_units="xy",
        scale=1,
        cmap="viridis",
        width=0.0022,
        clim=(0, float(np.percentile(size, 98))),
    )
    left.quiverkey(
        arrows, 0.86, 1.045, _ARROW_SHARE * width, f"{typical:.2g} px", labelpos="E",
        coordinates="axes", color=INK, fontproperties={"size": 8},
    )  # fmt: skip
    _picture_frame(left, plot.size_px)
    plain(left, x="column, px", y="row, px", title=f"arrows {scale:.0f} times enlarged")
    _heat(right, plot)
    return as_svg(figure, f"{plot.title}: typical length {typical:.3g} px")


def _thinned(count: int) -> IntArray:
    """All rows, or an even choice of so many that the page stays light."""
    if count <= _MOST_ARROWS:
        return np.arange(count)
    return np.linspace(0, count - 1, _MOST_ARROWS).astype(np.int64)


def _heat(axes: Axes, plot: ResidualField) -> None:
    width, height = plot.size_px
    squares = _by_field(plot, (plot.errors_px**2).sum(axis=1) / 2)
    rms = np.sqrt(squares)
    image = axes.imshow(
        rms,
        extent=(-0.5, width - 0.5, height - 0.5, -0.5),
        cmap=HEAT,
        vmin=0,
        vmax=max(float(np.nanmax(rms)), 1e-9),
        aspect="equal",
    )
    means = np.stack([_by_field(plot, plot.errors_px[:, k]) for k in (0, 1)], axis=-1)
    longest = max(float(np.nanmax(np.linalg.norm(means, axis=-1))), 1e-9)
    x = (np.arange(GRID_COLUMNS) + 0.5) * width / GRID_COLUMNS - 0.5
    y = (np.arange(GRID_ROWS) + 0.5) * height / GRID_ROWS - 0.5
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    vectors = means.reshape(-1, 2) * 0.45 * width / GRID_COLUMNS / longest
    there = np.isfinite(vectors).all(axis=1)
    axes.quiver(
        *places[there].T, *vectors[there].T, angles="xy", scale_units="xy", scale=1,
        color=INK, width=0.004,
    )  # fmt: skip
    bar = axes.figure.colorbar(image, ax=axes, shrink=0.8)
    bar.ax.tick_params(labelsize=8, colors=SOFT)
    title = f"px by field; longest mean arrow {longest:.2g} px"
    plain(axes, x="column, px", title=title)


def _by_field(plot: ResidualField, values: FloatArray) -> FloatArray:
    """Mean of values (m,) in each field; nan where there is no point."""
    width, height = plot.size_px
    column = np.clip((plot.pixels[:, 0] + 0.5) * GRID_COLUMNS / width, 0, None)
    row = np.clip((plot.pixels[:, 1] + 0.5) * GRID_ROWS / height, 0, None)
    column = np.minimum(column.astype(np.int64), GRID_COLUMNS - 1)
    row = np.minimum(row.astype(np.int64), GRID_ROWS - 1)
    index, count = row * GRID_COLUMNS + column, GRID_ROWS * GRID_COLUMNS
    number = np.bincount(index, minlength=count)
    total = np.bincount(index, values, minlength=count)
    mean = np.where(number > 0, total / np.maximum(number, 1), np.nan)
    return np.asarray(mean.reshape(GRID_ROWS, GRID_COLUMNS))


def coverage(plot: Coverage) -> Drawn:
    """Counts, with the border ring marked."""
    width, height = plot.size_px
    figure = new_figure(_NARROW_IN, _NARROW_IN * height / width + 0.5)
    axes = figure.subplots()
    axes.imshow(
        np.where(plot.counts > 0, plot.counts, np.nan),
        extent=(-0.5, GRID_COLUMNS - 0.5, GRID_ROWS - 0.5, -0.5),
        cmap="Greens",
        vmin=0,
        vmax=max(1.3 * float(plot.counts.max()), 1.0),
        aspect=(height / GRID_ROWS) / (width / GRID_COLUMNS),
    )
    for (row, column), count in np.ndenumerate(plot.counts):
        colour = RED if count == 0 else INK
        axes.text(
            column, row, str(count), ha="center", va="center", fontsize=8, color=colour
        )
    ring = Rectangle(
        (0.5, 0.5), GRID_COLUMNS - 2, GRID_ROWS - 2, fill=False, ec=INK, ls="--", lw=0.8
    )
    axes.add_patch(ring)
    plain(axes)
    axes.set_xticks([])
    axes.set_yticks([])
    empty = int((plot.counts == 0).sum())
    return as_svg(figure, f"{plot.title}: {empty} of {plot.counts.size} fields empty")


def tilts(plot: Tilts) -> Drawn:
    """Tilt about both axes, with rings."""
    figure = new_figure(_NARROW_IN, _NARROW_IN)
    axes = figure.subplots()
    reach = max(50.0, float(np.abs([plot.about_x_deg, plot.about_y_deg]).max()) + 5)
    axes.add_patch(Wedge((0, 0), 45, 0, 360, width=20, color=GREEN, alpha=0.12, lw=0))
    for ring in (10, 20):
        axes.add_patch(Wedge((0, 0), ring, 0, 360, fill=False, ec=LINE))
        axes.text(
            0, ring, f"{ring} deg", fontsize=7, color=SOFT, ha="center", va="bottom"
        )
    axes.scatter(plot.about_x_deg, plot.about_y_deg, s=22, color=BLUE, zorder=3)
    axes.set_xlim(-reach, reach)
    axes.set_ylim(-reach, reach)
    axes.set_aspect("equal")
    axes.axhline(0, color=LINE, lw=0.6)
    axes.axvline(0, color=LINE, lw=0.6)
    plain(axes, x="about x, deg", y="about y, deg")
    largest = float(np.hypot(plot.about_x_deg, plot.about_y_deg).max())
    return as_svg(figure, f"{plot.title}: up to {largest:.0f} deg")


def work_map(plot: WorkMap) -> Drawn:
    """Isolines of one sigma on the work."""
    x, y = plot.pixels[..., 0], plot.pixels[..., 1]
    width, height = float(x.max()), float(y.max())
    figure = new_figure(_NARROW_IN, 0.68 * _NARROW_IN * height / width + 0.6)
    axes = figure.subplots()
    top = max(float(plot.sigma_mm.max()), 1e-12)
    levels = np.linspace(0, top, 9)
    filled = axes.contourf(x, y, plot.sigma_mm, levels=levels, cmap=HEAT)
    bar = figure.colorbar(filled, ax=axes, format="%.2g")
    bar.set_label("mm", fontsize=8, color=SOFT)
    bar.ax.tick_params(labelsize=8, colors=SOFT)
    _picture_frame(axes, (int(width) + 1, int(height) + 1))
    plain(axes, x="column, px", y="row, px")
    return as_svg(figure, f"{plot.title}: at most {top:.3g} mm")


def slack(plot: Slack) -> Drawn:
    """Position and angle of every view, three axes each."""
    figure = new_figure(_WIDE_IN, 4.6)
    upper, lower = figure.subplots(2, 1, sharex=True)
    _slack_panel(upper, plot.position_mm, plot.stated[0], plot.found[0])
    plain(upper, y="position, mm")
    _slack_panel(lower, plot.angle_deg, plot.stated[1], plot.found[1])
    plain(lower, y="angle, deg")
    upper.legend(
        ["x", "y", "z"], fontsize=8, ncols=3, loc="lower right",
        bbox_to_anchor=(1, 1), frameon=False,
    )  # fmt: skip
    _name_ticks(lower, plot.names)
    largest = float(np.linalg.norm(plot.position_mm, axis=1).max(initial=0.0))
    return as_svg(figure, f"{plot.title}: up to {largest:.3g} mm")


def _slack_panel(axes: Axes, values: FloatArray, stated: float, found: float) -> None:
    views = np.arange(len(values))
    for axis, colour in enumerate(AXIS_COLOURS):
        axes.plot(views + 0.16 * (axis - 1), values[:, axis], "o", ms=3.6, color=colour)
    axes.axhspan(-2 * stated, 2 * stated, color=BAND, zorder=0)
    for side in (-2 * found, 2 * found):
        axes.axhline(side, color=SOFT, lw=0.8, ls="--", zorder=0)
    axes.axhline(0, color=LINE, lw=0.8, zorder=1)
    for view in views[:-1]:
        axes.axvline(view + 0.5, color=LINE, lw=0.4, zorder=0)
    axes.set_xlim(-0.6, len(values) - 0.4)
    reach = 1.15 * max(float(np.abs(values).max(initial=0.0)), 2 * stated, 2 * found)
    axes.set_ylim(-reach, reach)


def lens_curve(plot: LensCurve) -> Drawn:
    """The table with its nodes, and left-out errors below."""
    figure = new_figure(_NARROW_IN, 3.9)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[2, 1])
    upper.plot(*_followed(plot), "-", color=BLUE, lw=1.4)
    upper.errorbar(
        plot.steps, plot.values_mm, 2 * plot.sigma_mm, fmt="o", ms=4, color=INK,
        elinewidth=1, capsize=2,
    )  # fmt: skip
    plain(upper, y=f"{plot.symbol}, mm")
    lower.axhline(0, color=LINE, lw=0.8)
    if len(plot.left_out_mm):
        lower.errorbar(
            plot.steps[1:-1], 1000 * plot.left_out_mm, 2000 * plot.left_out_sigma_mm,
            fmt="o", ms=3.5, color=INK, elinewidth=1, capsize=2,
        )  # fmt: skip
    else:
        lower.text(
            0.5, 0.5, "no inner node to leave out", transform=lower.transAxes,
            ha="center", va="center", fontsize=8, color=SOFT,
        )  # fmt: skip
    plain(lower, x=f"{plot.axis}, steps", y="left out, um")
    return as_svg(figure, f"{plot.title}: {len(plot.steps)} nodes")


def _followed(plot: LensCurve) -> tuple[FloatArray, FloatArray]:
    """The monotone cubic through the table, as the planner follows it."""
    if len(plot.table_steps) < 2:
        return plot.table_steps.astype(np.float64), plot.table_mm
    steps = np.linspace(plot.table_steps[0], plot.table_steps[-1], 200)
    return steps, np.asarray(PchipInterpolator(plot.table_steps, plot.table_mm)(steps))


def node_errors(plot: NodeErrors) -> Drawn:
    """Measured less fitted at every node."""
    figure = new_figure(_WIDE_IN, 3.2)
    axes = figure.subplots()
    index = np.arange(len(plot.names))
    axes.axhline(0, color=LINE, lw=0.8)
    axes.errorbar(
        index, plot.off_um, 2 * plot.sigma_um, fmt="o", ms=3.5, color=INK,
        ecolor=SOFT, elinewidth=0.9, capsize=1.5,
    )  # fmt: skip
    axes.set_xlim(-0.8, len(plot.names) - 0.2)
    plain(axes, y="measured less fitted, um")
    _name_ticks(axes, plot.names)
    worst = float(np.abs(plot.off_um).max(initial=0.0))
    return as_svg(figure, f"{plot.title}: up to {worst:.2g} um")


def _name_ticks(axes: Axes, names: tuple[str, ...]) -> None:
    """Upright names below; of very many every second, third, ... one."""
    every = -(-len(names) // _NAMED)
    axes.set_xticks(np.arange(0, len(names), every))
    labels = [_literal(name) for name in names[::every]]
    axes.set_xticklabels(labels, rotation=60, ha="right", fontsize=7)


def _literal(name: str) -> str:
    """A name as it is, not as a formula."""
    short = name if len(name) <= 18 else name[:8] + "…" + name[-9:]
    return short.replace("$", r"\$")


def _picture_frame(axes: Axes, size_px: tuple[int, int]) -> None:
    axes.set_xlim(-0.5, size_px[0] - 0.5)
    axes.set_ylim(size_px[1] - 0.5, -0.5)
    axes.set_aspect("equal")
