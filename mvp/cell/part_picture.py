"""A labelled picture of a part: four shaded views, hidden lines left out.

Surfaces and lines are cut by rays through the same mesh, so that what is drawn is what
is there; each feature is labelled in the view that shows most of it.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mvp.cell.durable import write_durably
from mvp.cell.label_layout import Label, placed
from mvp.cell.part_rays import Drawing, PartRays
from mvp.scene import CadEdges, cad_edges

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from mvp.geometry import FloatArray
    from mvp.scene import Entry, FeatureCatalogue

_VIEWS = (
    ("from above, front right", (1.0, -1.25, 1.0)),
    ("from above, back left", (-1.0, 1.25, 1.0)),
    ("from below, front left", (-1.0, -1.25, -1.0)),
    ("from below, back right", (1.0, 1.25, -1.0)),
)
_COLOURS = {"edge": "#0b5cad", "hole": "#c2410c", "face": "#15803d"}
_SIZE_INCH = (17.0, 13.6)
_DPI = 120
_ASPECT = 1.3
_COLUMNS = 850
_SAMPLES = 48
_LETTER, _LINE = 0.0165, 0.033


@dataclass(frozen=True, eq=False)
class _Shown:
    """A feature in the view that shows it best: its anchor, or none when hidden."""

    entry: Entry
    view: int
    anchor_mm: FloatArray | None


def draw_part(
    catalogue: FeatureCatalogue, path: Path, *, labels: int = 45, title: str = ""
) -> None:
    """Write a PNG of the part with the names of its largest features.

    Args:
        catalogue: the part and what was found on it.
        path: the file to write, whole or not at all.
        labels: how many features of each kind are named at most.
        title: a line above the views.

    Raises:
        OutputError: the folder or the disk does not take it.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    mesh = catalogue.mesh
    rays = PartRays(mesh)
    drawings = [Drawing.of(mesh, t, np.array(d), _ASPECT) for t, d in _VIEWS]
    shown = _shown(catalogue, rays, drawings, labels)
    figure = Figure(figsize=_SIZE_INCH, dpi=_DPI, layout="constrained")
    FigureCanvasAgg(figure)
    lines, named = cad_edges(mesh), 0
    for number, (axes, drawing) in enumerate(
        zip(figure.subplots(2, 2).flat, drawings, strict=True)
    ):
        _draw_surface(axes, drawing, catalogue, rays)
        _draw_lines(axes, drawing, lines, catalogue, rays)
        mine = [each for each in shown if each.view == number]
        named += _draw_labels(axes, drawing, mine)
    figure.suptitle(_headline(title or mesh.name, catalogue, named), fontsize=14)
    _save(figure, path)


def _headline(title: str, catalogue: FeatureCatalogue, named: int) -> str:
    there = (
        f"{len(catalogue.edges)} edges (E, blue), {len(catalogue.holes)} hole rims "
        f"(H, orange), {len(catalogue.patches)} planar faces (F, green)"
    )
    return f"{title}\n{there}; the {named} largest that can be seen are named"


def _shown(
    catalogue: FeatureCatalogue, rays: PartRays, drawings: list[Drawing], limit: int
) -> list[_Shown]:
    """The largest features of each kind, each with its best view."""
    counts: dict[str, int] = {}
    load = np.zeros(len(drawings))
    found = []
    for entry in catalogue.entries:
        counts[entry.kind] = counts.get(entry.kind, 0) + 1
        if counts[entry.kind] <= limit:
            found.append(_best_view(catalogue, entry, rays, drawings, load))
            load[found[-1].view] += found[-1].anchor_mm is not None
    rank = {"hole": 0, "face": 1, "edge": 2}
    return sorted(found, key=lambda each: rank[each.entry.kind])


def _best_view(
    catalogue: FeatureCatalogue,
    entry: Entry,
    rays: PartRays,
    drawings: list[Drawing],
    load: FloatArray,
) -> _Shown:
    """Of the views that show about as much as the best, the one with fewest labels."""
    points = _probe_points(catalogue, entry)
    lift = 3e-4 * catalogue.mesh.extent_mm
    seen = np.stack([drawing.sees(rays, points, lift_mm=lift) for drawing in drawings])
    if entry.kind != "edge":
        towards = np.stack([drawing.axes[2] for drawing in drawings])
        seen &= (towards @ entry.direction > 0.05)[:, None]
    share = seen.mean(axis=1)
    good = (share > 0) & (share >= 0.9 * share.max())
    if not good.any():
        return _Shown(entry, 0, None)
    view = int(np.argmin(np.where(good, load, np.inf)))
    return _Shown(entry, view, _anchor(entry, points[seen[view]]))


def _probe_points(catalogue: FeatureCatalogue, entry: Entry) -> FloatArray:
    """Points (n, 3) spread over a feature."""
    number = int(entry.id[1:]) - 1
    if entry.kind == "edge":
        start, end = catalogue.edges.start_mm[number], catalogue.edges.end_mm[number]
        share = np.linspace(0.02, 0.98, _SAMPLES)[:, None]
        return np.asarray(start + share * (end - start))
    if entry.kind == "hole":
        return catalogue.holes[number].circle_mm(_SAMPLES)
    corners = catalogue.mesh.triangles_mm[catalogue.patches[number]]
    mix = np.array([[1, 1, 1], [4, 1, 1], [1, 4, 1], [1, 1, 4]], dtype=np.float64)
    mix = mix / mix.sum(axis=1, keepdims=True)
    points = np.einsum("pk,nkc->npc", mix, corners).reshape(-1, 3)
    areas = np.repeat(catalogue.mesh.areas_mm2[catalogue.patches[number]], 4)
    order = np.argsort(-areas, kind="stable")[: 16 * _SAMPLES]
    return np.asarray(points[order])


