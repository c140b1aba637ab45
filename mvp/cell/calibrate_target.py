"""The calibration target as a body that must not be touched, and must be seen."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mvp.geometry import Box, box_mesh
from mvp.imaging.printed_target import extent_mm
from mvp.kinematics import Obstacle

if TYPE_CHECKING:
    from mvp.geometry import FloatArray
    from mvp.wizard import SessionFacts

_BOARD_MM = 5.0  # behind its print


def target_corners_mm(facts: SessionFacts) -> FloatArray:
    """(4, 3) corners of the print; none without a target."""
    if facts.target is None:
        return np.zeros((0, 3))
    low, high = extent_mm(facts.target)
    flat = [[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]]
    corners = np.column_stack([np.array(flat), np.zeros(4)])
    return facts.target.base_from_target.apply(corners)


def target_obstacle(facts: SessionFacts) -> tuple[Obstacle, ...]:
    """The target as a body, grown by how unsure its place is."""
    target = facts.target
    if target is None:
        return ()
    grow = target.position_sigma_mm
    low, high = extent_mm(target)
    box = Box(
        np.array([*(low - grow), -grow]), np.array([*(high + grow), _BOARD_MM + grow])
    )
    mesh = box_mesh(box, name="target")
    return (Obstacle("target", mesh.moved(target.base_from_target)),)
