"""A hole that a task describes by coordinates, found on the part."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from mvp.errors import FeatureError
from mvp.scene.holes import find_holes
from mvp.scene.surface import checked_mesh, checked_points, tell

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.geometry import FloatArray, TriangleMesh
    from mvp.scene.hole_feature import HoleFeature


class HoleByPlace(Protocol):
    """A hole as a task describes it: its near rim, part frame."""

    @property
    def id(self) -> str:
        """Name of the feature."""
        ...

    @property
    def centre_mm(self) -> Sequence[float]:
        """Centre of the rim."""
        ...

    @property
    def axis(self) -> Sequence[float]:
        """Direction out of the part, any length."""
        ...

    @property
    def diameter_mm(self) -> float:
        """Of the rim."""
        ...


def hole_feature_at(wanted: HoleByPlace, mesh: TriangleMesh) -> HoleFeature:
    """The hole on the part that a description names.

    Centre and diameter must agree with the part to 2 % of the diameter (at least
    0.05 mm); the feature then has the part's own centre, axis and rim.

    Raises:
        FeatureError: not finite, or no such hole; the nearest one is told.
    """
    checked_mesh(mesh, feature=wanted.id)
    centre = checked_points(wanted.centre_mm, feature=wanted.id)[0]
    axis = checked_points(wanted.axis, feature=wanted.id)[0]
    if not np.linalg.norm(axis) > 0 or not wanted.diameter_mm > 0:
        raise FeatureError(
            f"feature '{wanted.id}': a hole needs an axis and a diameter above zero",
            hint="give the direction out of the part, and the diameter in mm",
            where=wanted.id,
        )
    axis = axis / np.linalg.norm(axis)
    slack = max(0.02 * wanted.diameter_mm, 0.05)
    holes = sorted(
        find_holes(mesh),
        key=lambda hole: float(np.linalg.norm(hole.centre_mm - centre)),
    )
    for hole in holes:
        if (
            np.linalg.norm(hole.centre_mm - centre) <= slack
            and abs(hole.diameter_mm - wanted.diameter_mm) <= slack
            and hole.axis @ axis > 0.99
        ):
            return replace(hole, id=wanted.id)
    raise _no_such_hole(wanted.id, holes, mesh, centre)


def _no_such_hole(
    id: str, holes: list[HoleFeature], mesh: TriangleMesh, centre: FloatArray
) -> FeatureError:
    told = f"{mesh.name} has no round hole"
    if holes:
        near = holes[0]
        told = (
            f"the nearest hole of {mesh.name} has its rim at {tell(near.centre_mm)}, axis "
            f"{tell(near.axis)}, diameter {near.diameter_mm:.4g} mm"
        )
    return FeatureError(
        f"feature '{id}': no such hole at {tell(centre)}; {told}",
        hint="list the holes with `mvp-cell features PART`; the axis points out of the "
        "part, and a through hole has a rim on each side",
        where=id,
    )
