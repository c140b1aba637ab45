"""Pieces that several reports share: outlines, frames of cameras, tilts."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibration.poses import Poses
from calibration.projection import POSE_NAMES
from calibration.report.model import Quantity
from calibration.report.plots import Outline, Scene, Tilts

if TYPE_CHECKING:
    from calibration.observations import Observations
    from calibration.projection import PinholeCamera
    from mvp.geometry import FloatArray, Pose

NORMAL_95 = 1.96
_FRUSTUM_SHARE = 0.22
_AXES_SHARE = 0.25
_WORDS = ("x", "y", "z", "turn about x", "turn about y", "turn about z")


def matrices(poses: Poses) -> FloatArray:
    """Homogeneous (n, 4, 4)."""
    found = np.tile(np.eye(4), (len(poses), 1, 1))
    found[:, :3, :3], found[:, :3, 3] = poses.rotation, poses.translation_mm
    return found


def target_outline(seen: Observations) -> FloatArray:
    """(5, 3): the rectangle around all points of the target, closed."""
    low, high = seen.points_target_mm.min(axis=0), seen.points_target_mm.max(axis=0)
    x, y = [low[0], high[0]], [low[1], high[1]]
    corners = [(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1]), (x[0], y[0])]
    return np.array([[*corner, low[2]] for corner in corners])


def axes_outline(poses: Poses, length_mm: float) -> Outline:
    """x, y and z of frames, in red, green and blue."""
    ends = poses.rotation.swapaxes(1, 2) * length_mm + poses.translation_mm[:, None]
    starts = np.broadcast_to(poses.translation_mm[:, None], ends.shape)
    lines = np.stack([starts, ends], axis=2).reshape(-1, 2, 3)
    return Outline("axes", tuple(lines), "axes")


def target_scene(
    camera_from_target: Poses,
    camera: PinholeCamera,
    seen: Observations,
    names: tuple[str, ...],
) -> Scene:
    """Where cameras stood about a target.

    Args:
        camera_from_target: of every view.
        camera: whose field of view is drawn.
        seen: tells size of pictures and target.
        names: of the views.
    """
    distances = np.linalg.norm(camera_from_target.translation_mm, axis=1)
    origin = Poses(np.eye(3)[None], np.zeros((1, 3)))
    return Scene(
        "target",
        matrices(camera_from_target.inverse()),
        names,
        half_angles(camera, (seen.width_px, seen.height_px)),
        drawn_reach_mm(distances),
        (
            Outline("target", (target_outline(seen),)),
            axes_outline(origin, axes_length_mm(distances)),
        ),
    )


def half_angles(camera: PinholeCamera, size_px: tuple[int, int]) -> tuple[float, float]:
    """Tangents of half the field of view."""
    return size_px[0] / (2 * camera.fx_px), size_px[1] / (2 * camera.fy_px)


def drawn_reach_mm(distances_mm: FloatArray) -> float:
    """How far a field of view is drawn."""
    return _FRUSTUM_SHARE * float(np.median(distances_mm))


def axes_length_mm(distances_mm: FloatArray) -> float:
    """How long the axes of a frame are drawn."""
    return _AXES_SHARE * float(np.median(distances_mm))


def tilts_of(rotation: FloatArray, names: tuple[str, ...]) -> Tilts:
    """Of the target's normal against the optical axis, from ``camera_from_target``."""
    normal = rotation[:, :, 2] * np.sign(rotation[:, 2, 2])[:, None]
    about_x = np.degrees(np.arctan2(-normal[:, 1], normal[:, 2]))
    about_y = np.degrees(np.arctan2(normal[:, 0], normal[:, 2]))
    return Tilts(about_x, about_y, names)


def pose_quantities(
    pose: Pose, covariance: FloatArray, what: str
) -> tuple[Quantity, ...]:
    """Three lengths and a rotation vector, with sigma; axes of the target frame."""
    sigma = np.sqrt(np.diag(covariance))
    values = np.concatenate([pose.translation_mm, np.degrees(pose.rotvec_rad)])
    sigma = np.concatenate([sigma[:3], np.degrees(sigma[3:])])
    units = ["mm" if name.endswith("mm") else "deg" for name in POSE_NAMES]
    return tuple(
        Quantity(f"{what}, {word}", float(value), float(one), unit)
        for word, value, one, unit in zip(_WORDS, values, sigma, units, strict=True)
    )
