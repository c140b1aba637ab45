"""Make neighbouring triangles agree on which side is outside."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mvp.geometry.edges import edge_table
from mvp.geometry.mesh import TriangleMesh
from mvp.geometry.patches import connected_labels

if TYPE_CHECKING:
    from mvp.geometry.arrays import BoolArray, FloatArray, IntArray


def oriented(mesh: TriangleMesh) -> tuple[TriangleMesh, int]:
    """Turn as few triangles as possible; returns the mesh and how many were turned.

    Neighbours across edges with exactly two triangles are made to run oppositely
    through the edge. A piece for which that is impossible (a Moebius strip) stays as
    it is. A closed body that then is inside out is turned as a whole, unless it lies
    inside an odd number of others (a cavity).
    """
    if not len(mesh.faces):
        return mesh, 0
    flip, piece = _relative_flips(mesh)
    turned = _with_flipped(mesh, flip)
    inverted = _inside_out(turned, piece)
    flip = flip ^ inverted[piece]
    return _with_flipped(mesh, flip), int(flip.sum())


def _with_flipped(mesh: TriangleMesh, flip: BoolArray) -> TriangleMesh:
    if not flip.any():
        return mesh
    faces = np.where(flip[:, None], mesh.faces[:, ::-1], mesh.faces)
    return TriangleMesh(mesh.vertices_mm, faces, mesh.face_ids, mesh.name)


def _relative_flips(mesh: TriangleMesh) -> tuple[BoolArray, IntArray]:
    """Which triangles disagree with the majority of their piece; label of the piece.

    Each triangle gets two nodes, "as is" and "turned"; an edge links equal nodes of
    its triangles when they agree, and unequal ones otherwise. The two connected
    components of a piece are then its two consistent orientations.
    """
    count = len(mesh.faces)
    pairs, agree = _two_triangle_edges(mesh)
    turned = np.where(agree, pairs[:, 1], pairs[:, 1] + count)
    other = np.where(agree, pairs[:, 1] + count, pairs[:, 1])
    links = np.vstack(
        [
            np.column_stack([pairs[:, 0], turned]),
            np.column_stack([pairs[:, 0] + count, other]),
        ]
    )
    node = connected_labels(links, 2 * count)
    as_is, flipped = node[:count], node[count:]
    votes = np.bincount(as_is, minlength=int(node.max()) + 1)
    better = votes[flipped] > votes[as_is]
    tie = (votes[flipped] == votes[as_is]) & (flipped < as_is)
    flip = (better | tie) & (as_is != flipped)
    return np.asarray(flip), connected_labels(pairs, count)


def _two_triangle_edges(mesh: TriangleMesh) -> tuple[IntArray, BoolArray]:
    """Triangle pairs (p, 2) at edges with exactly two, and whether they agree."""
    directed = mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    owner = np.repeat(np.arange(len(mesh.faces)), 3)
    ordered = np.sort(directed, axis=1)
    key = ordered[:, 0] * np.int64(len(mesh.vertices_mm)) + ordered[:, 1]
    order = np.argsort(key, kind="stable")
    first = np.flatnonzero(np.r_[True, np.diff(key[order]) > 0])
    two = first[np.diff(np.r_[first, len(key)]) == 2]
    a, b = order[two], order[two + 1]
    return np.stack([owner[a], owner[b]], axis=1), directed[a, 0] != directed[b, 0]


def _inside_out(mesh: TriangleMesh, piece: IntArray) -> BoolArray:
    """Which pieces are closed, of negative volume, and not a cavity."""
    pieces = int(piece.max()) + 1
    table = edge_table(mesh)
    closed = np.ones(pieces, dtype=bool)
    closed[piece[table.faces[~table.regular][:, 0]]] = False
    centred = mesh.triangles_mm - mesh.bounds.centre_mm
    six_volume = np.einsum(
        "ij,ij->i", centred[:, 0], np.cross(centred[:, 1], centred[:, 2])
    )
    volume = np.bincount(piece, six_volume, minlength=pieces) / 6
    wrong = closed & (volume < 0)
    for number in np.flatnonzero(wrong):
        wrong[number] = _depth(mesh, piece, closed, int(number)) % 2 == 0
    return np.asarray(wrong)


def _depth(mesh: TriangleMesh, piece: IntArray, closed: BoolArray, number: int) -> int:
    """How many other closed pieces contain this piece."""
    point = mesh.vertices_mm[mesh.faces[piece == number][0, :1]]
    others = np.flatnonzero(closed & (np.arange(len(closed)) != number))
    return sum(
        abs(_winding(mesh, mesh.faces[piece == other], point)) > 0.5 for other in others
    )


def _winding(mesh: TriangleMesh, faces: IntArray, point: FloatArray) -> float:
    import igl

    vertices = np.array(mesh.vertices_mm)
    return float(np.ravel(igl.winding_number(vertices, np.array(faces), point))[0])
