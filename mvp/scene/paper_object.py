"""The object of the 1995 experiments: a cube under an overhang with holes.

A square tub stands on a floor, covered by an overhanging plate. Inside, on the floor
level, sits a cube whose two feature edges (25.4 mm each) meet in the corner
(12.7, 0, 12.7); they can be seen only through the plate's two holes.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import manifold3d
import numpy as np

from mvp.geometry import Box, FloatArray, TriangleMesh, planar_patches


def _box(low: tuple[float, float, float], high: tuple[float, float, float]) -> Box:
    return Box(np.array(low), np.array(high))


@dataclass(frozen=True, eq=False)
class PaperObject:
    """Sizes, mm. The defaults reproduce the facts that the experiments report.

    Attributes:
        cube: the enclosed cube.
        half_width_mm: outer half width of walls and plate.
        wall_mm: thickness of walls, floor and plate.
        floor_mm: height z of the floor's upper side.
        overhang_mm: height z of the plate's lower side.
        large_hole: its x and y range.
        slit: x and y range of the narrow slit beside it, or None.
        small_hole: its x and y range.
    """

    cube: Box = field(
        default_factory=lambda: _box((-12.7, 0.0, -12.7), (12.7, 25.4, 12.7))
    )
    half_width_mm: float = 101.6
    wall_mm: float = 6.35
    floor_mm: float = -12.7
    overhang_mm: float = 50.8
    large_hole: tuple[float, float, float, float] = (9.0, 62.0, -6.0, 58.0)
    slit: tuple[float, float, float, float] | None = (62.0, 85.0, -4.0, 4.0)
    small_hole: tuple[float, float, float, float] = (4.5, 43.0, -66.0, -29.95)


def paper_object(sizes: PaperObject | None = None) -> TriangleMesh:
    """Build the object as one closed solid, with exact coordinates.

    Raises:
        ValueError: the sizes do not make a solid (a hole outside the plate, a cube
            through the wall).
    """
    sizes = sizes or PaperObject()
    solid = _block(_outer(sizes)) - _block(_cavity(sizes))
    solid += _block(sizes.cube)
    for opening in (sizes.large_hole, sizes.slit, sizes.small_hole):
        if opening is not None:
            solid -= _block(_through_plate(sizes, opening))
    mesh = solid.to_mesh64()
    vertices = _exact(np.asarray(mesh.vert_properties)[:, :3], sizes)
    faces = np.asarray(mesh.tri_verts, dtype=np.int64)
    if not len(faces):
        raise ValueError("the sizes of the object leave no material")
    bare = TriangleMesh(vertices, faces, np.zeros(len(faces), np.int64), "paper_object")
    return TriangleMesh(vertices, faces, planar_patches(bare), "paper_object")


def without_slit() -> PaperObject:
    """The variant with no slit and slightly other holes, as used for search races."""
    return PaperObject(
        large_hole=(9.0, 57.0, -6.0, 50.0),
        slit=None,
        small_hole=(4.0, 46.0, -75.0, -29.95),
    )


def _outer(sizes: PaperObject) -> Box:
    half = sizes.half_width_mm
    low, high = sizes.floor_mm - sizes.wall_mm, sizes.overhang_mm + sizes.wall_mm
    return _box((-half, -half, round(low, 9)), (half, half, round(high, 9)))


def _cavity(sizes: PaperObject) -> Box:
    half = sizes.half_width_mm - sizes.wall_mm
    return _box((-half, -half, sizes.floor_mm), (half, half, sizes.overhang_mm))


def _through_plate(
    sizes: PaperObject, opening: tuple[float, float, float, float]
) -> Box:
    x_low, x_high, y_low, y_high = opening
    half = sizes.half_width_mm - sizes.wall_mm
    if not (-half <= x_low < x_high <= half and -half <= y_low < y_high <= half):
        raise ValueError(f"the opening {opening} is not inside the plate")
    low = (sizes.overhang_mm + sizes.floor_mm) / 2
    top = sizes.overhang_mm + 2 * sizes.wall_mm
    return _box((x_low, y_low, max(low, sizes.cube.high_mm[2])), (x_high, y_high, top))


def _block(box: Box) -> manifold3d.Manifold:
    return manifold3d.Manifold.cube(tuple(box.size_mm)).translate(tuple(box.low_mm))


def _exact(vertices: FloatArray, sizes: PaperObject) -> FloatArray:
    """Replace each coordinate by the size it came from, so that planes are exact."""
    boxes = [_outer(sizes), _cavity(sizes), sizes.cube]
    boxes += [
        _through_plate(sizes, opening)
        for opening in (sizes.large_hole, sizes.slit, sizes.small_hole)
        if opening is not None
    ]
    known = np.concatenate([np.stack([box.low_mm, box.high_mm]) for box in boxes])
    nearest = np.abs(vertices[:, :, None] - known.T[None]).argmin(axis=2)
    return np.take_along_axis(known, nearest, axis=0)
