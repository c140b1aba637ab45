"""``mvp-cell features PART``: what is on a part, with ids for a task."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from mvp.cli.options import JsonOption

if TYPE_CHECKING:
    from rich.console import Console

    from mvp.geometry import LoadedPart
    from mvp.scene import Entry, FeatureCatalogue

_TITLES = {
    "edge": ("straight edges", "length, mm", "middle, mm"),
    "hole": (
        "rims of round holes (note: depth, error of the rim polygon, mm)",
        "diameter, mm",
        "centre, mm",
    ),
    "face": ("planar faces", "area, mm²", "centroid, mm"),
}


def features(
    part: Annotated[
        Path, typer.Argument(metavar="PART", help="a STEP, STL, OBJ, PLY or GLB file")
    ],
    units: Annotated[
        Literal["mm", "in", "m"] | None,
        typer.Option(
            "--units", help="of the numbers in the file, when it does not say"
        ),
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option("--picture", metavar="FILE.png", help="a labelled picture"),
    ] = None,
    every: Annotated[
        bool, typer.Option("--all", help="list everything, not only the largest")
    ] = False,
    as_json: JsonOption = False,
) -> int:
    """List edges, holes and faces of a CAD file, with their ids."""
    from mvp.cell.features_document import features_document
    from mvp.cli.output import console, print_model
    from mvp.geometry import load_part
    from mvp.scene import extract_features

    if picture is not None:
        _check_picture(picture)
    loaded = load_part(part, units=units)
    catalogue = extract_features(loaded.mesh)
    lines = console()
    _tell(lines, loaded, catalogue, limit=None if every else 20)
    if picture is not None:
        from mvp.cell.part_picture import draw_part

        draw_part(catalogue, picture, title=f"{part.name}: {loaded.size_text}")
        lines.print(f"picture: {picture}", markup=False)
    if as_json:
        print_model(features_document(loaded, catalogue))
    return 0


def _check_picture(path: Path) -> None:
    """Refuse at once what could not be written after the work."""
    from mvp.cell.durable import check_file_writable
    from mvp.errors import UsageError

    if path.suffix.lower() != ".png":
        raise UsageError(
            f"{path}: a picture is a PNG file, not {path.suffix or 'a nameless kind'!r}",
            hint=f"name it {path.with_suffix('.png')}",
            where="--picture",
        )
    check_file_writable(path, needed_bytes=1_000_000)


def _tell(
    lines: Console, part: LoadedPart, catalogue: FeatureCatalogue, *, limit: int | None
) -> None:
    lines.print(part.path.name, style="bold", markup=False)
    for line in part.lines()[: len(part.lines()) - len(part.warnings)]:
        lines.print(f"  {line}", markup=False)
    for warning in part.warnings:
        lines.print(f"  warning: {warning}", style="yellow", markup=False)
    for kind in _TITLES:
        _table(lines, [e for e in catalogue.entries if e.kind == kind], limit)
    if not catalogue.entries:
        lines.print(
            "this part has no straight sharp edge, round hole or planar face",
            markup=False,
        )
        return
    lines.print(
        'use an id in a task:  [[features]]  id = "my edge"  ref = "E1"', markup=False
    )


def _table(lines: Console, entries: list[Entry], limit: int | None) -> None:
    """The largest entries of one kind."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    if not entries:
        return
    title, size, place = _TITLES[entries[0].kind]
    shown = entries[:limit]
    more = f", the largest {len(shown)} (--all for every one)"
    table = Table(
        title=f"{len(entries)} {title}{more * (len(shown) < len(entries))}",
        title_justify="left",
        box=SIMPLE_HEAD,
        pad_edge=False,
    )
    table.add_column("id", style="bold", no_wrap=True)
    for heading in (size, place, "direction"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("note")
    for entry in shown:
        table.add_row(
            entry.id,
            f"{entry.size:.3f}",
            " ".join(f"{value + 0.0:.2f}" for value in entry.position_mm.round(2)),
            _direction_text(entry.direction.tolist()),
            entry.note,
        )
    lines.print(table)


def _direction_text(direction: list[float]) -> str:
    """``+z`` along an axis, otherwise three numbers."""
    largest = max(range(3), key=lambda axis: abs(direction[axis]))
    if abs(direction[largest]) > 1 - 1e-6:
        return ("+" if direction[largest] > 0 else "-") + "xyz"[largest]
    return " ".join(f"{round(value, 2) + 0.0:.2f}" for value in direction)
