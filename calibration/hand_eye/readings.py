"""Were the robot's numbers understood? Tries the other readings and says which fits.

A relative motion of the hand and that of the camera turn by the same angle and slide by
the same length along their axes, whatever the hand-eye transform is. A wrong direction,
order or unit breaks this, and the reading that mends it names the mistake.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from scipy.spatial.transform import Rotation

from calibration.hand_eye.closed_form import closed_form
from calibration.hand_eye.motions import all_pairs, fixed_from_moving
from calibration.poses import Poses
from calibration.verdict import Cause

if TYPE_CHECKING:
    from calibration.hand_eye.motions import Motions, Mount
    from mvp.geometry import FloatArray

Layout = Literal[
    "quaternion w x y z",
    "quaternion x y z w",
    "rotation vector, rad",
    "rotation vector, deg",
    "roll pitch yaw, rad",
    "roll pitch yaw, deg",
]
_LAYOUTS: dict[int, tuple[Layout, ...]] = {
    7: ("quaternion w x y z", "quaternion x y z w"),
    6: (
        "rotation vector, rad",
        "rotation vector, deg",
        "roll pitch yaw, rad",
        "roll pitch yaw, deg",
    ),
}
AS_TOLD = "as told"
_BETTER = 4.0
_SCALE_MARGINAL = 0.005
_SCALE_NO_GO = 0.02
_UNITS = {
    1e-3: "in metres",
    1e3: "in micrometres, or those of the target in metres",
    1 / 25.4: "in inches",
}
_LEAST_RATIO = 0.3
_LEAST_SEEN_RAD = float(np.radians(5.0))


@dataclass(frozen=True)
class Reading:
    """One way to understand the numbers, and how well it fits the pictures.

    Attributes:
        name: in words.
        misfit_mm: root mean square disagreement of hand and camera motions, rotations
            taken at the distance of the target, lengths scaled freely.
        scale: the robot's lengths by those of the target; 1 when units agree.
        scale_sigma: one standard deviation of it.
    """

    name: str
    misfit_mm: float
    scale: float
    scale_sigma: float


@dataclass(frozen=True)
class ReadingCheck:
    """All readings, the best first; the one that was told separately."""

    told: Reading
    ranked: tuple[Reading, ...]

    @property
    def best(self) -> Reading:
        """The reading that fits best."""
        return self.ranked[0]

    def causes(
        self, allowed_mm: float, hopeless_mm: float = float("inf")
    ) -> tuple[Cause, ...]:
        """A wrong reading, or lengths in another unit.

        Args:
            allowed_mm: the misfit that the noise of robot and pictures explains.
            hopeless_mm: a misfit that no error of lens or robot makes.
        """
        beyond = self.told.misfit_mm > max(_BETTER * self.best.misfit_mm, allowed_mm)
        if beyond and self.best.name != AS_TOLD:
            return (self._other_reading(), *_scale_causes(self.best))
        if self.told.misfit_mm > max(allowed_mm, hopeless_mm):
            return (self._no_reading(),)
        return _scale_causes(self.told)

    def _no_reading(self) -> Cause:
        return Cause(
            "no-reading-fits",
            "no-go",
            f"the robot poses disagree with the pictures by {self.told.misfit_mm:.3g} "
            "mm, and no other direction, order or shift of them fits better",
            "check whether degrees were read as radians, which convention the angles "
            "follow, and that every pose belongs to its picture",
        )

    def _other_reading(self) -> Cause:
        return Cause(
            "reading",
            "no-go",
            f"the robot poses disagree with the pictures by {self.told.misfit_mm:.3g} "
            f"mm as told, and by {self.best.misfit_mm:.3g} mm with {self.best.name}",
            f"correct how the poses are read: {self.best.name}",
        )


def angle_causes(motions: Motions) -> tuple[Cause, ...]:
    """A hand that turns much less than its pictures show.

    Args:
        motions: of all pairs of views.
    """
    hand, camera = np.median(motions.turns_rad, axis=0)
    if hand > _LEAST_RATIO * camera or camera < _LEAST_SEEN_RAD:
        return ()
    return (
        Cause(
            "hand-turns-less",
            "no-go",
            f"by its poses the hand turns by {np.degrees(hand):.2g} deg between two "
            f"views, by the pictures by {np.degrees(camera):.2g} deg: angles in radians "
            "were read as degrees, or the poses did not follow",
            "check the unit of the robot's angles, and that every pose was read anew",
        ),
    )


def check_readings(
    base_from_tool: Poses, camera_from_target: Poses, mount: Mount
) -> ReadingCheck:
    """Try direction, transposed rotations, quaternion order and shifted samples.

    Args:
        base_from_tool: as told, three or more.
        camera_from_target: from the pictures.
        mount: as told; the inverse of every pose is the other mount.
    """
    readings = [
        _read(name, fixed_from_moving(robot, mount), target)
        for name, robot, target in _alternatives(base_from_tool, camera_from_target)
    ]
    ranked = sorted(readings, key=lambda reading: reading.misfit_mm)
    return ReadingCheck(readings[0], tuple(ranked))


def layouts_that_fit(
    numbers: FloatArray, camera_from_target: Poses, mount: Mount
) -> tuple[Reading, ...]:
    """Readings of bare numbers, the best first.

    Args:
        numbers: (n, 7) x y z and a quaternion, or (n, 6) x y z and three angles.
        camera_from_target: from the pictures, mm.
        mount: where the camera is.

    Raises:
        ValueError: another number of columns.
    """
    if numbers.ndim != 2 or numbers.shape[1] not in _LAYOUTS:
        raise ValueError("rows of 7 numbers (quaternion) or 6 (angles)")
    readings = []
    for layout in _LAYOUTS[numbers.shape[1]]:
        told = poses_from_numbers(numbers, layout)
        readings += [
            _read(layout, fixed_from_moving(told, mount), camera_from_target),
            _read(
                f"{layout}, inverted",
                fixed_from_moving(told.inverse(), mount),
                camera_from_target,
            ),
        ]
    return tuple(sorted(readings, key=lambda reading: reading.misfit_mm))


def poses_from_numbers(
    numbers: FloatArray, layout: Layout, mm_per_unit: float = 1.0
) -> Poses:
    """Rows of x y z and a rotation as poses; roll, pitch, yaw about fixed x, y, z."""
    turn = numbers[:, 3:]
    if layout.startswith("quaternion"):
        first = layout == "quaternion w x y z"
        rotation = Rotation.from_quat(turn, scalar_first=first)
    else:
        angles = np.radians(turn) if layout.endswith("deg") else turn
        vector = layout.startswith("rotation vector")
        rotation = (
            Rotation.from_rotvec(angles)
            if vector
            else Rotation.from_euler("xyz", angles)
        )
    return Poses(rotation.as_matrix(), numbers[:, :3] * mm_per_unit)


def _alternatives(robot: Poses, target: Poses) -> list[tuple[str, Poses, Poses]]:
    """As told first, then every combination of mistakes, then shifted samples.

    Inverting both robot and target poses is the same problem, solved for Z; inverting
    only the target poses is like inverting only the robot's.
    """
    orders = {
        "": robot,
        "the quaternion's scalar last": _reordered(robot, 1),
        "the quaternion's scalar first": _reordered(robot, -1),
    }
    found = []
    for order, poses in orders.items():
        directions = {
            "": poses,
            "inverted robot poses (or target poses, or the other mount)": poses.inverse(),
            "transposed robot rotations": Poses(
                np.swapaxes(poses.rotation, 1, 2), poses.translation_mm
            ),
        }
        for direction, directed in directions.items():
            words = " and ".join(word for word in (order, direction) if word)
            found.append((words or AS_TOLD, directed, target))
    if len(robot) > 3:
        found.append(("each robot pose one sample later", robot[1:], target[:-1]))
        found.append(("each robot pose one sample earlier", robot[:-1], target[1:]))
    return found


def _reordered(robot: Poses, places: int) -> Poses:
    """Quaternions whose numbers were put in by another order."""
    numbers = Rotation.from_matrix(robot.rotation).as_quat(scalar_first=True)
    other = Rotation.from_quat(np.roll(numbers, places, axis=1), scalar_first=True)
    return Poses(other.as_matrix(), robot.translation_mm)


def _read(name: str, fixed: Poses, target: Poses) -> Reading:
    motions = all_pairs(fixed, target)
    rotation = closed_form(fixed, target, "park").rotation[0]
    off = motions.moving.rotation @ rotation
    off = np.swapaxes(off, 1, 2) @ (rotation @ motions.camera.rotation)
    angle = Rotation.from_matrix(off).magnitude()
    distance = float(np.linalg.norm(target.translation_mm, axis=1).mean())
    scale, sigma, slide = _scaled(motions, rotation, len(fixed))
    misfit = np.sqrt((angle**2).mean() * distance**2 + slide**2)
    return Reading(name, float(misfit), scale, sigma)


def _scaled(
    motions: Motions, rotation: FloatArray, views: int
) -> tuple[float, float, float]:
    """(R_A - 1) t_X + s t_A = R_X t_B for t_X and 1 / s: s, its sigma and the rest."""
    turn = (motions.moving.rotation - np.eye(3)).reshape(-1, 3)
    seen = (motions.camera.translation_mm @ rotation.T).ravel()
    told = motions.moving.translation_mm.ravel()
    left = np.column_stack([turn, told])
    size = np.linalg.norm(left, axis=0)
    size[size == 0] = 1.0
    scaled, _, _, _ = np.linalg.lstsq(left / size, seen, rcond=None)
    rest = seen - (left / size) @ scaled
    slide = float(np.sqrt((rest**2).mean()))
    # pairs share views: only n - 1 motions are independent
    inverse = np.linalg.pinv((left / size).T @ (left / size))
    share = len(motions.moving) / max(views - 1, 1)
    sigma = slide * np.sqrt(max(inverse[3, 3], 0.0) * share) / size[3]
    factor = float(scaled[3] / size[3])
    scale = 1 / factor if factor else float("inf")
    return scale, float(sigma * scale**2), slide * np.sqrt(3)


def _scale_causes(reading: Reading) -> tuple[Cause, ...]:
    off = abs(np.log(max(reading.scale, 1e-12)))
    doubt = 4 * reading.scale_sigma / max(reading.scale, 1e-12)
    if reading.scale <= 0 or off <= max(doubt, _SCALE_MARGINAL):
        return ()
    for unit, words in _UNITS.items():
        if abs(np.log(reading.scale / unit)) < 0.1:
            return (
                Cause(
                    "unit",
                    "no-go",
                    f"the robot's lengths are {reading.scale:.3g} times those of the "
                    f"target: they seem to be {words}",
                    "give the robot's positions and the target's squares in millimetres",
                ),
            )
    grade: Literal["no-go", "marginal"] = "no-go" if off > _SCALE_NO_GO else "marginal"
    return (
        Cause(
            "scale",
            grade,
            f"the robot's lengths are {reading.scale:.4g} times those of the target",
            "measure the squares of the target; check the focal length and the unit "
            "of the robot",
        ),
    )
