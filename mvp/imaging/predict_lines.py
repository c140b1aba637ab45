"""Hidden-line removal: which parts of which lines a view shows, by rays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mvp.geometry import BoolArray, FloatArray, IntArray, Pose, edge_table
from mvp.imaging.expectation import DrawnEdges

if TYPE_CHECKING:
    from mvp.geometry import TriangleMesh
    from mvp.imaging.measure_plane import ImagePlane
    from mvp.imaging.render_scene import RenderScene

SAMPLES = 33
_LIFT_MM = 0.02
_NEAREST_MM = 1.0


@dataclass(frozen=True, eq=False)
class Lines:
    """Straight lines on a part, in the part frame.

    Attributes:
        start_mm, end_mm: (k, 3).
        normal_a, normal_b: (k, 3) outward normals of the own faces, zero for none.
        convex: (k,) one facing face suffices to see it.
    """

    start_mm: FloatArray
    end_mm: FloatArray
    normal_a: FloatArray
    normal_b: FloatArray
    convex: BoolArray


@dataclass(frozen=True, eq=False)
class Sightings:
    """Lines seen by one camera, sampled at ``SAMPLES`` even places.

    Attributes:
        start_mm, end_mm: (k, 3) camera frame.
        places_px: (k, S, 2) ideal px; nan behind the camera.
        depth_mm: (k, S) from the pupil plane.
        in_frame: (k, S) on the sensor.
        visible: (k, S) on the sensor and not hidden.
    """

    start_mm: FloatArray
    end_mm: FloatArray
    places_px: FloatArray
    depth_mm: FloatArray
    in_frame: BoolArray
    visible: BoolArray


def sight(
    lines: Lines, scene: RenderScene, part_from_camera: Pose, plane: ImagePlane
) -> Sightings:
    """Project the lines and find what hides them."""
    camera_from_part = part_from_camera.inverse()
    start = camera_from_part.apply(lines.start_mm)
    end = camera_from_part.apply(lines.end_mm)
    share = np.linspace(0, 1, SAMPLES)[None, :, None]
    points = start[:, None] * (1 - share) + end[:, None] * share
    ahead = points[..., 2] > _NEAREST_MM
    safe = np.where(ahead[..., None], points, np.array([0.0, 0.0, 1.0]))
    places = np.where(ahead[..., None], plane.project(safe), np.nan)
    in_frame = ahead & plane.inside(np.nan_to_num(places))
    normals = [camera_from_part.rotate(n) for n in (lines.normal_a, lines.normal_b)]
    candidate = in_frame & _faces_camera(points, normals, lines.convex)
    lift = _lift(normals)
    visible = np.zeros_like(candidate)
    lifted = (points + lift[:, None])[candidate]
    visible[candidate] = ~hidden(lifted, scene, part_from_camera)
    return Sightings(start, end, places, points[..., 2], in_frame, visible)


def hidden(
    points_camera: FloatArray, scene: RenderScene, part_from_camera: Pose
) -> BoolArray:
    """Which points (n, 3) in the camera frame have something in front of them."""
    directions = points_camera / points_camera[:, 2:3]
    depth = hit_depth(directions, scene, part_from_camera)[0]
    reach = points_camera[:, 2]
    return np.asarray(depth < reach * (1 - 2e-6) - _LIFT_MM / 4)


def hit_depth(
    directions: FloatArray, scene: RenderScene, part_from_camera: Pose
) -> tuple[FloatArray, IntArray]:
    """First hit of rays (n, 3) with z = 1: depth (inf for none) and triangle."""
    found = scene.hit(part_from_camera, directions.astype(np.float32))
    planes = scene.planes(part_from_camera)
    slope = np.einsum("ij,ij->i", planes.normals[found], directions)
    safe = np.where(np.abs(slope) > 1e-9, slope, -1e-9)
    depth = planes.offsets_mm[found] / safe
    return np.where(found >= 0, depth, np.inf), np.asarray(found, np.int64)


def _faces_camera(
    points: FloatArray, normals: list[FloatArray], convex: BoolArray
) -> BoolArray:
    """Own faces turned away hide an edge before any ray is cast."""
    facing, known = [], []
    for normal in normals:
        facing.append(np.einsum("ksi,ki->ks", points, normal) < 0)
        known.append((np.abs(normal).sum(axis=1) > 0)[:, None])
    a, b = (f | ~k for f, k in zip(facing, known, strict=True))
    either = (facing[0] & known[0]) | (facing[1] & known[1]) | ~(known[0] & known[1])
    return np.asarray(np.where(convex[:, None], either, a & b))


def _lift(normals: list[FloatArray]) -> FloatArray:
    """A short step off the own surface, so that it does not hide its own edge."""
    total = normals[0] + normals[1]
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.asarray(_LIFT_MM * total / np.where(length > 1e-6, length, 1.0))


def runs(visible: BoolArray) -> list[tuple[int, int]]:
    """First and last index of every run of True in (S,)."""
    padded = np.concatenate([[False], visible, [False]])
    change = np.flatnonzero(padded[1:] != padded[:-1])
    return [
        (int(a), int(b) - 1) for a, b in zip(change[::2], change[1::2], strict=True)
    ]


def drawn_pieces(seen: Sightings, plane: ImagePlane) -> DrawnEdges:
    """All visible runs of all lines as straight pieces."""
    starts, ends, blurs, owners, shares = [], [], [], [], []
    for index in np.flatnonzero(seen.visible.sum(axis=1) > 1):
        for first, last in runs(seen.visible[index]):
            if last > first:
                starts.append(seen.places_px[index, first])
                ends.append(seen.places_px[index, last])
                middle = seen.depth_mm[index, (first + last) // 2]
                blurs.append(float(plane.blur_px(middle)))
                owners.append(int(index))
                shares.append((first / (SAMPLES - 1), last / (SAMPLES - 1)))
    owner = np.array(owners, dtype=np.int64)
    low, high = np.array(shares).reshape(-1, 2).T[:, :, None]
    origin, along = seen.start_mm[owner], (seen.end_mm - seen.start_mm)[owner]
    return DrawnEdges(
        np.array(starts).reshape(-1, 2),
        np.array(ends).reshape(-1, 2),
        np.array(blurs),
        owner,
        origin + low * along,
        origin + high * along,
    )


def silhouettes(mesh: TriangleMesh, part_from_camera: Pose, smooth_deg: float) -> Lines:
    """Mesh edges of curved faces where the surface turns away from the camera."""
    table = edge_table(mesh)
    smooth = (
        (table.faces[:, 1] >= 0)
        & (np.abs(table.angle_rad) < np.deg2rad(smooth_deg))
        & (np.abs(table.angle_rad) > 1e-4)
    )
    vertices, faces = table.vertices[smooth], table.faces[smooth]
    start = mesh.vertices_mm[vertices[:, 0]]
    to_camera = part_from_camera.translation_mm - start
    a = np.einsum("ij,ij->i", mesh.normals[faces[:, 0]], to_camera)
    b = np.einsum("ij,ij->i", mesh.normals[faces[:, 1]], to_camera)
    contour = np.sign(a) != np.sign(b)
    vertices, faces = vertices[contour], faces[contour]
    return Lines(
        mesh.vertices_mm[vertices[:, 0]],
        mesh.vertices_mm[vertices[:, 1]],
        mesh.normals[faces[:, 0]],
        mesh.normals[faces[:, 1]],
        np.ones(len(faces), dtype=np.bool_),
    )


def joined(batches: list[Lines]) -> Lines:
    """One batch of several."""
    return Lines(
        np.concatenate([b.start_mm for b in batches]),
        np.concatenate([b.end_mm for b in batches]),
        np.concatenate([b.normal_a for b in batches]),
        np.concatenate([b.normal_b for b in batches]),
        np.concatenate([b.convex for b in batches]),
    )
