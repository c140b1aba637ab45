"""Render the page; everything that is text is escaped, nothing is fetched."""

from __future__ import annotations

from dataclasses import dataclass
from functools import singledispatch
from importlib.resources import files
from typing import TYPE_CHECKING, TypeAlias
from urllib.parse import quote

import jinja2
from markupsafe import Markup

from calibration.report import figures
from calibration.report.model import TITLES
from calibration.report.numbers import sigma_text, value_text
from calibration.report.plots import (
    Coverage,
    ErrorBudget,
    LensCurve,
    NodeErrors,
    ResidualField,
    Scene,
    Slack,
    Tilts,
    ViewBars,
    WorkMap,
)
from calibration.report.scene import scene
from calibration.report.thumbnails import thumbnail
from mvp.cell.durable import write_durably

if TYPE_CHECKING:
    from pathlib import Path

    from calibration.report.canvas import Drawn
    from calibration.report.model import Photo, ReportData
    from calibration.report.plots import Plot
    from calibration.wizard.comparison import Comparison

Context: TypeAlias = "dict[str, object]"

FILE_NAME = "report.html"
_GRADES = {
    "go": ("GO", "pass", "Use it."),
    "marginal": ("MARGINAL", "unsure", "Usable with care: read the causes."),
    "no-go": ("NO-GO", "fail", "Do not use it."),
}
_PILLS = {"go": "remark", "marginal": "marginal", "no-go": "no-go"}
_WIDE = (ResidualField, Slack, Scene, NodeErrors, ViewBars, ErrorBudget)


@dataclass(frozen=True)
class _Bar:
    name: str
    anchor: str
    percent: float
    level: str
    text: str
    note: str = ""


def write_report(folder: Path, data: ReportData) -> Path:
    """Write ``report.html`` into a folder and return its path.

    Raises:
        OutputError: the folder cannot take the file.
    """
    target = folder / FILE_NAME
    write_durably(target, render_report(data).encode("utf-8"))
    return target


def render_report(data: ReportData) -> str:
    """The page as text."""
    here = files("calibration.report")
    environment = jinja2.Environment(
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    template = environment.from_string(
        here.joinpath("template.html.j2").read_text(encoding="utf-8")
    )
    style = here.joinpath("style.css").read_text(encoding="utf-8")
    return template.render(page=_page(data), style=Markup(style))


def _page(data: ReportData) -> Context:
    word, grade_class, meaning = _GRADES[data.verdict.grade]
    about = data.about
    anchors: dict[str, str] = {}
    for index, photo in enumerate(about.photos):
        anchors.setdefault(photo.name, f"picture-{index}")
    return {
        "title": TITLES[data.kind],
        "word": word,
        "grade_class": grade_class,
        "meaning": meaning,
        "headline": data.headline,
        "subject": about.subject,
        "simulated": about.simulated,
        "next_action": data.verdict.next_action,
        "causes": [
            {
                "grade": _PILLS[cause.grade],
                "grade_class": _GRADES[cause.grade][1],
                "message": cause.message,
                "action": cause.action,
                "code": cause.code,
            }
            for cause in data.verdict.ordered
        ],
        "facts": about.facts,
        "quantities": [
            (q.name, value_text(q.value, q.sigma), sigma_text(q.sigma), q.unit, q.note)
            for q in data.quantities
        ],
        "notes": data.notes,
        "comparison": _comparison(about.comparison),
        "plots": [_plot(plot, anchors) for plot in data.plots],
        "tables": data.tables,
        "photos": [
            _photo(photo, f"picture-{i}") for i, photo in enumerate(about.photos)
        ],
        "left_out": about.left_out,
        "provenance": about.provenance,
    }


def _comparison(found: Comparison | None) -> Context | None:
    if found is None:
        return None
    return {
        "words": found.words,
        "alarm": found.alarm,
        "remarks": found.remarks,
        "previous_date": found.previous_date,
        "rows": [
            (
                one.name,
                value_text(one.change, one.sigma),
                sigma_text(one.sigma),
                one.unit,
                "–" if one.sigmas is None else f"{one.sigmas:.1f}",
            )
            for one in found.differences
        ],
    }


def _photo(photo: Photo, anchor: str) -> Context:
    return {
        "name": photo.name,
        "anchor": anchor,
        "svg": thumbnail(photo),
        "link": quote(photo.link.replace("\\", "/")),
    }


def _plot(plot: Plot, anchors: dict[str, str]) -> Context:
    bars: list[_Bar] = []
    tick = 0.0
    drawn = None
    if isinstance(plot, ViewBars):
        bars, tick = _view_bars(plot, anchors)
    elif isinstance(plot, ErrorBudget):
        bars = _budget_bars(plot)
    else:
        drawn = _drawn(plot)
    return {
        "title": plot.title,
        "wide": isinstance(plot, _WIDE),
        "drawn": drawn,
        "bars": bars,
        "tick": tick,
        "how_to_read": plot.how_to_read,
        "good": plot.good,
        "lead": _lead(plot),
    }


def _lead(plot: Plot) -> str:
    if not isinstance(plot, ErrorBudget):
        return ""
    return (
        f"Of {plot.what}, at {plot.distance_mm:.0f} mm: {plot.total_mm:.2g} mm one sigma, "
        f"{1.96 * plot.total_mm:.2g} mm (95 %)."
    )


def _view_bars(plot: ViewBars, anchors: dict[str, str]) -> tuple[list[_Bar], float]:
    full = 1.05 * max(float(plot.values.max(initial=0.0)), plot.bound, 1e-12)
    bars = [
        _Bar(
            name,
            anchors.get(name, ""),
            100 * float(value) / full,
            "broken" if outlying else "",
            f"{value:.3g} {plot.unit}",
        )
        for name, value, outlying in zip(
            plot.names, plot.values, plot.outlying, strict=True
        )
    ]
    return bars, 100 * plot.bound / full


def _budget_bars(plot: ErrorBudget) -> list[_Bar]:
    full = 1.05 * max(plot.total_mm, 1e-12)
    bars = [
        _Bar(
            part.name,
            "",
            100 * part.sigma_mm / full,
            "plain",
            f"{part.sigma_mm:.3g} mm",
            part.source,
        )
        for part in plot.parts
    ]
    total = f"{plot.total_mm:.3g} mm"
    return [*bars, _Bar("together", "", 100 * plot.total_mm / full, "", total)]


@singledispatch
def _drawn(plot: object) -> Drawn:
    raise TypeError(f"no figure for {type(plot).__name__}")


_drawn.register(ResidualField, figures.residual_field)
_drawn.register(Coverage, figures.coverage)
_drawn.register(Tilts, figures.tilts)
_drawn.register(WorkMap, figures.work_map)
_drawn.register(Slack, figures.slack)
_drawn.register(LensCurve, figures.lens_curve)
_drawn.register(NodeErrors, figures.node_errors)
_drawn.register(Scene, scene)
