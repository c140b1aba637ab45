"""Render ``report.html`` from what a run folder holds."""

from __future__ import annotations

from dataclasses import asdict
from importlib.resources import files
from typing import TYPE_CHECKING

import jinja2
from markupsafe import Markup

from mvp.cell.durable import write_durably
from mvp.cell.report.overlay import close_up, data_uri, whole_picture
from mvp.cell.report.page import page_of
from mvp.cell.run_folder import RunFolder, decode_png

if TYPE_CHECKING:
    from pathlib import Path

    from mvp.cell.report.page import Page, ViewSection


def write_report(folder: Path) -> Path:
    """Write ``report.html`` into a run folder and return its path.

    Nothing is fetched from anywhere: style, pictures and overlays are inside the file.

    Raises:
        RecordError: plan, result or a picture is missing or damaged.
        OutputError: the folder cannot take the file.
    """
    run_folder = RunFolder(folder)
    page = page_of(run_folder.read_plan(), run_folder.read_document())
    target = folder / "report.html"
    write_durably(target, _render(page, run_folder).encode())
    return target


def _render(page: Page, folder: RunFolder) -> str:
    here = files("mvp.cell.report")
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True
    )
    template = environment.from_string(
        here.joinpath("template.html.j2").read_text(encoding="utf-8")
    )
    style = here.joinpath("style.css").read_text(encoding="utf-8")
    context = {name: getattr(page, name) for name in page.__dataclass_fields__}
    context["warn_percent"] = page.warn_percent
    context["views"] = [_view_context(view, folder) for view in page.views]
    context["scene_pictures"] = _scene_pictures(page, folder)
    return template.render(page=context, style=Markup(style))


def _view_context(view: ViewSection, folder: RunFolder) -> dict[str, object]:
    context: dict[str, object] = {
        name: getattr(view, name) for name in view.__dataclass_fields__
    }
    context["margins"] = [asdict(margin) for margin in view.margins]
    measured = view.measured
    context["measurement_heads"] = measured.heads
    context["measurements"] = measured.rows
    context["measurement_notes"] = measured.notes
    picture = folder.images / f"{view.id}.png"
    context["captured"], context["details"] = None, []
    if picture.is_file():
        pixels = decode_png(picture.read_bytes())
        size = (pixels.shape[1], pixels.shape[0])
        name = f"picture-{view.id}"
        lines = [line for shown in measured.shown for line in shown.lines]
        context["captured"] = whole_picture(name, data_uri(picture), size, lines)
        context["details"] = [
            {"svg": close_up(name, shown.lines, size), "caption": shown.caption}
            for shown in measured.shown
        ]
    simulated = folder.figures / f"{view.id}_simulated.png"
    context["simulated_picture"] = data_uri(simulated) if simulated.is_file() else None
    return context


def _scene_pictures(page: Page, folder: RunFolder) -> list[dict[str, str]]:
    captions = {"scene.png": "The part, its features (red) and the planned viewpoints."}
    for view in page.views:
        captions[f"region_{view.id}.png"] = (
            f"{view.id}: the region from which every feature of the view is seen whole "
            "(blue), and the viewpoint in it."
        )
    return [
        {"data": data_uri(folder.figures / name), "caption": caption}
        for name, caption in captions.items()
        if (folder.figures / name).is_file()
    ]
