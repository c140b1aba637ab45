"""What messages call the faces of a body."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mvp.scene.catalogue import planar_faces

if TYPE_CHECKING:
    from mvp.geometry import IntArray, TriangleMesh

_FLAT_COSINE = float(np.cos(np.deg2rad(0.5)))


def listed_faces(mesh: TriangleMesh) -> dict[int, str]:
    """Id in the part's catalogue ("F22") by face id, of the planar faces it lists."""
    return {
        int(face): f"F{number}"
        for number, members in enumerate(planar_faces(mesh), 1)
        for face in np.unique(mesh.face_ids[members])
    }


def face_by_place(mesh: TriangleMesh, face: int) -> str:
    """A face that no catalogue lists, by a point on it, mm in the mesh's frame.

    It is curved, or too small for the catalogue.
    """
    members: IntArray = np.flatnonzero(mesh.face_ids == face)
    if not len(members):
        return "a face without area"
    areas = mesh.areas_mm2[members]
    weights = areas / areas.sum() if areas.sum() > 0 else np.full(len(areas), 1.0)
    middles = mesh.triangles_mm[members].mean(axis=1)
    # A point on the face: the middle of a cylinder would lie on its axis.
    off = np.linalg.norm(middles - weights @ middles, axis=1)
    place = middles[int(np.argmin(off))]
    mean = weights @ mesh.normals[members]
    flat = (mesh.normals[members] @ mean >= _FLAT_COSINE).all()
    words = ", ".join(f"{value:z.1f}" for value in place)
    return f"a {'small' if flat else 'curved'} face near ({words}) mm"
