"""Pose of a camera from one picture of a known part, with fixed intrinsics.

All poses that could explain the picture are refined and scored; a second one whose
error is less than twice that of the best is an ambiguity that the picture cannot settle.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibration.estimate import FitOptions, fit
from calibration.part_pose.problem import PoseProblem
from calibration.part_pose.start import starts
from calibration.projection import CAMERA_NAMES
from mvp.errors import CalibrationError
from mvp.geometry import Pose

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibration.estimate import Estimate, Fit
    from calibration.part_pose.problem import State
    from calibration.part_pose.sightings import PartSight
    from calibration.projection import PinholeCamera
    from mvp.geometry import FloatArray

AMBIGUOUS_BELOW = 2.0
_FIT = FitOptions(most_steps=60, tolerance=1e-6)
_SAME_RAD = float(np.radians(0.2))
_EXACT_SIGMA = 1e-6
_CAMERA_STEP = 1e-5


@dataclass(frozen=True, eq=False)
class Branch:
    """One pose that explains the picture.

    Attributes:
        camera_from_part: the pose.
        estimate: its covariance (camera axes, see ``calibration.projection``) and fit.
        error_sigma: root mean square of the whitened residuals.
    """

    camera_from_part: Pose
    estimate: Estimate
    error_sigma: float


@dataclass(frozen=True, eq=False)
class Resection:
    """All poses that explain one picture, the best (or expected) one first."""

    branches: tuple[Branch, ...]
    settled_by_prior: bool = False

    @property
    def best(self) -> Branch:
        """The pose to use."""
        return self.branches[0]

    @property
    def error_ratio(self) -> float:
        """Error of the next pose by that of the best; infinite without another."""
        if len(self.branches) == 1:
            return float("inf")
        return self.branches[1].error_sigma / max(self.best.error_sigma, _EXACT_SIGMA)

    @property
    def ambiguous(self) -> bool:
        """The picture alone cannot tell the first two poses apart."""
        return self.error_ratio < AMBIGUOUS_BELOW


def resect(
    camera: PinholeCamera,
    sight: PartSight,
    *,
    near: Pose | None = None,
    part: str = "part",
) -> Resection:
    """All poses ``camera_from_part`` that explain a picture.

    Args:
        camera: fixed intrinsics.
        sight: what was seen.
        near: where the part is expected; decides between poses that the picture cannot
            tell apart, and nothing else.
        part: name of the part's frame.

    Raises:
        CalibrationError: fewer than three points' worth of features, or no pose puts
            the part in front of the camera.
    """
    if sight.equations < 6:
        raise CalibrationError(
            f"{sight.equations} equations cannot give the six numbers of a pose",
            hint="measure three features or more, not all on one line",
        )
    problem = PoseProblem.of(camera, sight)
    found = _refined(problem, starts(camera, sight))
    if not found:
        raise CalibrationError(
            "no pose puts the part in front of the camera and explains the picture",
            hint="check which feature is which, and that part and picture belong "
            "together",
        )
    branches = tuple(_branch(one, part) for one in found)
    return _ordered(branches, near)


def by_camera(
    camera: PinholeCamera, sight: PartSight, branch: Branch, names: Sequence[str]
) -> FloatArray:
    """(6, c): change of a pose for errors of intrinsics that were held fixed.

    Args:
        camera: as it was held.
        sight: what was seen.
        branch: the pose.
        names: of the intrinsics, from ``CAMERA_NAMES``.
    """
    pose = branch.camera_from_part
    state = (pose.rotation, pose.translation_mm)
    jacobian = PoseProblem.of(camera, sight).jacobian(state)
    columns = []
    for name in names:
        place = CAMERA_NAMES.index(name)
        step = np.zeros(len(CAMERA_NAMES))
        step[place] = _CAMERA_STEP * max(abs(camera.values[place]), 1.0)
        plus, minus = (
            PoseProblem.of(camera.with_values(camera.values + side * step), sight)
            for side in (1, -1)
        )
        change = plus.residuals(state) - minus.residuals(state)
        columns.append(change / (2 * step[place]))
    slopes = np.stack(columns, axis=1)
    return np.asarray(-np.linalg.lstsq(jacobian, slopes, rcond=None)[0])


def _refined(problem: PoseProblem, from_states: list[State]) -> list[Fit[State]]:
    """Distinct minima, the best first."""
    fits = []
    for state in from_states:
        if np.isfinite(problem.residuals(state)).all():
            fits.append(fit(problem, state, _FIT))
    fits.sort(key=lambda one: one.estimate.chi_square)
    distinct: list[Fit[State]] = []
    for one in fits:
        if not any(_same(one.state, other.state) for other in distinct):
            distinct.append(one)
    return distinct


def _same(state: State, other: State) -> bool:
    chord = float(np.linalg.norm(state[0] - other[0])) / np.sqrt(2)
    return bool(chord < _SAME_RAD)


def _branch(found: Fit[State], part: str) -> Branch:
    residuals = found.estimate.residuals
    return Branch(
        Pose("camera", part, *found.state),
        found.estimate,
        float(np.sqrt((residuals**2).mean())),
    )


def _ordered(branches: tuple[Branch, ...], near: Pose | None) -> Resection:
    if near is None or not Resection(branches).ambiguous:
        return Resection(branches)
    limit = AMBIGUOUS_BELOW * max(branches[0].error_sigma, _EXACT_SIGMA)
    rivals = [branch for branch in branches if branch.error_sigma < limit]
    chosen = min(rivals, key=lambda branch: branch.camera_from_part.angle_to_rad(near))
    others = tuple(branch for branch in branches if branch is not chosen)
    return Resection((chosen, *others), settled_by_prior=True)
