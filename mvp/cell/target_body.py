"""The calibration target as a body that arm and camera must not touch."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mvp.geometry import Box, Pose, box_mesh
from mvp.imaging.printed_target import extent_mm
from mvp.kinematics import Obstacle

if TYPE_CHECKING:
    from mvp.cell.cell_config import TargetConfig

_THICK_MM = 5.0


def target_obstacles(target: TargetConfig | None) -> tuple[Obstacle, ...]:
    """The board where the cell says it lies, grown by how unsure that is; base frame."""
    if target is None:
        return ()
    low, high = extent_mm(target)
    grow = target.position_sigma_mm
    box = Box(
        np.array([*(low - grow), -grow]), np.array([*(high + grow), _THICK_MM + grow])
    )
    turn = np.radians(target.rotation_deg)
    pose = Pose.from_rotvec("base", "target", turn, np.array(target.position_mm))
    return (Obstacle("target", box_mesh(box, name="target").moved(pose)),)
