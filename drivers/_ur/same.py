"""Whether what the controller says is what was set, within its own rounding."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mvp.geometry import Pose

if TYPE_CHECKING:
    from collections.abc import Sequence

_TCP_TOLERANCE = 1e-5  # m and rad


def differ(found: Sequence[float], asked: Sequence[float], tolerance: float) -> bool:
    if len(found) != len(asked):
        return True
    return bool(np.abs(np.subtract(found, asked)).max() > tolerance)


def same_pose(found: Sequence[float], asked: Sequence[float]) -> bool:
    """Rotation vectors of half a turn have two names; their matrices do not."""
    if len(found) != len(asked):
        return False
    one, other = (
        Pose.from_rotvec("tool", "tcp", pose[3:], np.array(pose[:3])).matrix
        for pose in (found, asked)
    )
    return bool(np.abs(one - other).max() < _TCP_TOLERANCE)


def same_model(said: str, configured: str) -> bool:
    """Whether a name on the dashboard can be the configured model.

    Older software calls a UR5e "UR5", and the 7e and 12e by the arms they grew from.
    """
    size = "".join(c for c in said if c.isdigit())
    own = "".join(c for c in configured if c.isdigit())
    return size == own or (own, size) in {("7", "5"), ("12", "10")}
