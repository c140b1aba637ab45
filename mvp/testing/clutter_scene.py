"""A cluttered scene for planners: a box whose lid has 14 holes, with 16 pillars inside.

Stated for the comparison of solvers that this scene stands for: a box with 14 holes
and 16 pillars, the camera kept above it, a visibility region in five disconnected
pieces with 1490 facets, the paper's lens and sensor, a best known index of 13.34; and
with d 14.6-15 and f/4 no admissible view: the best misses by 1.8 sigma, held back by
the least d, both ends of focus, visibility and field of view, and a field some 36 mm
wider at the part would do.

Sizes are not stated. All are chosen so that the above comes true: a region of five
pieces of more than 0.05 litre beside crumbs, some 1500 facets, about one candidate in
sixteen inside, a best index of 13.36, and -1.7 with that lens.
"""

from __future__ import annotations

from dataclasses import dataclass

import manifold3d
import numpy as np

from mvp.geometry import Box, FloatArray, TriangleMesh, planar_patches
from mvp.scene import edge_feature
from mvp.testing.planning_scenes import HALF_MM, PlanningScene

_NAME = "clutter"
# Bodies that touch are made to overlap by this, and cuts to stick out, so that no two
# surfaces coincide.
_OVERLAP_MM = 1.0


@dataclass(frozen=True)
class ClutterBox:
    """Sizes, mm; z is up and the cube with the feature edges stands at the origin.

    Attributes:
        half_width_mm: outer half width of the box.
        wall_mm: thickness of walls, floor and lid.
        floor_mm: height of the floor's upper side.
        lid_mm: height of the lid's lower side.
        holes: how many holes each row of the lid has.
        hole_radius_mm: of the circle round each hole.
        hole_sides: sides of the polygon that a hole is.
        hole_pitch_mm: between neighbours in a row, and between rows.
        pillars: pillars along each side of their square grid.
        pillar_radius_mm: of the circle round an octagonal pillar.
        pillar_top_mm: height of their tops.
        pillar_pitch_mm: between neighbours.
        cube_mm: side of the cube whose two edges must be seen.
        above_mm: least height of the camera over the lid.
    """

    half_width_mm: float = 210.0
    wall_mm: float = 1.5
    floor_mm: float = -12.7
    lid_mm: float = 34.0
    holes: tuple[int, ...] = (5, 5, 4)
    hole_radius_mm: float = 34.0
    hole_sides: int = 48
    hole_pitch_mm: tuple[float, float] = (76.0, 74.0)
    pillars: int = 4
    pillar_radius_mm: float = 4.0
    pillar_top_mm: float = 30.0
    pillar_pitch_mm: float = 54.0
    cube_mm: float = 25.4
    above_mm: float = 0.5

    @property
    def top_mm(self) -> float:
        """Height of the lid's upper side."""
        return self.lid_mm + self.wall_mm

    @property
    def hole_centres_mm(self) -> FloatArray:
        """(14, 2) centres of the holes, rows staggered where their counts differ."""
        pitch, between = self.hole_pitch_mm
        rows = np.repeat(np.arange(len(self.holes)), self.holes)
        column = np.concatenate([_centred(count) for count in self.holes])
        return np.column_stack([column * pitch, (rows - 1) * between])

    @property
    def pillar_centres_mm(self) -> FloatArray:
        """(16, 2) axes of the pillars."""
        steps = _centred(self.pillars) * self.pillar_pitch_mm
        return np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)


def _centred(count: int) -> FloatArray:
    return np.arange(count, dtype=np.float64) - (count - 1) / 2


def clutter_object(sizes: ClutterBox) -> TriangleMesh:
    """The box as one closed solid."""
    low, high = sizes.floor_mm - _OVERLAP_MM, sizes.top_mm + _OVERLAP_MM
    inner = sizes.half_width_mm - sizes.wall_mm
    solid = _block(sizes.half_width_mm, sizes.floor_mm - sizes.wall_mm, sizes.top_mm)
    solid -= _block(inner, sizes.floor_mm, sizes.lid_mm)
    half = sizes.cube_mm / 2
    solid += _block(half, low, half).translate((0.0, half, 0.0))
    for x, y in sizes.pillar_centres_mm:
        prism = _prism(sizes.pillar_radius_mm, 8, low, sizes.pillar_top_mm)
        solid += prism.translate((x, y, 0.0))
    for x, y in sizes.hole_centres_mm:
        below = sizes.lid_mm - _OVERLAP_MM
        prism = _prism(sizes.hole_radius_mm, sizes.hole_sides, below, high)
        solid -= prism.translate((x, y, 0.0))
    mesh = solid.to_mesh64()
    vertices = np.asarray(mesh.vert_properties)[:, :3]
    faces = np.asarray(mesh.tri_verts, dtype=np.int64)
    bare = TriangleMesh(vertices, faces, np.zeros(len(faces), np.int64), _NAME)
    return TriangleMesh(vertices, faces, planar_patches(bare), _NAME)


def _block(half_width_mm: float, low_mm: float, high_mm: float) -> manifold3d.Manifold:
    size = (2 * half_width_mm, 2 * half_width_mm, high_mm - low_mm)
    corner = (-half_width_mm, -half_width_mm, low_mm)
    return manifold3d.Manifold.cube(size).translate(corner)


def _prism(
    radius_mm: float, sides: int, low_mm: float, high_mm: float
) -> manifold3d.Manifold:
    prism = manifold3d.Manifold.cylinder(high_mm - low_mm, radius_mm, radius_mm, sides)
    return prism.translate((0.0, 0.0, low_mm))


def clutter_scene(sizes: ClutterBox | None = None) -> PlanningScene:
    """Two edges of the cube, seen through the lid from above; walls count as facets."""
    sizes = sizes or ClutterBox()
    mesh = clutter_object(sizes)
    half = sizes.cube_mm / 2
    corner = np.array([half, 0.0, half])
    edges = (
        edge_feature("horizontal edge", corner * [-1, 1, 1], corner, mesh),
        edge_feature("vertical edge", corner * [1, 1, -1], corner, mesh),
    )
    lowest = sizes.top_mm + sizes.above_mm
    low = np.array([-HALF_MM, -HALF_MM, lowest])
    return PlanningScene(mesh, edges, Box(low, np.full(3, HALF_MM)))
