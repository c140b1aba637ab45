"""The JSON document of ``mvp-cell features``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from pydantic import Field

from mvp.fileedge import FileModel

if TYPE_CHECKING:
    from mvp.geometry import FloatArray, LoadedPart
    from mvp.scene import Entry, FeatureCatalogue

_Triple = tuple[float, float, float]


class HealingDocument(FileModel):
    """What was found in the mesh and what was done about it."""

    triangles: int
    vertices_merged: int
    degenerate_dropped: int
    duplicates_dropped: int
    faces_flipped: int
    open_edges: int
    non_manifold_edges: int
    bodies: int
    watertight: bool


class PartDocument(FileModel):
    """The file, its size in mm, and where its units come from."""

    file: str
    sha256: str
    units: Literal["mm", "in", "m"]
    units_source: Literal["given", "file", "guessed"]
    low_mm: _Triple
    high_mm: _Triple
    size_mm: _Triple
    healing: HealingDocument
    warnings: list[str]


class EdgeEntry(FileModel):
    """A straight sharp edge; ``faces`` tells on which side the material is."""

    id: str
    kind: Literal["edge"] = "edge"
    length_mm: float
    from_mm: _Triple
    to_mm: _Triple
    faces: Literal["convex", "reflex", "open"]
    note: str


class HoleEntry(FileModel):
    """The rim of a round hole; the axis points out of the part."""

    id: str
    kind: Literal["hole"] = "hole"
    diameter_mm: float
    centre_mm: _Triple
    axis: _Triple
    depth_mm: float
    through: bool
    polygon_error_mm: float
    note: str


class FaceEntry(FileModel):
    """A planar face."""

    id: str
    kind: Literal["face"] = "face"
    area_mm2: float
    centroid_mm: _Triple
    normal: _Triple
    note: str


class FeaturesDocument(FileModel):
    """Everything that a task can name on a part, each kind from large to small."""

    schema_: Literal["mvp-cell/features/1"] = Field(
        default="mvp-cell/features/1", alias="schema"
    )
    part: PartDocument
    edges: list[EdgeEntry]
    holes: list[HoleEntry]
    faces: list[FaceEntry]


def features_document(
    part: LoadedPart, catalogue: FeatureCatalogue
) -> FeaturesDocument:
    """The document of a part and its catalogue."""
    entries = {entry.id: entry for entry in catalogue.entries}
    return FeaturesDocument(
        part=PartDocument.model_validate(part.to_json()),
        edges=[
            _edge(catalogue, number, entries[f"E{number + 1}"])
            for number in range(len(catalogue.edges))
        ],
        holes=[
            HoleEntry(
                id=hole.id,
                diameter_mm=_rounded(hole.diameter_mm),
                centre_mm=_triple(entries[hole.id].position_mm),
                axis=_triple(hole.axis),
                depth_mm=_rounded(hole.depth_mm),
                through=hole.through,
                polygon_error_mm=_rounded(hole.polygon_error_mm),
                note=entries[hole.id].note,
            )
            for hole in catalogue.holes
        ],
        faces=[
            FaceEntry(
                id=entry.id,
                area_mm2=_rounded(entry.size),
                centroid_mm=_triple(entry.position_mm),
                normal=_triple(entry.direction),
                note=entry.note,
            )
            for entry in catalogue.entries
            if entry.kind == "face"
        ],
    )


def _edge(catalogue: FeatureCatalogue, number: int, entry: Entry) -> EdgeEntry:
    edges = catalogue.edges
    shape: Literal["convex", "reflex", "open"] = (
        "convex" if edges.convex[number] else "reflex"
    )
    return EdgeEntry(
        id=entry.id,
        length_mm=_rounded(entry.size),
        from_mm=_triple(edges.start_mm[number]),
        to_mm=_triple(edges.end_mm[number]),
        faces="open" if edges.boundary[number] else shape,
        note=entry.note,
    )


def _rounded(value: float) -> float:
    return round(float(value), 9) + 0.0


def _triple(values: FloatArray) -> _Triple:
    x, y, z = (_rounded(value) for value in values)
    return x, y, z
