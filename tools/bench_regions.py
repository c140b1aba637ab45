"""Visibility regions and lines of sight beside their rivals, ratios printed.

Usage: python tools/bench_regions.py [--quick]

``run(quick=...)`` returns the rows, for benchmarks that print several tables.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import manifold3d
import numpy as np
from embreex.mesh_construction import TriangleMesh as EmbreeMesh
from embreex.rtcore_scene import EmbreeScene

from mvp.geometry import (
    Box,
    FeaturePiece,
    FloatArray,
    TriangleMesh,
    edge_table,
    load_part,
)
from mvp.scene import edge_feature, paper_object
from mvp.visibility import (
    exactly_visible,
    line_of_sight,
    prepare,
    visibility_region,
)

if TYPE_CHECKING:
    from collections.abc import Callable

ROOT = Path(__file__).parents[1]
PARTS = (ROOT / "cell_configs", ROOT.parent / "shared" / "data" / "nist_step")


@dataclass(frozen=True)
class Row:
    """One line of the table; a ratio below its target is good.

    Attributes:
        name: what was timed.
        ours_s: our time, s.
        rival_s: the rival's time in the same run, s, or None.
        target: what the ratio (or our time, without a rival) should stay below.
        note: sizes and counts.
    """

    name: str
    ours_s: float
    rival_s: float | None
    target: float
    note: str = ""

    @property
    def ratio(self) -> float | None:
        """Our time over the rival's."""
        return None if self.rival_s is None else self.ours_s / self.rival_s

    @property
    def text(self) -> str:
        """The line as printed."""
        rival = "-" if self.rival_s is None else f"{self.rival_s:.4f} s"
        ratio = "-" if self.ratio is None else f"{self.ratio:.2f}"
        return (
            f"{self.name:<44} ours {self.ours_s:8.4f} s   rival {rival:>10}   "
            f"ratio {ratio:>5}   target {self.target:g}   {self.note}"
        )


def run(quick: bool = False) -> list[Row]:
    """All rows; ``quick`` takes a few seconds."""
    rows = [paper_row(3 if quick else 10), *growth_rows(quick), agreement_row(quick)]
    part = nist_part("nist_ctc_01_asme1_rd.stp")
    if part is not None:
        rows += [edges_row(part, 8 if quick else 30), sight_row(part, quick)]
    return rows


def best_of(repeats: int, *works: Callable[[], object]) -> list[float]:
    """Shortest time of each piece of work, taking turns, s."""
    times = [[] for _ in works]
    for _ in range(repeats):
        for work, taken in zip(works, times, strict=True):
            start = time.perf_counter()
            work()
            taken.append(time.perf_counter() - start)
    return [min(taken) for taken in times]


def paper_row(repeats: int) -> Row:
    """Both edges of the paper's object against one hull per triangle."""
    mesh = paper_object()
    horizontal = edge_feature("horizontal", [-12.7, 0, 12.7], [12.7, 0, 12.7], mesh)
    vertical = edge_feature("vertical", [12.7, 0, -12.7], [12.7, 0, 12.7], mesh)
    pieces = [*horizontal.pieces, *vertical.pieces]
    workspace = Box(np.full(3, -650.0), np.full(3, 650.0))
    ours, rival = best_of(
        repeats,
        lambda: visibility_region(prepare(mesh), pieces, workspace).mesh,
        lambda: naive_region(mesh, pieces, workspace).num_tri(),
    )
    note = f"{len(mesh.faces)} triangles; rival: one hull per triangle, one union"
    return Row("paper object, both edges", ours, rival, 0.5, note)


def naive_region(
    mesh: TriangleMesh, pieces: list[FeaturePiece], workspace: Box
) -> manifold3d.Manifold:
    """The paper's construction as it stands: no culling, no merging, no order."""
    solid = manifold3d.Mesh64(
        np.array(mesh.vertices_mm), np.array(mesh.faces, dtype=np.uint64)
    )
    hidden = [manifold3d.Manifold(solid)]
    reach = 6 * workspace.diagonal_mm
    for piece in pieces:
        for triangle in mesh.triangles_mm:
            away = triangle[:, None] - piece.vertices_mm[None]
            length = np.linalg.norm(away, axis=2)
            push = np.clip(reach / length[length > 1e-9].min(), 2, 1e5)
            far = (triangle[:, None] + push * away).reshape(-1, 3)
            points = np.concatenate([triangle, far])
            hidden.append(manifold3d.Manifold.hull_points(points))
    everything = manifold3d.Manifold.cube(tuple(workspace.size_mm))
    everything = everything.translate(tuple(workspace.low_mm))
    return everything - manifold3d.Manifold.batch_boolean(hidden, manifold3d.OpType.Add)


def sharp_pieces(mesh: TriangleMesh) -> list[FeaturePiece]:
    """Every straight sharp mesh edge longer than 5 mm."""
    table = edge_table(mesh)
    ends = mesh.vertices_mm[table.vertices]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    sharp = table.regular & (np.abs(table.angle_rad) > 0.4) & (length > 5)
    pieces = []
    for row in np.flatnonzero(sharp):
        normals = mesh.normals[table.faces[row]]
        planes = np.column_stack([normals, normals @ ends[row, 0]])
        facing = "any" if table.angle_rad[row] > 0 else "all"
        pieces.append(FeaturePiece(ends[row], planes, facing))
    return pieces


