"""Where the camera sits and where the target lies, well enough to aim with.

Before hand-eye is calibrated both are known roughly only. Every picture tells where the
target is seen from; hand-eye and target follow by least squares with what was believed
before as a prior, so that the aim gets better from the first picture on.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from calibration.poses import Poses, difference
from calibration.projection import moved_pose

if TYPE_CHECKING:
    from mvp.geometry import FloatArray

_ROUNDS = 12
_STEP = np.repeat([1e-4, 1e-7], 3)


@dataclass(frozen=True)
class Doubt:
    """One standard deviation on each axis: of a length and of an angle."""

    position_mm: float
    angle_rad: float

    @property
    def sigmas(self) -> FloatArray:
        """(6,): translation (mm), then rotation (rad)."""
        return np.repeat([self.position_mm, self.angle_rad], 3)


@dataclass(frozen=True, eq=False)
class Aim:
    """A belief to aim with.

    Attributes:
        tool_from_camera: a set of one.
        base_from_target: a set of one.
        camera_doubt: of the first, tool axes.
        target_doubt: of the second, base axes.
        sight_doubt: of where one picture puts the target, camera axes.
    """

    tool_from_camera: Poses
    base_from_target: Poses
    camera_doubt: Doubt = Doubt(10.0, 0.05)
    target_doubt: Doubt = Doubt(20.0, 0.1)
    sight_doubt: Doubt = Doubt(1.0, 0.005)

    def tool_for(self, camera_from_target: Poses) -> Poses:
        """``base_from_tool`` of views."""
        camera = self.base_from_target @ camera_from_target.inverse()
        return camera @ self.tool_from_camera.inverse()

    def seen_from(self, base_from_tool: Poses) -> Poses:
        """``camera_from_target`` where the arm stands."""
        camera = base_from_tool @ self.tool_from_camera
        return camera.inverse() @ self.base_from_target

    def after(self, base_from_tool: Poses, camera_from_target: Poses) -> Aim:
        """Improved by what was seen; always starts from this belief.

        Args:
            base_from_tool: n poses as the arm told.
            camera_from_target: n poses from the pictures.
        """
        state = self.tool_from_camera, self.base_from_target
        for _ in range(_ROUNDS):
            rest = self._rest(state, base_from_tool, camera_from_target)
            slope = np.empty((len(rest), 12))
            for k in range(12):
                step = np.zeros(12)
                step[k] = _STEP[k % 6]
                moved = _moved(state, step)
                there = self._rest(moved, base_from_tool, camera_from_target)
                slope[:, k] = (there - rest) / step[k]
            change = np.asarray(
                -np.linalg.lstsq(slope, rest, rcond=None)[0], np.float64
            )
            state = _moved(state, change)
            if np.abs(change / np.tile(_STEP, 2)).max() < 1.0:
                break
        return replace(self, tool_from_camera=state[0], base_from_target=state[1])

    def _rest(
        self, state: tuple[Poses, Poses], base_from_tool: Poses, seen: Poses
    ) -> FloatArray:
        """Whitened: sights, then the two beliefs."""
        there = replace(self, tool_from_camera=state[0], base_from_target=state[1])
        sights = difference(there.seen_from(base_from_tool), seen)
        camera = difference(state[0], self.tool_from_camera)
        target = difference(state[1], self.base_from_target)
        return np.concatenate(
            [
                (sights / self.sight_doubt.sigmas).ravel(),
                (camera / self.camera_doubt.sigmas).ravel(),
                (target / self.target_doubt.sigmas).ravel(),
            ]
        )


def _moved(state: tuple[Poses, Poses], step: FloatArray) -> tuple[Poses, Poses]:
    camera, target = state
    return (
        Poses(*moved_pose(camera.rotation, camera.translation_mm, step[None, :6])),
        Poses(*moved_pose(target.rotation, target.translation_mm, step[None, 6:])),
    )
