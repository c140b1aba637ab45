"""STEP and IGES to triangles, with the CAD face of each triangle.

The converter writes a GLB in metres and single precision. Corners on planar faces are
moved back onto the exact planes of the B-rep, which are double precision.
"""

from __future__ import annotations

import json
import os
import re
import struct
import tempfile
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from mvp.errors import GeometryError
from mvp.geometry.mesh import TriangleMesh

if TYPE_CHECKING:
    from collections.abc import Iterator

    from mvp.geometry.arrays import FloatArray, IntArray

LINEAR_MM = 0.1
ANGULAR_RAD = 0.5
# Single precision moves a corner by 3e-5 mm at 0.5 m; more is not rounding.
_LARGEST_STEP_M = 1e-6
_TRIANGLES = 4
_EXTENSION = "TM_brep_faces"
_COMPONENT = {5121: "<u1", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTH = {"SCALAR": 1, "VEC3": 3}


def tessellated(
    content: bytes,
    *,
    file_type: Literal["step", "iges"],
    name: str,
    linear_mm: float = LINEAR_MM,
    angular_rad: float = ANGULAR_RAD,
) -> TriangleMesh:
    """Triangles of all solids and shells in a B-rep file, mm.

    Raises:
        GeometryError: the file cannot be read, or holds no surface.
    """
    import cascadio

    with _captured_chatter() as chatter:
        glb = cascadio.load(
            content,
            file_type=file_type,
            tol_linear=linear_mm,
            tol_angular=angular_rad,
            include_brep=True,
        )
    if len(glb) < 20:
        told = _first_complaint(chatter)
        raise GeometryError(
            f"{name}: not a readable {file_type.upper()} file{told}",
            hint="export the part again from CAD (STEP AP203, AP214 or AP242)",
            where=name,
        )
    bodies = _Glb(glb).bodies()
    if not bodies:
        raise GeometryError(
            f"{name}: the file holds no solid and no surface",
            hint="export the solid body, not only curves or annotations",
            where=name,
        )
    return _in_mm(bodies, name)


@contextmanager
def _captured_chatter() -> Iterator[list[str]]:
    """Keep what native code prints off stdout and stderr, and hand it over."""
    told: list[str] = []
    saved = os.dup(1), os.dup(2)
    with tempfile.TemporaryFile() as sink:
        try:
            os.dup2(sink.fileno(), 1)
            os.dup2(sink.fileno(), 2)
            yield told
        finally:
            os.dup2(saved[0], 1)
            os.dup2(saved[1], 2)
            os.close(saved[0])
            os.close(saved[1])
            sink.seek(0)
            told += sink.read().decode(errors="replace").splitlines()


def _first_complaint(chatter: list[str]) -> str:
    plain = [re.sub(r"\x1b\[[0-9;]*m|\*+", "", line).strip() for line in chatter]
    return next((f" ({line})" for line in plain if line), "")


@dataclass(frozen=True, eq=False)
class _Body:
    """One primitive: corners in metres, triangles, and the CAD face of each."""

    vertices_m: FloatArray
    faces: IntArray
    face_ids: IntArray


def _in_mm(bodies: list[_Body], name: str) -> TriangleMesh:
    points, ids = 0, 0
    faces, face_ids = [], []
    for body in bodies:
        faces.append(body.faces + points)
        face_ids.append(body.face_ids + ids)
        points += len(body.vertices_m)
        ids += int(body.face_ids.max(initial=-1)) + 1
    vertices = np.concatenate([body.vertices_m for body in bodies]) * 1000.0
    return TriangleMesh(vertices, np.concatenate(faces), np.concatenate(face_ids), name)


class _Glb:
    """A binary glTF as the converter writes it."""

    def __init__(self, content: bytes) -> None:
        length = struct.unpack_from("<I", content, 12)[0]
        self._tree: dict[str, Any] = json.loads(content[20 : 20 + length])
        self._binary = content[28 + length :]

    def bodies(self) -> list[_Body]:
        """All triangle primitives, each moved to where its node puts it."""
        scene = self._tree["scenes"][self._tree.get("scene", 0)]
        return [
            body
            for root in scene.get("nodes", ())
            for body in self._node_bodies(int(root), np.eye(4))
        ]

    def _node_bodies(
        self, number: int, world_from_parent: FloatArray
    ) -> Iterator[_Body]:
        node = self._tree["nodes"][number]
        world_from_node = world_from_parent @ _node_matrix(node)
        if "mesh" in node:
            for primitive in self._tree["meshes"][node["mesh"]]["primitives"]:
                if primitive.get("mode", _TRIANGLES) == _TRIANGLES:
                    yield self._body(primitive, world_from_node)
        for child in node.get("children", ()):
            yield from self._node_bodies(int(child), world_from_node)

    def _body(self, primitive: dict[str, Any], world_from_node: FloatArray) -> _Body:
        vertices = self._array(primitive["attributes"]["POSITION"]).astype(np.float64)
        faces = self._array(primitive["indices"]).astype(np.int64).reshape(-1, 3)
        brep = primitive.get("extensions", {}).get(_EXTENSION)
        ids = np.zeros(len(faces), dtype=np.int64)
        if brep is not None:
            ids = self._array(brep["faceIndices"]).astype(np.int64).reshape(-1)
            vertices = on_exact_planes(vertices, faces, ids, _planes(brep["faces"]))
        moved = vertices @ world_from_node[:3, :3].T + world_from_node[:3, 3]
        if np.linalg.det(world_from_node[:3, :3]) < 0:
            faces = faces[:, ::-1]
        return _Body(moved, faces, ids)

    def _array(self, number: int) -> FloatArray | IntArray:
        accessor = self._tree["accessors"][number]
        view = self._tree["bufferViews"][accessor["bufferView"]]
        width = _WIDTH[accessor["type"]]
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        flat = np.frombuffer(
            self._binary,
            dtype=_COMPONENT[accessor["componentType"]],
            count=accessor["count"] * width,
            offset=start,
        )
        return flat.reshape(-1, width) if width > 1 else flat


def _node_matrix(node: dict[str, Any]) -> FloatArray:
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    matrix = np.eye(4)
    x, y, z, w = node.get("rotation", (0.0, 0.0, 0.0, 1.0))
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    matrix[:3, :3] = rotation * np.array(node.get("scale", (1.0, 1.0, 1.0)))
    matrix[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return matrix


def _planes(faces: list[dict[str, Any]]) -> dict[int, FloatArray]:
    """Rows (n, o), metres, of the faces that are planes."""
    planes = {}
    for face in faces:
        if face.get("type") == "plane":
            normal = np.array(face["normal"], dtype=np.float64)
            normal = normal / np.linalg.norm(normal)
            planes[int(face["face_index"])] = np.append(normal, normal @ face["origin"])
    return planes


def on_exact_planes(
    vertices: FloatArray, faces: IntArray, ids: IntArray, planes: dict[int, FloatArray]
) -> FloatArray:
    """Move each vertex (n, 3) by the shortest step onto all planes of its faces.

    Vertices that coincide after rounding count as one. A step that is longer than
    rounding explains is not taken.
    """
    if not planes:
        return vertices
    point, index = np.unique(np.round(vertices, 7), axis=0, return_inverse=True)
    index = np.asarray(index).reshape(-1)
    table = np.zeros((int(ids.max()) + 1, 4))
    for number, plane in planes.items():
        if number < len(table):
            table[number] = plane
    uses = np.unique(np.column_stack([index[faces].ravel(), np.repeat(ids, 3)]), axis=0)
    normal, offset = table[uses[:, 1], :3], table[uses[:, 1], 3]
    matrix = np.zeros((len(point), 3, 3))
    np.add.at(matrix, uses[:, 0], normal[:, :, None] * normal[:, None, :])
    inverse = np.linalg.pinv(matrix, rcond=1e-4, hermitian=True)
    start = np.zeros_like(point)
    start[index] = vertices
    moved = start.copy()
    for _ in range(2):
        gap = offset - np.einsum("ij,ij->i", normal, moved[uses[:, 0]])
        pull = np.zeros_like(point)
        np.add.at(pull, uses[:, 0], normal * gap[:, None])
        moved += np.einsum("nij,nj->ni", inverse, pull)
    small = np.linalg.norm(moved - start, axis=1) <= _LARGEST_STEP_M
    return np.where(small[:, None], moved, start)[index]
