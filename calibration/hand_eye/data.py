"""What a hand-eye calibration is made from: robot poses, pictures of a target, noise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibration.hand_eye.motions import fixed_from_moving

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibration.hand_eye.motions import Mount
    from calibration.observations import Observations
    from calibration.poses import Poses
    from mvp.geometry import FloatArray

REPEATABILITY_TO_ACCURACY = 5.0
_ORTHONORMAL = 1e-6


@dataclass(frozen=True)
class RobotNoise:
    """How far off a pose that the robot reports may be: one sigma, on each axis."""

    position_mm: float
    angle_rad: float

    def __post_init__(self) -> None:
        if not (self.position_mm > 0 and self.angle_rad > 0):
            raise ValueError("the noise of a robot is positive")

    @classmethod
    def from_repeatability(
        cls, position_mm: float, reach_mm: float, angle_rad: float | None = None
    ) -> RobotNoise:
        """From a datasheet.

        Repeatability says how well a pose is found again; between different poses arms
        are several times worse. Too wide a guess costs next to nothing, too narrow a
        one does harm, so five times the repeatability is assumed.

        Args:
            position_mm: repeatability.
            reach_mm: of the arm; gives the angle where the datasheet has none.
            angle_rad: repeatability of the orientation.
        """
        angle = 3 * position_mm / reach_mm if angle_rad is None else angle_rad
        return cls(
            REPEATABILITY_TO_ACCURACY * position_mm, REPEATABILITY_TO_ACCURACY * angle
        )

    @property
    def sigmas(self) -> FloatArray:
        """(6,): translation (mm), then rotation (rad)."""
        return np.repeat([self.position_mm, self.angle_rad], 3)


@dataclass(frozen=True, eq=False)
class HandEyeData:
    """One robot pose and one picture of the target for each view.

    Attributes:
        base_from_tool: as the robot told, mm.
        seen: points of the target and where they were found.
        mount: the camera on the hand, or beside the robot with the target on the hand.
        sigma_px: one standard deviation of each coordinate of a found point.
        settled: (n,) the arm stood still when the picture was taken; empty if unknown.
    """

    base_from_tool: Poses
    seen: Observations
    mount: Mount = "eye-in-hand"
    sigma_px: float = 0.2
    settled: tuple[bool, ...] = ()

    def __post_init__(self) -> None:
        if len(self.base_from_tool) != self.seen.views:
            raise ValueError(
                f"{len(self.base_from_tool)} robot poses for {self.seen.views} pictures"
            )
        if self.settled and len(self.settled) != self.seen.views:
            raise ValueError("settled is known for every view or for none")
        if not self.sigma_px > 0:
            raise ValueError("sigma_px is positive")
        for view, name in enumerate(self.seen.names):
            _check_pose(self.base_from_tool, view, name)

    @property
    def fixed_from_moving(self) -> Poses:
        """The robot's part of the chain, see ``motions``."""
        return fixed_from_moving(self.base_from_tool, self.mount)

    @property
    def frames(self) -> tuple[str, str]:
        """The moving frame (of X) and the fixed frame (of Z)."""
        return ("tool", "base") if self.mount == "eye-in-hand" else ("base", "tool")

    def of_views(self, numbers: Sequence[int]) -> HandEyeData:
        """Only these views."""
        index = np.asarray(numbers, dtype=np.int64)
        return HandEyeData(
            self.base_from_tool[index],
            self.seen.of_views(index),
            self.mount,
            self.sigma_px,
            tuple(self.settled[i] for i in index) if self.settled else (),
        )


def _check_pose(poses: Poses, view: int, name: str) -> None:
    rotation, place = poses.rotation[view], poses.translation_mm[view]
    if not (np.isfinite(rotation).all() and np.isfinite(place).all()):
        raise ValueError(f"the robot pose of {name} is not finite")
    square = np.allclose(rotation @ rotation.T, np.eye(3), atol=_ORTHONORMAL)
    if not square or np.linalg.det(rotation) < 0:
        raise ValueError(
            f"the robot pose of {name} is not a rotation (mirrored or scaled axes)"
        )
