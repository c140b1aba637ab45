"""The arm in its cell: bodies, hand-eye at a lens setting, and a quick reach filter."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from mvp.geometry import Box, TriangleMesh
from mvp.kinematics import (
    Capsule,
    CellBodies,
    Placement,
    camera_rotation,
    obstacles,
    tool_from_camera_at,
)

if TYPE_CHECKING:
    from mvp.cell.loading import LoadedCell
    from mvp.cell.task_scene import TaskScene
    from mvp.geometry import BoolArray, FloatArray
    from mvp.optics import Views

_QUICK_ROLLS = 12
_AT_ONCE = 512


@dataclass(frozen=True, eq=False)
class ArmSetup:
    """Everything about the arm that planning and preflight ask.

    Attributes:
        free_roll: any roll of the camera will do.
    """

    cell: LoadedCell
    scene: TaskScene
    free_roll: bool

    @cached_property
    def bodies(self) -> CellBodies:
        """Arm, camera, part, fixtures and keep-outs, base frame."""
        config = self.cell.config
        part = self.scene.scene.part.moved(self.cell.calibrations.base_from_part)
        named = TriangleMesh(part.vertices_mm, part.faces, part.face_ids, "part")
        keep_outs = [
            (k.name, Box(np.array(k.low_mm), np.array(k.high_mm)))
            for k in config.keep_outs
        ]
        tools = tuple(
            Capsule(b.name, np.array(b.from_mm), np.array(b.to_mm), b.radius_mm)
            for b in config.kinematics.tool_bodies
        )
        found = obstacles(named, self.scene.fixtures_base, keep_outs)
        return CellBodies(self.cell.arm, tools, found)

    @property
    def clearance_mm(self) -> float:
        """Distance asked between any two bodies."""
        return self.cell.config.kinematics.clearance_mm

    def placement(self, d_mm: float, targets_part_mm: FloatArray) -> Placement:
        """What a view with this lens setting is realised with."""
        found = self.cell.calibrations
        hand = tool_from_camera_at(
            found.tool_from_camera,
            d_mm=d_mm,
            reference_d_mm=found.hand_eye.reference_d_mm,
        )
        return Placement(
            self.bodies,
            found.base_from_part,
            hand,
            self.cell.joint_margin,
            clearance_mm=self.clearance_mm,
            reference=self.cell.home_joints,
            targets_part_mm=targets_part_mm,
        )

    def reachable(self, views: Views) -> BoolArray:
        """Which views some roll and branch of the arm can take, (N,); no clearance."""
        found = [
            self._reachable(views[start : start + _AT_ONCE])
            for start in range(0, len(views), _AT_ONCE)
        ]
        return np.concatenate(found) if found else np.zeros(0, dtype=bool)

    def _reachable(self, views: Views) -> BoolArray:
        arm, found = self.cell.arm, self.cell.calibrations
        part, hand = found.base_from_part, found.tool_from_camera
        asked = views.rotation[:, None]
        if self.free_roll:
            turn = np.linspace(0, 2 * np.pi, _QUICK_ROLLS, endpoint=False)
            asked = camera_rotation(views.direction[:, None], turn[None])
        cameras = part.rotation @ asked
        given = arm.camera_rotations(cameras[:, 0, :, 2], cameras, hand.rotation)
        reference = found.hand_eye.reference_d_mm
        moved = np.zeros(len(views)) if reference is None else views.d_mm - reference
        pupil = part.apply(views.position_mm) - moved[:, None] * cameras[:, 0, :, 2]
        tools = given @ hand.rotation.T
        flange = pupil[:, None] - tools @ hand.translation_mm
        count = len(views) * tools.shape[1]
        joints, exists = arm.inverse_batch(
            tools.reshape(count, 3, 3),
            flange.reshape(count, 3),
            near=self.cell.home_joints,
        )
        low = arm.joint_low + self.cell.joint_margin
        high = arm.joint_high - self.cell.joint_margin
        with np.errstate(invalid="ignore"):
            inside = ((joints >= low) & (joints <= high)).all(axis=-1) & exists
        return np.asarray(inside.reshape(len(views), -1).any(axis=1))
