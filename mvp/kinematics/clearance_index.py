"""How many standard deviations a configuration is from touching something."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

if TYPE_CHECKING:
    from mvp.geometry import FloatArray
    from mvp.kinematics.capsule import Capsules
    from mvp.kinematics.clearance import CellBodies

_STEP_MM = 0.05
_STEP_RAD = 1e-4


def clearance_index(
    bodies: CellBodies,
    joints: FloatArray,
    *,
    pupil_mm: FloatArray,
    asked_mm: float,
    position_mm: float,
    angle_rad: float,
) -> float | None:
    """Smallest (distance - asked) / standard deviation of the distance, over all pairs.

    The errors displace arm, camera and lens as one rigid body against what stands in
    the cell: shifts along, and turns about, three axes through the pupil. Bodies of the
    arm keep their distances to each other and have no index; nor have pairs farther
    apart than ``bodies.far_mm``.

    Args:
        bodies: everything in the cell.
        joints: (dof,) the configuration.
        pupil_mm: (3,) entrance pupil, base frame.
        asked_mm: distance below which a pair fails.
        position_mm: standard deviation of the shift along each axis.
        angle_rad: standard deviation of the turn about each axis.

    Returns:
        None when no error can bring anything together.
    """
    here = bodies.moving(np.asarray(joints, np.float64)[None])
    distance = bodies.to_obstacles(here)[0]
    shifted = _displaced(here, pupil_mm)
    plus, minus = bodies.to_obstacles(shifted).reshape(2, 6, -1)
    step = np.repeat([_STEP_MM, _STEP_RAD], 3)[:, None]
    slope = (plus - minus) / (2 * step)
    spread = slope * np.repeat([position_mm, angle_rad], 3)[:, None]
    deviation = np.sqrt((spread**2).sum(axis=0))
    moved = deviation > 0
    if not moved.any():
        return None
    return float(((distance[moved] - asked_mm) / deviation[moved]).min())


def _displaced(bodies: Capsules, centre_mm: FloatArray) -> Capsules:
    """M = 12 displacements of M = 1: forward along and about x, y, z, then backward."""
    shift = np.zeros((12, 3))
    shift[:3] = _STEP_MM * np.eye(3)
    turn = np.zeros((12, 3))
    turn[3:6] = _STEP_RAD * np.eye(3)
    shift[6:], turn[6:] = -shift[:6], -turn[:6]
    rotation = Rotation.from_rotvec(turn).as_matrix()

    def moved(points: FloatArray) -> FloatArray:
        arms = np.einsum("mij,kj->mki", rotation, points[0] - centre_mm)
        return np.asarray(arms + centre_mm + shift[:, None])

    return replace(bodies, start_mm=moved(bodies.start_mm), end_mm=moved(bodies.end_mm))
