"""Where a point lies with respect to a part: on it, in it, how far away."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import igl
import numpy as np

from mvp.errors import FeatureError
from mvp.geometry import FloatArray, IntArray, TriangleMesh, as_points

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

ON_PART_MM = 0.01
_HINT = "list what is on the part with `mvp-cell features PART`"


@dataclass(frozen=True, eq=False)
class Nearest:
    """The closest surface points of some query points.

    Attributes:
        distance_mm: (n,).
        triangle: (n,) the triangle of each.
        point_mm: (n, 3).
    """

    distance_mm: FloatArray
    triangle: IntArray
    point_mm: FloatArray


def nearest_on(mesh: TriangleMesh, points_part: FloatArray) -> Nearest:
    """Closest points of a mesh to points (n, 3), double precision."""
    points = np.ascontiguousarray(points_part.reshape(-1, 3))
    squared, triangle, closest = igl.point_mesh_squared_distance(
        points, np.array(mesh.vertices_mm), np.array(mesh.faces)
    )
    return Nearest(
        np.sqrt(np.asarray(squared).reshape(-1)),
        np.asarray(triangle, dtype=np.int64).reshape(-1),
        np.asarray(closest, dtype=np.float64).reshape(-1, 3),
    )


def winding_number(mesh: TriangleMesh, points_part: FloatArray) -> FloatArray:
    """Generalised winding number (n,): near 1 inside the material, near 0 outside."""
    number = igl.winding_number(
        np.array(mesh.vertices_mm), np.array(mesh.faces), points_part.reshape(-1, 3)
    )
    return np.asarray(number, dtype=np.float64).reshape(-1)


def checked_points(values: ArrayLike, *, feature: str) -> FloatArray:
    """Finite points (n, 3) of a feature.

    Raises:
        FeatureError: not numbers, not three coordinates each, or not finite.
    """
    try:
        return as_points(values).reshape(-1, 3)
    except (TypeError, ValueError) as error:
        raise FeatureError(
            f"feature '{feature}': {error}",
            hint="give three finite coordinates in mm, in the frame of the CAD file",
            where=feature,
        ) from error


def checked_mesh(mesh: TriangleMesh, *, feature: str) -> None:
    """Refuse a part without triangles.

    Raises:
        FeatureError: the mesh is empty.
    """
    if not len(mesh.faces):
        raise FeatureError(
            f"feature '{feature}': {mesh.name} has no surface",
            hint="give the CAD file of the part that carries the feature",
            where=feature,
        )


def require_on_part(
    mesh: TriangleMesh, points_part: FloatArray, *, feature: str, tolerance_mm: float
) -> Nearest:
    """The surface points of a feature that must lie on the part.

    Raises:
        FeatureError: a point is inside the solid or off the surface by more than the
            tolerance; the message tells the distance and the nearest point.
    """
    nearest = nearest_on(mesh, points_part)
    worst = int(np.argmax(nearest.distance_mm))
    distance = float(nearest.distance_mm[worst])
    if distance <= tolerance_mm:
        return nearest
    point, there = points_part.reshape(-1, 3)[worst], nearest.point_mm[worst]
    inside = winding_number(mesh, point[None])[0] > 0.5
    how = "inside the solid" if inside else "not on the part"
    raise FeatureError(
        f"feature '{feature}' is {how}: {tell(point)} is {distance:.3g} mm from the "
        f"nearest surface of {mesh.name}, at {tell(there)}",
        hint=f"correct the coordinates or the units; {_HINT}",
        where=feature,
    )


def tell(point: FloatArray) -> str:
    """A point as text, mm."""
    return "(" + ", ".join(f"{value:.4g}" for value in point + 0.0) + ")"
