"""A round hole whose rim must be seen whole."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from mvp.geometry import BoolArray, FeaturePiece, FloatArray, TriangleMesh, plane_axes

DIAMETERS = 8


@dataclass(frozen=True, eq=False)
class HoleFeature:
    """A hole in the part frame; what is seen of it is its near rim.

    Attributes:
        id: stable name.
        centre_mm: (3,) centre of the rim.
        axis: (3,) unit vector out of the material.
        diameter_mm: of the circle fitted to the rim.
        depth_mm: length of the round wall; 0 when there is none.
        through: it opens on the other side (or into a wider space).
        rim_mm: (n, 3) the mesh's own rim vertices, counter-clockwise seen from outside.
        residual_mm: largest distance of a rim vertex from the fitted circle.
        pieces: the mouth as one convex polygon, or the rim's chords when something
            stands in the mouth.
    """

    id: str
    centre_mm: FloatArray
    axis: FloatArray
    diameter_mm: float
    depth_mm: float
    through: bool
    rim_mm: FloatArray
    residual_mm: float
    pieces: tuple[FeaturePiece, ...]

    @property
    def kind(self) -> Literal["hole"]:
        """Which of the four kinds it is."""
        return "hole"

    @property
    def polygon_error_mm(self) -> float:
        """How far the rim polygon runs inside the fitted circle, at most, mm."""
        middle = (self.rim_mm + np.roll(self.rim_mm, -1, axis=0)) / 2
        inner = np.linalg.norm(middle - self.centre_mm, axis=1)
        return float(max(self.diameter_mm / 2 - inner.min(), self.residual_mm))

    @property
    def key_points_mm(self) -> FloatArray:
        """(16, 3) ends of the eight diameters."""
        return self.circle_mm(2 * DIAMETERS)

    @property
    def segments_mm(self) -> FloatArray:
        """(8, 2, 3) diameters, evenly spaced."""
        points = self.circle_mm(2 * DIAMETERS)
        return np.stack([points[:DIAMETERS], points[DIAMETERS:]], axis=1)

    @property
    def outline_mm(self) -> tuple[FloatArray, ...]:
        """The rim as one closed polyline."""
        return (np.vstack([self.rim_mm, self.rim_mm[:1]]),)

    def circle_mm(self, count: int) -> FloatArray:
        """Points (count, 3) of the fitted circle, evenly spaced."""
        angle = np.arange(count) * (2 * np.pi / count)
        first, second = plane_axes(self.axis)
        round_ = np.outer(np.cos(angle), first) + np.outer(np.sin(angle), second)
        return np.asarray(self.centre_mm + self.diameter_mm / 2 * round_)

    def sight_pieces(self) -> tuple[FeaturePiece, ...]:
        """The convex pieces that must be seen whole."""
        return self.pieces


@dataclass(frozen=True, eq=False)
class Circle:
    """A circle through points of a plane ring."""

    centre_mm: FloatArray
    normal: FloatArray
    radius_mm: float
    residual_mm: float


def fit_circle(ring_mm: FloatArray) -> Circle:
    """Least-squares circle (Kasa) in the best plane of a ring (n, 3), n >= 3.

    The normal follows the ring's sense; the residual is the largest distance of a
    vertex from the circle, in or out of the plane.
    """
    middle = ring_mm.mean(axis=0)
    offset = ring_mm - middle
    normal = np.linalg.svd(offset)[2][2]
    turning = np.cross(offset, np.roll(offset, -1, axis=0)).sum(axis=0)
    normal = normal if normal @ turning >= 0 else -normal
    axes = np.stack(plane_axes(normal))
    flat = offset @ axes.T
    system = np.column_stack([2 * flat, np.ones(len(flat))])
    solved = np.linalg.lstsq(system, (flat**2).sum(axis=1), rcond=None)[0]
    centre = solved[:2]
    radius = float(np.sqrt(max(solved[2] + centre @ centre, 0.0)))
    in_plane = np.linalg.norm(flat - centre, axis=1) - radius
    residual = float(np.hypot(in_plane, offset @ normal).max())
    return Circle(middle + centre @ axes, normal, radius, residual)


def mouth_pieces(
    rim_mm: FloatArray, axis: FloatArray, mesh: TriangleMesh
) -> tuple[FeaturePiece, ...]:
    """The mouth as a convex polygon, or its chords where something stands in it.

    The plane lies at the outermost rim vertex, so that no rim vertex is behind it.
    """
    offset = float((rim_mm @ axis).max())
    plane = np.append(axis, offset)[None]
    if not _mouth_is_blocked(rim_mm, axis, mesh):
        return (FeaturePiece(rim_mm, plane, "all", mouth=True),)
    chords = np.stack([rim_mm, np.roll(rim_mm, -1, axis=0)], axis=1)
    return tuple(FeaturePiece(chord, plane, "all") for chord in chords)


def _mouth_is_blocked(rim_mm: FloatArray, axis: FloatArray, mesh: TriangleMesh) -> bool:
    """Whether a triangle meets the open mouth, well inside the rim."""
    centre = rim_mm.mean(axis=0)
    inner = float(np.linalg.norm(rim_mm - centre, axis=1).min())
    chord = (rim_mm + np.roll(rim_mm, -1, axis=0)) / 2
    inner = 0.98 * min(inner, float(np.linalg.norm(chord - centre, axis=1).min()))
    corners = mesh.triangles_mm - centre
    height = corners @ axis
    band = 1e-6 * mesh.extent_mm
    near = (height.min(axis=1) <= band) & (height.max(axis=1) >= -band)
    reach = (corners.min(axis=1) <= inner) & (corners.max(axis=1) >= -inner)
    near &= reach.all(axis=1)
    points, real = _plane_section(corners[near], height[near], band)
    points = points - (points @ axis)[..., None] * axis
    known = points[np.arange(len(points)), np.argmax(real, axis=1)]
    points = np.where(real[..., None], points, known[:, None])
    first, second = np.triu_indices(points.shape[1], k=1)
    pairs = np.stack([points[:, first], points[:, second]], axis=2).reshape(-1, 2, 3)
    if (_distance_to_origin(pairs) < inner).any():
        return True
    flat = points[real[:, :3].all(axis=1), :3]
    turn = np.cross(flat, np.roll(flat, -1, axis=1)) @ axis
    return bool(((turn > 0).all(axis=1) | (turn < 0).all(axis=1)).any())


def _plane_section(
    corners: FloatArray, height: FloatArray, band: float
) -> tuple[FloatArray, BoolArray]:
    """Points (n, 6, 3) whose hull is the section of each triangle, and which are real.

    The first three are the corners that lie in the plane, the others the crossings of
    the three sides.
    """
    ahead, height_ahead = np.roll(corners, -1, axis=1), np.roll(height, -1, axis=1)
    crosses = ((height > band) & (height_ahead < -band)) | (
        (height < -band) & (height_ahead > band)
    )
    rise = np.where(crosses, height_ahead - height, 1.0)
    crossing = corners + (-height / rise)[..., None] * (ahead - corners)
    points = np.concatenate([corners, crossing], axis=1)
    return points, np.concatenate([np.abs(height) <= band, crosses], axis=1)


def _distance_to_origin(segments: FloatArray) -> FloatArray:
    """Distances (n,) of segments (n, 2, 3) from the origin."""
    start, along = segments[:, 0], segments[:, 1] - segments[:, 0]
    squared = np.einsum("ij,ij->i", along, along)
    share = -np.einsum("ij,ij->i", start, along) / np.maximum(squared, 1e-300)
    return np.asarray(
        np.linalg.norm(start + np.clip(share, 0, 1)[:, None] * along, axis=1)
    )
