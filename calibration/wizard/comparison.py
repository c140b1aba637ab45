"""A new calibration beside the one before: how far apart on the work, and is it chance?

Differences are given where they matter, in mm and px at the working distance, each with
the standard deviation that both results together state. More than three of these is an
alarm: the cell has changed, or one of the two results is wrong.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from calibration.poses import difference, only
from calibration.projection import (
    CAMERA_NAMES,
    PinholeCamera,
    project_with_derivatives,
    skew,
    to_normalised,
)
from calibration.wizard.compare_lens import compare_lens_tables
from calibration.wizard.compared import (
    ALARM_SIGMAS,
    Comparison,
    Difference,
    Kind,
    compared,
    equivalent_sigmas,
    incomparable,
    length_along,
    other_device,
)
from mvp.geometry import Pose

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.calibrated import CameraCalibration, RigidCalibration
    from mvp.geometry import FloatArray

__all__ = [
    "ALARM_SIGMAS",
    "Comparison",
    "Difference",
    "compare_cameras",
    "compare_lens_tables",
    "compare_rigid",
]

_GRID = (9, 12)
_NEAR_AND_FAR = (0.9, 1.0, 1.1)
_OTHER_SETTING = 0.01
_FILE_NAMES = {"cx_px": "centre_x_px", "cy_px": "centre_y_px"}


def compare_cameras(
    previous: CameraCalibration, new: CameraCalibration, *, distance_mm: float
) -> Comparison:
    """Where both cameras see points at a distance.

    Args:
        previous: the one before.
        new: the new one.
        distance_mm: of a plane from the entrance pupil.
    """
    other = other_device(previous.provenance, new.provenance)
    if (previous.width_px, previous.height_px) != (new.width_px, new.height_px):
        other = (*other, "the pictures have another size")
    if other:
        return incomparable("camera", previous.provenance, new.provenance, other)
    old, now = _camera_of(previous, new), _camera_of(new, previous)
    spreads = _camera_covariance(previous), _camera_covariance(new)
    size = (new.width_px, new.height_px)
    direct, left = _seen_apart((old, now), spreads, size, distance_mm)
    mm = distance_mm / float(np.sqrt(now.fx_px * now.fy_px))
    at = f"at {distance_mm:.0f} mm"
    found = (
        _scaled(direct, f"largest shift {at}", mm, "mm"),
        _scaled(direct, f"largest shift {at}", 1.0, "px"),
        _scaled(left, f"what no motion of the camera imitates, {at}", mm, "mm"),
    )
    remarks: tuple[str, ...] = ()
    if abs(now.fx_px / old.fx_px - 1) > _OTHER_SETTING:
        percent = 100 * (now.fx_px / old.fx_px - 1)
        remarks = (
            f"the principal distances differ by {percent:.1f} %: were both results "
            "taken at the same lens setting?",
        )
    sigmas = None
    if spreads[0] is not None and spreads[1] is not None:
        sigmas = equivalent_sigmas(now.values - old.values, spreads[0] + spreads[1])
    return compared(
        "camera", previous.provenance, new.provenance, found, sigmas, remarks
    )


def compare_rigid(
    previous: RigidCalibration,
    new: RigidCalibration,
    *,
    at_source_mm: Sequence[float],
) -> Comparison:
    """Where both results put a point: of a hand-eye or of a part pose.

    Args:
        previous: the one before.
        new: the new one, of the same frames.
        at_source_mm: (3,) the point in the source frame: on the optical axis at the
            working distance for a hand-eye, the middle of the features for a part.

    Raises:
        ValueError: results of different frames.
    """
    if (previous.target, previous.source) != (new.target, new.source):
        raise ValueError("only results of the same two frames can be compared")
    kind: Kind = "part" if new.schema_ == "mvp-cell/part-pose/1" else "hand-eye"
    other = () if kind == "part" else other_device(previous.provenance, new.provenance)
    if other:
        return incomparable(kind, previous.provenance, new.provenance, other)
    old, now = _rigid_pose(previous, new), _rigid_pose(new, new)
    step = difference(only(now), only(old))[0]
    lever = now.rotate(np.asarray(at_source_mm, dtype=np.float64))
    jacobian = np.hstack([np.eye(3), -skew(lever)])
    shift = jacobian @ step
    spread = _sum_of(previous.covariance, new.covariance)
    at = f"at {np.linalg.norm(at_source_mm):.0f} mm" if kind == "hand-eye" else "there"
    found = (
        length_along(f"shift of a point {at}", shift, jacobian, spread, "mm"),
        length_along("shift of the origin", step[:3], np.eye(3, 6), spread, "mm"),
        length_along(
            "turn", np.degrees(step[3:]), np.degrees(np.eye(3, 6, 3)), spread, "deg"
        ),
    )
    sigmas = None if spread is None else equivalent_sigmas(step, spread)
    return compared(kind, previous.provenance, new.provenance, found, sigmas, ())


def _scaled(one: Difference, name: str, factor: float, unit: str) -> Difference:
    sigma = None if one.sigma is None else one.sigma * factor
    return Difference(name, one.change * factor, sigma, unit)


def _sum_of(
    before: list[list[float]] | None, now: list[list[float]] | None
) -> FloatArray | None:
    if before is None or now is None:
        return None
    return np.asarray(before, np.float64) + np.asarray(now, np.float64)


def _camera_of(file: CameraCalibration, other: CameraCalibration) -> PinholeCamera:
    """Principal distance from the other file (or a guess) where this one has none."""
    guess = float(max(file.width_px, file.height_px))
    return PinholeCamera(
        file.reference_fx_px or other.reference_fx_px or guess,
        file.reference_fy_px or other.reference_fy_px or guess,
        file.centre_x_px,
        file.centre_y_px,
        file.k1,
        file.k2,
        file.p1,
        file.p2,
        file.k3,
    )


def _camera_covariance(file: CameraCalibration) -> FloatArray | None:
    """(9, 9) of ``CAMERA_NAMES``; None where the file tells none."""
    spread = np.zeros((9, 9))
    if file.covariance is not None:
        names = file.covariance.parameters
        index = [CAMERA_NAMES.index(n) for n in names if n in CAMERA_NAMES]
        rows = [i for i, n in enumerate(names) if n in CAMERA_NAMES]
        matrix = np.asarray(file.covariance.matrix, np.float64)
        spread[np.ix_(index, index)] = matrix[np.ix_(rows, rows)]
    elif file.standard_deviation:
        stated = file.standard_deviation
        own = [stated.get(_FILE_NAMES.get(n, n), 0.0) for n in CAMERA_NAMES]
        spread = np.diag(np.square(own))
    return spread if spread.any() else None


def _seen_apart(
    cameras: tuple[PinholeCamera, PinholeCamera],
    spreads: tuple[FloatArray | None, FloatArray | None],
    size_px: tuple[int, int],
    distance_mm: float,
) -> tuple[Difference, Difference]:
    """Largest shift over the picture, px: as it is, and less the best motion."""
    across = np.linspace(0, size_px[0] - 1, _GRID[1])
    down = np.linspace(0, size_px[1] - 1, _GRID[0])
    pixels = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
    rays = to_normalised(cameras[0], pixels)
    rays = rays[np.isfinite(rays).all(axis=1)]
    flat = np.pad(rays, ((0, 0), (0, 1)), constant_values=1.0) * distance_mm
    points = np.concatenate([factor * flat for factor in _NEAR_AND_FAR])
    seen = [
        project_with_derivatives(c, np.eye(3), np.zeros(3), points) for c in cameras
    ]
    change = (seen[1].pixels - seen[0].pixels).ravel()
    motion = seen[1].d_pose.reshape(-1, 6)
    slopes = [one.d_camera.reshape(-1, 9) for one in seen]

    def without(values: FloatArray) -> FloatArray:
        return values - motion @ np.linalg.lstsq(motion, values, rcond=None)[0]

    middle = slice(2 * len(flat), 4 * len(flat))
    return (
        _largest(change[middle], [slope[middle] for slope in slopes], spreads),
        _largest(
            without(change)[middle], [without(s)[middle] for s in slopes], spreads
        ),
    )


def _largest(
    change: FloatArray,
    slopes: list[FloatArray],
    spreads: tuple[FloatArray | None, FloatArray | None],
) -> Difference:
    shifts = change.reshape(-1, 2)
    worst = int(np.linalg.norm(shifts, axis=1).argmax())
    rows = slice(2 * worst, 2 * worst + 2)
    if spreads[0] is None or spreads[1] is None:
        return length_along("shift", shifts[worst], np.eye(2), None, "px")
    jacobian = np.hstack([slope[rows] for slope in slopes])
    both = np.zeros((18, 18))
    both[:9, :9], both[9:, 9:] = spreads
    return length_along("shift", shifts[worst], jacobian, both, "px")


def _rigid_pose(file: RigidCalibration, reference: RigidCalibration) -> Pose:
    """The transform at the reference's lens setting: the pupil moves along z with d."""
    pose = Pose.from_matrix(file.target, file.source, np.asarray(file.matrix))
    if file.reference_d_mm is None or reference.reference_d_mm is None:
        return pose
    along = np.array([0.0, 0.0, reference.reference_d_mm - file.reference_d_mm])
    moved = pose.translation_mm + pose.rotate(along)
    return replace(pose, translation_mm=moved)
