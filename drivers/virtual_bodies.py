"""What truly stands in the virtual cell, with the errors of its making."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mvp.geometry import (
    Box,
    Pose,
    TriangleMesh,
    box_mesh,
)
from mvp.imaging import RenderBody, printed_target

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivers.virtual_settings import (
        Occluder,
        TargetSettings,
        WorldErrors,
        WorldSettings,
    )
    from mvp.devices import WorldBelief

_VERTEX_MM = 1e-3  # corners this close are the one that is meant


def true_part(mesh: TriangleMesh, errors: WorldErrors) -> TriangleMesh:
    """The part with moved corners, then scaled about its origin."""
    vertices = np.array(mesh.vertices_mm)
    for change in errors.moved_vertices:
        gap = np.linalg.norm(mesh.vertices_mm - np.array(change.at_mm), axis=1)
        vertices[gap < _VERTEX_MM] += np.array(change.by_mm)
    return TriangleMesh(
        vertices * errors.part_scale, mesh.faces, mesh.face_ids, mesh.name
    )


def true_bodies(
    belief: WorldBelief,
    base_from_part: Pose,
    settings: WorldSettings,
    errors: WorldErrors,
    occluders: Sequence[Occluder],
) -> tuple[RenderBody, ...]:
    """Part, fixtures and stray boxes in the base frame."""
    part = RenderBody(
        true_part(belief.part, errors), settings.part_albedo, base_from_part
    )
    fixtures = [RenderBody(mesh, settings.fixture_albedo) for mesh in belief.fixtures]
    strays = [
        RenderBody(
            box_mesh(Box(np.array(o.low_mm), np.array(o.high_mm)), name=o.name),
            o.albedo,
            base_from_part,
        )
        for o in occluders
    ]
    return (part, *fixtures, *strays)


def true_target(target: TargetSettings) -> RenderBody:
    """A printed target where it truly lies.

    Raises:
        ConfigError: its marker dictionary is not known.
    """
    turn = np.radians(target.rotation_deg)
    pose = Pose.from_rotvec("base", "target", turn, np.array(target.position_mm))
    return printed_target(target, pose)
