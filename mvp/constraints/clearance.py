"""Clearance of camera and lens at a view, before the arm is looked at.

A view whose camera touches the part is lost for every arm; links and paths are judged
by ``mvp.kinematics`` once a branch is chosen. Exact distances, not rows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from mvp.kinematics import carried

if TYPE_CHECKING:
    from mvp.geometry import FloatArray, Pose
    from mvp.kinematics import Capsule, Obstacle
    from mvp.optics import Views

KIND: Literal["clearance"] = "clearance"
UNIT = "mm"


@dataclass(frozen=True, eq=False)
class CameraClearance:
    """Bodies on the flange against what stands in the cell.

    Attributes:
        tool_bodies: capsules in the tool frame.
        obstacles: base frame.
        base_from_part: the part's pose.
        tool_from_camera: hand-eye at ``reference_d_mm``.
        reference_d_mm: None: the pupil is taken not to move with d.
        far_mm: distances are not followed beyond this.
    """

    tool_bodies: tuple[Capsule, ...]
    obstacles: tuple[Obstacle, ...]
    base_from_part: Pose
    tool_from_camera: Pose
    reference_d_mm: float | None
    far_mm: float = 250.0

    def distances_mm(self, views: Views) -> FloatArray:
        """Signed distance (N,) of the closest pair at each view, at its own roll."""
        part, hand = self.base_from_part, self.tool_from_camera
        cameras = part.rotation @ views.rotation
        moved = np.zeros(len(views))
        if self.reference_d_mm is not None:
            moved = views.d_mm - self.reference_d_mm
        pupil = part.apply(views.position_mm) - moved[:, None] * cameras[:, :, 2]
        tools = cameras @ hand.rotation.T
        bodies = carried(self.tool_bodies, tools, pupil - tools @ hand.translation_mm)
        start, end = (p.reshape(-1, 3) for p in (bodies.start_mm, bodies.end_mm))
        nearest = np.full(len(views), self.far_mm)
        for obstacle in self.obstacles:
            gap = obstacle.distance(start, end, self.far_mm).reshape(len(views), -1)
            closest = (gap - bodies.radius_mm).min(axis=1, initial=self.far_mm)
            nearest = np.minimum(nearest, closest)
        return np.asarray(nearest)