def _anchor(entry: Entry, seen: FloatArray) -> FloatArray:
    """The visible point that the label points at: near the middle of what is seen."""
    middle = entry.position_mm if entry.kind == "face" else np.median(seen, axis=0)
    nearest = int(np.argmin(np.linalg.norm(seen - middle, axis=1)))
    return np.asarray(seen[nearest])


def _draw_surface(
    axes: Axes, drawing: Drawing, catalogue: FeatureCatalogue, rays: PartRays
) -> None:
    grey = drawing.shaded(rays, catalogue.mesh, _COLUMNS)
    x, y = drawing.half_mm
    axes.imshow(
        np.ma.masked_invalid(grey),
        cmap="gray",
        vmin=0.0,
        vmax=1.0,
        extent=(-x, x, -y, y),
        interpolation="antialiased",
    )
    axes.set_title(drawing.title, fontsize=11, color="#444444")
    axes.set_axis_off()


def _draw_lines(
    axes: Axes,
    drawing: Drawing,
    lines: CadEdges,
    catalogue: FeatureCatalogue,
    rays: PartRays,
) -> None:
    """All sharp edges thin, listed edges blue, rims orange, where they can be seen."""
    groups = [
        (np.stack([lines.start_mm, lines.end_mm], axis=1), "#333333", 0.6),
        (
            np.stack([catalogue.edges.start_mm, catalogue.edges.end_mm], axis=1),
            _COLOURS["edge"],
            1.1,
        ),
    ]
    rims = [hole.circle_mm(_SAMPLES) for hole in catalogue.holes]
    if rims:
        sides = [np.stack([r, np.roll(r, -1, axis=0)], axis=1) for r in rims]
        groups.append((np.concatenate(sides), _COLOURS["hole"], 1.4))
    for segments, colour, width in groups:
        _draw_segments(axes, drawing, rays, segments, colour, width, catalogue)


def _draw_segments(
    axes: Axes,
    drawing: Drawing,
    rays: PartRays,
    segments: FloatArray,
    colour: str,
    width: float,
    catalogue: FeatureCatalogue,
) -> None:
    """The visible parts of segments (n, 2, 3)."""
    from matplotlib.collections import LineCollection

    pieces = _cut(segments, float(drawing.half_mm.max()) / 40)
    lift = 3e-4 * catalogue.mesh.extent_mm
    seen = drawing.sees(rays, pieces.mean(axis=1), lift_mm=lift)
    flat = drawing.flat(pieces[seen])
    axes.add_collection(
        LineCollection(list(flat), colors=colour, linewidths=width, capstyle="round")
    )


def _cut(segments: FloatArray, step_mm: float) -> FloatArray:
    """Segments (n, 2, 3) in equal pieces (m, 2, 3), none longer than the step."""
    along = segments[:, 1] - segments[:, 0]
    counts = np.ceil(np.linalg.norm(along, axis=1) / step_mm).astype(np.int64)
    counts = np.maximum(counts, 1)
    row = np.repeat(np.arange(len(segments)), counts)
    place = np.arange(len(row)) - np.repeat(np.cumsum(counts) - counts, counts)
    share = np.stack([place, place + 1], axis=1) / counts[row, None]
    return np.asarray(segments[row, :1] + share[..., None] * along[row, None])


def _draw_labels(axes: Axes, drawing: Drawing, shown: list[_Shown]) -> int:
    """Name what fits; returns how many labels found room."""
    labels = [
        Label(each.entry.id, drawing.flat(each.anchor_mm), _COLOURS[each.entry.kind])
        for each in shown
        if each.anchor_mm is not None
    ]
    centres = placed(
        labels,
        width_per_letter=_LETTER * 2 * drawing.half_mm[1],
        height=_LINE * 2 * drawing.half_mm[1],
        low=-drawing.half_mm,
        high=drawing.half_mm,
    )
    for label, centre in zip(labels, centres, strict=True):
        if centre is None:
            continue
        axes.plot(
            [label.anchor[0], centre[0]],
            [label.anchor[1], centre[1]],
            color=label.colour,
            linewidth=0.7,
            zorder=4,
        )
        axes.plot(*label.anchor, ".", color=label.colour, markersize=4, zorder=5)
        axes.text(
            float(centre[0]),
            float(centre[1]),
            label.text,
            color="white",
            fontsize=8.5,
            ha="center",
            va="center",
            zorder=6,
            bbox={
                "boxstyle": "round,pad=0.18",
                "facecolor": label.colour,
                "edgecolor": "none",
            },
        )
    return sum(centre is not None for centre in centres)


def _save(figure: Figure, path: Path) -> None:
    content = io.BytesIO()
    figure.savefig(content, format="png")
    write_durably(path, content.getvalue())
