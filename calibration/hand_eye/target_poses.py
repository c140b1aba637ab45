"""Where each picture puts the target, with intrinsics held fixed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibration.part_pose import PartSight, SeenPoints, resect
from calibration.poses import Poses, difference
from mvp.errors import CalibrationError

if TYPE_CHECKING:
    from calibration.hand_eye.data import HandEyeData
    from calibration.part_pose import Resection
    from calibration.projection import PinholeCamera


@dataclass(frozen=True, eq=False)
class TargetPoses:
    """One resection per view.

    Attributes:
        camera_from_target: n poses, the best branch of each view.
        resections: all branches of each view.
    """

    camera_from_target: Poses
    resections: tuple[Resection, ...]

    @property
    def variance_factor(self) -> float:
        """Squared residuals over what the stated noise allows, each pose being free."""
        estimates = [one.best.estimate for one in self.resections]
        freedom = sum(max(one.degrees_of_freedom, 0) for one in estimates)
        return sum(one.chi_square for one in estimates) / max(freedom, 1)

    def nearest(self, expected: Poses) -> TargetPoses:
        """Of each view the branch that fits the other views, where it is in doubt.

        Args:
            expected: ``camera_from_target`` of each view as the robot has it.
        """
        chosen = []
        for index, resection in enumerate(self.resections):
            rivals = (
                resection.branches if resection.ambiguous else resection.branches[:1]
            )
            poses = Poses.of([branch.camera_from_part for branch in rivals])
            off = difference(poses, expected[np.full(len(rivals), index)])
            chosen.append(rivals[int(np.linalg.norm(off[:, 3:], axis=1).argmin())])
        return TargetPoses(
            Poses.of([branch.camera_from_part for branch in chosen]), self.resections
        )


def target_poses(data: HandEyeData, camera: PinholeCamera) -> TargetPoses:
    """Resect the camera from every picture.

    Raises:
        CalibrationError: a view that shows too little, or no pose explains it; named.
    """
    found = []
    for view, name in enumerate(data.seen.names):
        points, pixels = data.seen.of_view(view)
        sight = PartSight(SeenPoints(points, pixels, data.sigma_px))
        try:
            found.append(resect(camera, sight, part="target"))
        except CalibrationError as error:
            raise CalibrationError(
                f"{name}: {error.message}", hint=error.hint, where=name
            ) from error
    poses = Poses.of([one.best.camera_from_part for one in found])
    return TargetPoses(poses, tuple(found))