def edges_row(mesh: TriangleMesh, count: int) -> Row:
    """Median time of random sharp edges, each region with its mesh."""
    occluders = prepare(mesh)
    workspace = Box.around(mesh.vertices_mm, grow_mm=mesh.extent_mm / 2)
    pieces = sharp_pieces(mesh)
    chosen = np.random.default_rng(1).choice(len(pieces), count, replace=False)
    times = []
    for i in chosen:
        (taken,) = best_of(
            1, lambda i=i: visibility_region(occluders, [pieces[i]], workspace).mesh
        )
        times.append(taken)
    low, high = np.quantile(times, [0.9, 1.0])
    note = f"{len(mesh.faces)} triangles; 90 % {low:.2f} s, worst {high:.2f} s"
    return Row(
        f"{mesh.name}: {count} sharp edges, median",
        float(np.median(times)),
        None,
        1.0,
        note,
    )


def growth_rows(quick: bool) -> list[Row]:
    """The same edge behind posts of more and more sides."""
    rows = []
    for sides in (8, 32) if quick else (8, 16, 32, 64, 128):
        mesh = posts(sides)
        piece = FeaturePiece(
            [[-20.0, -100, 0], [20, -100, 0]], [[0, 0, 1, 0], [0, -1, 0, 100]], "any"
        )
        workspace = Box.around(mesh.vertices_mm, grow_mm=100)
        occluders = prepare(mesh)
        (ours,) = best_of(2, lambda: visibility_region(occluders, [piece], workspace))  # noqa: B023
        name = f"growth: {len(mesh.faces)} triangles"
        per_triangle = f"{1e6 * ours / len(mesh.faces):.0f} us per triangle"
        rows.append(Row(name, ours, None, 5.0, per_triangle))
    return rows


def posts(sides: int) -> TriangleMesh:
    """A plate with sixteen round posts, as one solid."""
    solid = manifold3d.Manifold.cube((200, 200, 20)).translate((-100, -100, -20))
    for x in (-75, -25, 25, 75):
        for y in (-75, -25, 25, 75):
            post = manifold3d.Manifold.cylinder(40, 8, 8, sides)
            solid += post.translate((x, y, -5))
    mesh = solid.to_mesh64()
    vertices = np.array(mesh.vert_properties[:, :3])
    faces = np.array(mesh.tri_verts, dtype=np.int64)
    return TriangleMesh(vertices, faces, np.arange(len(faces)), "posts")


def sight_row(mesh: TriangleMesh, quick: bool) -> Row:
    """1,000 view points by 500 targets against Embree called directly."""
    occluders = prepare(mesh)
    rng = np.random.default_rng(2)
    box = Box.around(mesh.vertices_mm, grow_mm=mesh.extent_mm / 2)
    views = rng.uniform(box.low_mm, box.high_mm, (200 if quick else 1000, 3))
    targets = mesh.vertices_mm[rng.integers(0, len(mesh.vertices_mm), 500)]
    scene = EmbreeScene()
    EmbreeMesh(scene, mesh.triangles_mm.astype(np.float32))
    occluders.rays.blocked(views[:1], views[1:2])
    ours, rival = best_of(
        5,
        lambda: line_of_sight(occluders, views, targets),
        lambda: raw_embree(scene, views, targets),
    )
    note = f"{len(views)} views x 500 points, {mesh.name}; rival: raw embreex"
    return Row("line of sight", ours, rival, 2.0, note)


def raw_embree(scene: EmbreeScene, views: FloatArray, targets: FloatArray) -> object:
    """One occlusion query for all pairs, nothing else."""
    origins = np.repeat(views.astype(np.float32), len(targets), axis=0)
    directions = np.tile(targets.astype(np.float32), (len(views), 1)) - origins
    lengths = np.full(len(origins), 1 - 1e-4, dtype=np.float32)
    return scene.run(origins, directions, dists=lengths, query="OCCLUDED")


def agreement_row(quick: bool) -> Row:
    """View points near the boundary against the independent exact test."""
    mesh = posts(24)
    piece = FeaturePiece(
        [[-20.0, -100, 0], [20, -100, 0]], [[0, 0, 1, 0], [0, -1, 0, 100]], "any"
    )
    workspace = Box.around(mesh.vertices_mm, grow_mm=100)
    region = visibility_region(prepare(mesh), [piece], workspace)
    rng = np.random.default_rng(3)
    count = 1_000 if quick else 10_000
    chosen = rng.choice(np.flatnonzero(~region.on_wall), count)
    share = rng.dirichlet([1, 1, 1], count)
    points = np.einsum("nk,nkd->nd", share, region.mesh.triangles_mm[chosen])
    points += rng.uniform(-1, 1, (count, 1)) * region.mesh.normals[chosen]
    points = points[workspace.contains(points)]
    distance = region.signed_distance(points)
    band = np.abs(distance) <= 0.01 + 1e-6 * workspace.diagonal_mm
    start = time.perf_counter()
    differ = (distance > 0) != exactly_visible(mesh, [piece], points)
    taken = time.perf_counter() - start
    note = (
        f"{len(points)} view points within 1 mm of the boundary: "
        f"{(differ & ~band).sum()} disagreements, {band.mean():.1%} in the band"
    )
    return Row("independent exact test", taken, None, 60.0, note)


def nist_part(name: str) -> TriangleMesh | None:
    """A NIST part from the bundled cells or the shared data, if it is there."""
    for folder in PARTS:
        for path in sorted(folder.rglob(name)):
            return load_part(path).mesh
    return None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true")
    for row in run(parser.parse_args().quick):
        print(row.text)


if __name__ == "__main__":
    main()
