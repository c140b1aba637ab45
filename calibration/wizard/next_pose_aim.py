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
        camera, target = self.tool_from_camera, self.base_from_target
        trials = np.vstack([np.zeros(12), np.diag(np.tile(_STEP, 2))])
        for _ in range(_ROUNDS):
            moved = _moved(camera, target, trials)
            rest = self._rest(*moved, base_from_tool, camera_from_target)
            slope = (rest[1:] - rest[0]).T / np.tile(_STEP, 2)
            change = np.asarray(
                -np.linalg.lstsq(slope, rest[0], rcond=None)[0], np.float64
            )
            camera, target = _moved(camera, target, change[None])
            if np.abs(change / np.tile(_STEP, 2)).max() < 1.0:
                break
        return replace(self, tool_from_camera=camera, base_from_target=target)

    def _rest(
        self, cameras: Poses, targets: Poses, base_from_tool: Poses, seen: Poses
    ) -> FloatArray:
        """Whitened, one row for each of k beliefs: sights, then off the first belief."""
        count, views = len(cameras), len(seen)
        belief = np.repeat(np.arange(count), views)
        view = np.tile(np.arange(views), count)
        camera = base_from_tool[view] @ cameras[belief]
        sights = difference(camera.inverse() @ targets[belief], seen[view])
        return np.hstack(
            [
                (sights / self.sight_doubt.sigmas).reshape(count, -1),
                difference(cameras, self.tool_from_camera) / self.camera_doubt.sigmas,
                difference(targets, self.base_from_target) / self.target_doubt.sigmas,
            ]
        )


def _moved(camera: Poses, target: Poses, steps: FloatArray) -> tuple[Poses, Poses]:
    """Both sets of one after k small steps (k, 12)."""
    return (
        Poses(*moved_pose(camera.rotation, camera.translation_mm, steps[:, :6])),
        Poses(*moved_pose(target.rotation, target.translation_mm, steps[:, 6:])),
    )
