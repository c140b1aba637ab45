"""A triangle mesh in mm, double precision, with what the planner asks of it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from mvp.geometry.arrays import FloatArray, IntArray, as_points
from mvp.geometry.box import Box

if TYPE_CHECKING:
    from mvp.geometry.pose import Pose

# Sides of a box by the order of ``Box.corners``, counter-clockwise from outside.
_BOX_SIDES = np.array(
    [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
)


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """Triangles in one frame; solids and soups alike.

    Attributes:
        vertices_mm: (n, 3) float64.
        faces: (m, 3) int64, counter-clockwise seen from outside.
        face_ids: (m,) int64, the CAD face (or coplanar patch) each triangle is part of.
        name: how messages call it.
    """

    vertices_mm: FloatArray
    faces: IntArray
    face_ids: IntArray
    name: str = "part"

    def __post_init__(self) -> None:
        vertices = np.array(as_points(self.vertices_mm, name="vertices_mm"))
        faces = np.array(self.faces, dtype=np.int64).reshape(-1, 3)
        face_ids = np.array(self.face_ids, dtype=np.int64).reshape(-1)
        if len(face_ids) != len(faces):
            raise ValueError("face_ids needs one entry per triangle")
        if len(faces) and (faces.min() < 0 or faces.max() >= len(vertices)):
            raise ValueError("faces name vertices that do not exist")
        for field, array in (
            ("vertices_mm", vertices),
            ("faces", faces),
            ("face_ids", face_ids),
        ):
            array.setflags(write=False)
            object.__setattr__(self, field, array)

    @cached_property
    def triangles_mm(self) -> FloatArray:
        """Corner points (m, 3, 3), mm."""
        return np.asarray(self.vertices_mm[self.faces])

    @cached_property
    def normals(self) -> FloatArray:
        """Unit outward normals (m, 3); zero for a degenerate triangle."""
        a, b, c = np.moveaxis(self.triangles_mm, 1, 0)
        cross = np.cross(b - a, c - a)
        length = np.linalg.norm(cross, axis=1, keepdims=True)
        return np.asarray(np.divide(cross, length, where=length > 0, out=cross * 0))

    @cached_property
    def areas_mm2(self) -> FloatArray:
        """Triangle areas (m,), mm^2."""
        a, b, c = np.moveaxis(self.triangles_mm, 1, 0)
        return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2)

    @cached_property
    def bounds(self) -> Box:
        """Bounding box, mm."""
        return Box.around(self.vertices_mm)

    @property
    def extent_mm(self) -> float:
        """Largest edge of the bounding box, mm."""
        return float(self.bounds.size_mm.max())

    def moved(self, target_from_mesh: Pose) -> TriangleMesh:
        """The same mesh in another frame."""
        return TriangleMesh(
            target_from_mesh.apply(self.vertices_mm),
            self.faces,
            self.face_ids,
            self.name,
        )


def box_mesh(box: Box, *, name: str) -> TriangleMesh:
    """A box as a closed mesh with outward faces."""
    faces = _BOX_SIDES[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
    return TriangleMesh(box.corners(), faces, np.arange(12) // 2, name)


def concatenated(meshes: list[TriangleMesh], *, name: str = "scene") -> TriangleMesh:
    """One soup of several meshes; face ids are renumbered to stay distinct."""
    vertices, faces, face_ids = [np.zeros((0, 3))], [], []
    vertex_offset = 0
    id_offset = 0
    for mesh in meshes:
        vertices.append(mesh.vertices_mm)
        faces.append(mesh.faces + vertex_offset)
        face_ids.append(mesh.face_ids + id_offset)
        vertex_offset += len(mesh.vertices_mm)
        id_offset += int(mesh.face_ids.max(initial=-1)) + 1
    if not faces:
        return TriangleMesh(
            np.zeros((0, 3)), np.zeros((0, 3), np.int64), np.zeros(0, np.int64), name
        )
    return TriangleMesh(
        np.concatenate(vertices), np.concatenate(faces), np.concatenate(face_ids), name
    )
