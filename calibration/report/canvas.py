"""Figures without any display, as pictures that a page can embed."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from io import BytesIO
from typing import TYPE_CHECKING

import matplotlib as mpl
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

INK, SOFT, LINE = "#1d2530", "#5b6675", "#d8dde4"
BLUE, ORANGE, GREEN, RED, BAND = "#1f6fd6", "#e8730c", "#1a7f4b", "#b3261e", "#e6eaf0"
AXIS_COLOURS = ("#b3261e", "#1a7f4b", "#1f6fd6")
HEAT = "YlOrRd"
_FONT_PT = 9


@dataclass(frozen=True)
class Drawn:
    """A picture as text that a page can embed, and what stands for it."""

    uri: str
    alt: str


def new_figure(width_in: float, height_in: float, *, packed: bool = True) -> Figure:
    """An empty figure of a size on paper; belongs to no window.

    Args:
        width_in: inches.
        height_in: inches.
        packed: panels and labels find their room by themselves.
    """
    figure = Figure(
        figsize=(width_in, height_in), layout="constrained" if packed else None
    )
    FigureCanvasSVG(figure)
    return figure


def plain(axes: Axes, *, x: str = "", y: str = "", title: str = "") -> None:
    """Labels and the house's looks."""
    axes.set_xlabel(x, fontsize=_FONT_PT, color=SOFT)
    axes.set_ylabel(y, fontsize=_FONT_PT, color=SOFT)
    if title:
        axes.set_title(title, fontsize=_FONT_PT + 1, color=INK, loc="left")
    axes.tick_params(labelsize=_FONT_PT - 1, colors=SOFT, length=3)
    for side in axes.spines.values():
        side.set_color(LINE)


def as_svg(figure: Figure, alt: str) -> Drawn:
    """The figure as an SVG picture; the same bytes for the same numbers."""
    content = BytesIO()
    with mpl.rc_context({"svg.hashsalt": "mvp-cell"}):
        figure.savefig(content, format="svg", metadata={"Date": None})
    text = base64.b64encode(content.getvalue()).decode()
    return Drawn(f"data:image/svg+xml;base64,{text}", alt)


def as_jpeg(content: bytes, alt: str) -> Drawn:
    """The bytes of a JPEG file."""
    return Drawn("data:image/jpeg;base64," + base64.b64encode(content).decode(), alt)
