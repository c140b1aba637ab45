"""Which triangles can hide a feature at all, and which of them see it themselves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from mvp.geometry import BoolArray, FeaturePiece, FloatArray, IntArray
    from mvp.visibility.occluders import Occluders

_LIFT_SHARE = 2e-5
_ON_TRIANGLE = np.array(
    [
        *np.eye(3) * 0.94 + 0.02,
        *(0.49 - 0.47 * np.eye(3)),
        [1 / 3, 1 / 3, 1 / 3],
        *(0.2 + 0.4 * np.eye(3)),
    ]
)


@dataclass(frozen=True, eq=False)
class OwnFaces:
    """The half-spaces that the faces of a feature hide: its planes and their rule."""

    planes: FloatArray
    any_suffices: bool

    @classmethod
    def of(cls, piece: FeaturePiece) -> OwnFaces:
        """The own faces of a piece."""
        return cls(piece.planes, piece.facing == "any")

    def hides(self, points_mm: FloatArray, *, slack_mm: float = 0.0) -> BoolArray:
        """Which points (..., 3) face too few of the planes."""
        behind = self.behind(points_mm, slack_mm=slack_mm)
        if not len(self.planes):
            return np.zeros(points_mm.shape[:-1], dtype=np.bool_)
        combined = behind.all(axis=-1) if self.any_suffices else behind.any(axis=-1)
        return np.asarray(combined)

    def behind(self, points_mm: FloatArray, *, slack_mm: float = 0.0) -> BoolArray:
        """(..., k): point on or behind plane k."""
        height = points_mm @ self.planes[:, :3].T - self.planes[:, 3]
        return np.asarray(height <= slack_mm)

    def hides_whole(self, triangles_mm: FloatArray, slack_mm: float) -> BoolArray:
        """Which triangles (m, 3, 3) lie in one convex part of the hidden space."""
        if not len(self.planes):
            return np.zeros(len(triangles_mm), dtype=np.bool_)
        behind = self.behind(triangles_mm, slack_mm=slack_mm).all(axis=1)
        combined = behind.all(axis=-1) if self.any_suffices else behind.any(axis=-1)
        return np.asarray(combined)


def possible_occluders(
    occluders: Occluders, feature_mm: FloatArray, own: OwnFaces
) -> IntArray:
    """Triangles that face the feature and reach out of what its own faces hide.

    In a proper solid a line of sight that leaves the surface outward enters the solid
    again through a face that looks at the feature, so back faces add nothing.
    """
    tolerance = occluders.side_tolerance_mm
    heights = occluders.normals @ feature_mm.T - occluders.offsets_mm[:, None]
    facing = heights.max(axis=1) > tolerance
    back = heights.min(axis=1) < -tolerance
    both_sides = occluders.two_sided | _around(occluders, feature_mm)
    facing |= back & (both_sides | (not len(own.planes)))
    index = np.flatnonzero(facing)
    hidden = own.hides_whole(occluders.triangles_mm[index], tolerance)
    return np.asarray(index[~hidden])


def _around(occluders: Occluders, feature_mm: FloatArray) -> BoolArray:
    """Triangles of solids that the feature's middle lies inside of."""
    middle = feature_mm.mean(axis=0)
    turns = solid_angles(occluders.triangles_mm, middle) / (4 * np.pi)
    count = int(occluders.bodies.max(initial=-1)) + 1
    winding = np.bincount(occluders.bodies, weights=turns, minlength=count)
    inside = (np.abs(winding) > 0.5) & (np.abs(winding - np.round(winding)) < 1e-6)
    return np.asarray(inside[occluders.bodies])


def solid_angles(triangles_mm: FloatArray, points_mm: FloatArray) -> FloatArray:
    """Signed solid angles (..., m) of triangles (m, 3, 3) seen from points (..., 3).

    In sr, by van Oosterom and Strackee; the angles of all triangles of a closed mesh
    add up to 4 pi times its winding number about the point.
    """
    corners = np.ascontiguousarray(triangles_mm.transpose(1, 0, 2))
    a, b, c = (corner - points_mm[..., None, :] for corner in corners)
    la, lb, lc = (np.sqrt(_dots(v, v)) for v in (a, b, c))
    across = _crosses(corners[1] - corners[0], corners[2] - corners[0])
    rest = la * lb * lc + _dots(a, b) * lc + _dots(b, c) * la + _dots(c, a) * lb
    return np.asarray(2 * np.arctan2(_dots(a, across), rest))


def _dots(u: FloatArray, v: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("...j,...j->...", u, v))


def _crosses(u: FloatArray, v: FloatArray) -> FloatArray:
    """As numpy.cross, without its cost for few rows."""
    x, y, z = u.T
    return np.stack(
        [
            y * v[:, 2] - z * v[:, 1],
            z * v[:, 0] - x * v[:, 2],
            x * v[:, 1] - y * v[:, 0],
        ],
        axis=1,
    )


def visible_first(
    occluders: Occluders, kept: IntArray, feature_mm: FloatArray, own: OwnFaces
) -> BoolArray:
    """Mask over ``kept``: triangles that see the feature whole at a sampled point.

    Only they can shape the region; what sampling misses is found afterwards.
    """
    lift = _LIFT_SHARE * occluders.extent_mm
    middle = feature_mm.mean(axis=0)
    triangles, normals = occluders.triangles_mm[kept], occluders.normals[kept]
    side = np.sign(normals @ middle - occluders.offsets_mm[kept])
    lifted = (2 * lift * np.where(side == 0, 1.0, side))[:, None] * normals
    points = np.einsum("sk,mkd->msd", _ON_TRIANGLE, triangles) + lifted[:, None]
    flat = points.reshape(-1, 3)
    alive = np.flatnonzero(~own.hides(flat))
    for sample in feature_samples(feature_mm):
        away = flat[alive] - sample
        length = np.linalg.norm(away, axis=1, keepdims=True)
        short = np.minimum(lift / np.maximum(length, 1e-300), 0.5) * away
        alive = alive[~occluders.rays.blocked(sample + short, flat[alive] - short)]
    seen = np.zeros(points.shape[:2], dtype=np.bool_)
    seen.reshape(-1)[alive] = True
    return np.asarray(seen.any(axis=1))


def feature_samples(feature_mm: FloatArray) -> FloatArray:
    """Points (k, 3) spread over a point, a segment or a convex polygon."""
    if len(feature_mm) == 1:
        return feature_mm
    middle = feature_mm.mean(axis=0)
    if len(feature_mm) == 2:
        share = np.array([0.5, 0.0, 1.0, 0.25, 0.75, 0.125, 0.875, 0.375, 0.625])
        return np.asarray(feature_mm[0] + share[:, None] * np.diff(feature_mm, axis=0))
    step = max(1, len(feature_mm) // 8)
    return np.concatenate([middle[None], feature_mm[::step]])
