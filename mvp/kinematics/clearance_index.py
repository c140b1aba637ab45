"""How many standard deviations a configuration is from touching something."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from mvp.geometry import FloatArray
    from mvp.kinematics.capsule import Capsules
    from mvp.kinematics.clearance import CellBodies

_STEP_MM = 0.05
_STEP_RAD = 1e-4


@dataclass(frozen=True)
class ClearanceIndex:
    """The pair that the stated errors bring together first.

    Attributes:
        sigmas: (distance - asked) / standard deviation of the distance.
        body: link, camera or lens.
        other: obstacle.
    """

    sigmas: float
    body: str
    other: str


def clearance_index(
    bodies: CellBodies,
    joints: FloatArray,
    *,
    pupil_mm: FloatArray,
    part_mm: FloatArray,
    asked_mm: float,
    position_mm: float,
    angle_rad: float,
) -> ClearanceIndex | None:
    """The smallest index of all pairs, first order.

    The stated errors are those of the camera against the part. Camera and lens are
    displaced with it: shifted along, and turned about, three axes through the pupil.
    For a link of the arm only the share of the part counts, which shifts and turns about
    its own middle; that share is not stated, and all of the error is taken. Bodies of
    the arm keep their distances to each other and have no index; nor have pairs farther
    apart than ``bodies.far_mm``.

    Args:
        bodies: everything in the cell.
        joints: (dof,) the configuration.
        pupil_mm: (3,) entrance pupil, base frame.
        part_mm: (3,) middle of the part, base frame.
        asked_mm: distance below which a pair fails.
        position_mm: standard deviation of the shift along each axis.
        angle_rad: standard deviation of the turn about each axis.

    Returns:
        None when no error can bring anything together.
    """
    here = bodies.moving(np.asarray(joints, np.float64)[None])
    distance, names, _ = bodies.to_obstacles(here)
    links = len(here.names) - len(bodies.tool_bodies)
    tools = np.arange(len(here.names)) >= links
    shifted = _displaced(here, np.where(tools[:, None], pupil_mm, part_mm))
    plus, minus = bodies.to_obstacles(shifted)[0].reshape(2, 6, -1)
    step = np.repeat([_STEP_MM, _STEP_RAD], 3)[:, None]
    slope = (plus - minus) / (2 * step)
    spread = slope * np.repeat([position_mm, angle_rad], 3)[:, None]
    deviation = np.sqrt((spread**2).sum(axis=0))
    moved = deviation > 0
    if not moved.any():
        return None
    index = np.full(len(names), np.inf)
    index[moved] = (distance[0, moved] - asked_mm) / deviation[moved]
    first = int(index.argmin())
    return ClearanceIndex(float(index[first]), *names[first])


def _displaced(bodies: Capsules, centres_mm: FloatArray) -> Capsules:
    """M = 12 displacements of M = 1: forward along and about x, y, z, then backward.

    Each of the k bodies turns about its own centre (k, 3).
    """
    shift = np.zeros((12, 3))
    shift[:3] = _STEP_MM * np.eye(3)
    turn = np.zeros((12, 3))
    turn[3:6] = _STEP_RAD * np.eye(3)
    shift[6:], turn[6:] = -shift[:6], -turn[:6]
    from scipy.spatial.transform import Rotation

    rotation = Rotation.from_rotvec(turn).as_matrix()

    def moved(points: FloatArray) -> FloatArray:
        arms = np.einsum("mij,kj->mki", rotation, points[0] - centres_mm)
        return np.asarray(arms + centres_mm + shift[:, None])

    return replace(bodies, start_mm=moved(bodies.start_mm), end_mm=moved(bodies.end_mm))
