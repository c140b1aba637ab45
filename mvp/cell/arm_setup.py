"""The arm in its cell: bodies, hand-eye at a lens setting, and a quick reach filter."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from mvp.cell.target_body import target_obstacles
from mvp.constraints.clearance import CameraClearance
from mvp.constraints.reach import Reach
from mvp.geometry import Box, TriangleMesh
from mvp.kinematics import (
    Capsule,
    CellBodies,
    MountedCamera,
    Placement,
    obstacles,
)

if TYPE_CHECKING:
    from mvp.cell.loading import LoadedCell
    from mvp.cell.task_scene import TaskScene
    from mvp.geometry import BoolArray, FloatArray
    from mvp.optics import LensSetting, Views

_QUICK_ROLLS = 12


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
        """Arm, camera, part, fixtures, keep-outs and target, base frame."""
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
        board = target_obstacles(config.target)
        return CellBodies(self.cell.arm, tools, (*found, *board))

    @property
    def clearance_mm(self) -> float:
        """Distance asked between any two bodies."""
        return self.cell.config.kinematics.clearance_mm

    @cached_property
    def _mounted(self) -> MountedCamera:
        found = self.cell.calibrations
        return MountedCamera.of(found.camera, found.lens_table, found.hand_eye)

    def placement(self, lens: LensSetting, targets_part_mm: FloatArray) -> Placement:
        """What a view with this lens setting is realised with."""
        found = self.cell.calibrations
        return Placement(
            self.bodies,
            found.base_from_part,
            self._mounted.tool_from_camera_at(lens),
            self.cell.joint_margin,
            clearance_mm=self.clearance_mm,
            reference=self.cell.home_joints,
            targets_part_mm=targets_part_mm,
            singularity_margin=self.cell.config.kinematics.singularity_margin,
        )

    @cached_property
    def _reach(self) -> Reach:
        found = self.cell.calibrations
        return Reach(
            self.cell.arm,
            found.base_from_part,
            found.tool_from_camera,
            found.hand_eye.reference_d_mm,
            self.cell.joint_margin,
            rolls=_QUICK_ROLLS if self.free_roll else 0,
        )

    @cached_property
    def _camera_clearance(self) -> CameraClearance:
        found = self.cell.calibrations
        return CameraClearance(
            self.bodies.tool_bodies,
            self.bodies.obstacles,
            found.base_from_part,
            found.tool_from_camera,
            found.hand_eye.reference_d_mm,
        )

    def reachable_and_clear(self, views: Views) -> BoolArray:
        """``reachable``, and the camera itself touches nothing at its own roll."""
        good = self.reachable(views)
        left = np.flatnonzero(good)
        if len(left):
            there = self._carried(views[left])
            distance = self._camera_clearance.distances_mm(there)
            good[left] = distance >= self.clearance_mm
        return good

    def reachable(self, views: Views) -> BoolArray:
        """Which views some roll and branch of the arm can take, (N,); no clearance."""
        return self._reach.reachable(self._carried(views))

    def _carried(self, views: Views) -> Views:
        """The same with d where the pupil would stand so if it followed d alone."""
        shifts = self._mounted.pupil_shifts_mm(views.f_mm)
        return views if shifts is None else replace(views, d_mm=views.d_mm + shifts)
