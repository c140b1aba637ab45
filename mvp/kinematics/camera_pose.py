"""From a planned view to the pose of the arm's flange: the paper's (19)-(25).

The paper's H_go, H_gw, H_oc, H_cg, H_wo are here part_from_tool, base_from_tool,
camera_from_part, tool_from_camera and part_from_base.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mvp.geometry import FloatArray, Pose, unit
from mvp.optics import pupil_shift_mm

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

_STRAIGHT = 1e-6  # sine of the angle to z below which (24) is singular


def camera_rotation(direction: ArrayLike, roll_rad: ArrayLike = 0.0) -> FloatArray:
    """Camera axes (..., 3, 3) as columns x, y, nu in the frame of the direction.

    Roll 0 is (24) with the + sign: x parallel to the object's xy plane, image upright
    for y pointing down the picture; roll pi is the - sign. The camera is turned about
    its own z by ``roll_rad``. Where nu is parallel to the object's z, (24) says nothing
    and x starts along the object's x. Inputs broadcast.
    """
    z = unit(direction)
    roll = np.asarray(roll_rad, dtype=np.float64)
    z = np.broadcast_to(z, (*np.broadcast_shapes(z.shape[:-1], roll.shape), 3))
    level = np.cross(z, [0.0, 0.0, 1.0])
    length = np.linalg.norm(level, axis=-1, keepdims=True)
    straight = length < _STRAIGHT
    x = np.where(straight, [1.0, 0.0, 0.0], level / np.where(straight, 1.0, length))
    x = unit(x - (x * z).sum(axis=-1, keepdims=True) * z)
    y = np.cross(z, x)
    c, s = np.cos(roll)[..., None], np.sin(roll)[..., None]
    return np.stack([c * x + s * y, c * y - s * x, z], axis=-1)


def roll_of(rotation: ArrayLike) -> FloatArray:
    """The roll (...), in (-pi, pi], that ``camera_rotation`` needs for an orientation.

    Args:
        rotation: (..., 3, 3) columns are the camera's axes.
    """
    axes = np.asarray(rotation, dtype=np.float64)
    level = camera_rotation(axes[..., :, 2])
    x = axes[..., :, 0]
    return np.asarray(
        np.arctan2(
            (x * level[..., :, 1]).sum(axis=-1), (x * level[..., :, 0]).sum(axis=-1)
        )
    )


def part_from_camera(
    position_mm: ArrayLike, direction: ArrayLike, roll_rad: float = 0.0
) -> Pose:
    """The camera of a planned view: the inverse of (21)-(25).

    Args:
        position_mm: (3,) entrance pupil r_V in the part frame.
        direction: (3,) viewing direction nu, any length.
        roll_rad: see ``camera_rotation``.
    """
    rotation = camera_rotation(direction, roll_rad)
    return Pose("part", "camera", rotation, np.asarray(position_mm, np.float64))


def tool_from_camera_at(
    tool_from_camera: Pose, *, d_mm: float, reference_d_mm: float | None
) -> Pose:
    """The hand-eye transform at another lens setting than the calibrated one.

    Args:
        tool_from_camera: as calibrated.
        d_mm: the setting asked for.
        reference_d_mm: the setting it was calibrated at; None: taken to be the same.
    """
    if reference_d_mm is None:
        return tool_from_camera
    shift = [0.0, 0.0, float(pupil_shift_mm(d_mm, reference_d_mm))]
    return tool_from_camera @ Pose("camera", "camera", np.eye(3), np.array(shift))


def base_from_tool(
    base_from_part: Pose, part_from_camera: Pose, tool_from_camera: Pose
) -> Pose:
    """Where the flange must be: (20), base_from_part part_from_camera camera_from_tool."""
    return base_from_part @ part_from_camera @ tool_from_camera.inverse()


def base_from_part(
    base_from_tool: Pose, tool_from_camera: Pose, part_from_camera: Pose
) -> Pose:
    """Where the part is, from one view of it: (26)."""
    return base_from_tool @ tool_from_camera @ part_from_camera.inverse()
