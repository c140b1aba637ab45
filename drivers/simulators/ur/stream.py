"""Streamed motion: servoj, servol, speedj and speedl, one velocity per cycle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivers.simulators.ur.kinematics import Kinematics
    from drivers.simulators.ur.poses import Floats


class Stream(Protocol):
    """What drives the arm cycle by cycle."""

    @property
    def acceleration(self) -> float:
        """How fast the joints may change their speed, rad/s^2."""
        ...

    def wanted(self, joints: Floats) -> Floats:
        """(6,) rad/s that the joints should have now."""
        ...


@dataclass(frozen=True, eq=False)
class ServoStream:
    """Follow a target (6,) rad, as fast as the joints can."""

    target: Floats
    lookahead_s: float
    limit: Floats
    acceleration: float = 40.0

    def wanted(self, joints: Floats) -> Floats:
        """(6,) rad/s towards the target."""
        return np.clip(
            (self.target - joints) / self.lookahead_s, -self.limit, self.limit
        )


@dataclass(frozen=True, eq=False)
class SpeedStream:
    """Keep a joint velocity (6,) rad/s."""

    rate: Floats

    acceleration: float

    def wanted(self, joints: Floats) -> Floats:
        """(6,) rad/s, the same everywhere."""
        del joints
        return self.rate


@dataclass(frozen=True, eq=False)
class ToolSpeedStream:
    """Keep a velocity (6,) m/s and rad/s of the tool centre point."""

    kin: Kinematics
    velocity: Floats
    tcp: Sequence[float]

    acceleration: float

    def wanted(self, joints: Floats) -> Floats:
        """(6,) rad/s; the least norm next to a singularity."""
        jacobian = self.kin.jacobian(joints, self.tcp)
        rate = np.linalg.pinv(jacobian, rcond=1e-3) @ self.velocity
        limit = self.kin.arm.joint_speed
        return np.asarray(rate / max(1.0, float((np.abs(rate) / limit).max())))
