"""One picture of a part with what it says, and the chain through which it was seen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibration.part_pose import HandEye, PartView, by_camera, resect
from calibration.part_pose.problem import PoseProblem
from calibration.wizard.camera_prior import camera_prior
from calibration.wizard.part_sight import sight_of
from calibration.wizard.points import residuals
from calibration.wizard.working import Setting
from mvp.planning.probability_errors import PoseChain

if TYPE_CHECKING:
    from calibration.part_pose import LocatedPart, PartSight, Resection
    from calibration.projection import PinholeCamera
    from calibration.wizard.session_store import Sample
    from mvp.calibrated import PointResiduals
    from mvp.geometry import Pose
    from mvp.wizard import SessionFacts


@dataclass(frozen=True, eq=False)
class Pictured:
    """One sample with what it says.

    Attributes:
        sample: as stored.
        camera: intrinsics at its lens setting.
        sight: what was seen.
        resection: the poses that explain it, the one nearest to the expected first
            where the picture cannot tell.
        view: for ``locate``.
    """

    sample: Sample
    camera: PinholeCamera
    sight: PartSight
    resection: Resection
    view: PartView


def hand_eye_of(facts: SessionFacts, sample: Sample) -> HandEye:
    """The hand-eye transform at a sample's lens setting, and the robot's noise."""
    known = facts.hand_eye.covariance
    sigmas = [facts.robot.position_mm] * 3 + [np.radians(facts.robot.angle_deg)] * 3
    return HandEye(
        tool_from_camera_of(facts, sample),
        np.zeros((6, 6)) if known is None else np.asarray(known, np.float64),
        np.diag(np.square(sigmas)),
    )


def tool_from_camera_of(facts: SessionFacts, sample: Sample) -> Pose:
    """Hand-eye at the lens setting of a sample."""
    return facts.tool_from_camera(facts.lens_at(sample.lens_steps).d_mm)


def setting_of_sample(sample: Sample) -> Setting:
    """Its lens steps."""
    return Setting(**sample.lens_steps)


def pictured_of(facts: SessionFacts, sample: Sample, hand_eye: HandEye) -> Pictured:
    """What a sample says by itself."""
    prior = camera_prior(facts, setting_of_sample(sample))
    sight = sight_of(sample).sight
    own = tool_from_camera_of(facts, sample)
    # With the lens set otherwise the pupil is elsewhere: as if the tool stood there.
    tool = sample.pose @ own @ hand_eye.tool_from_camera.inverse()
    near = (sample.pose @ own).inverse() @ facts.base_from_part
    resection = resect(prior.camera, sight, near=near)
    best = resection.best
    view = PartView(
        best.camera_from_part,
        best.estimate.covariance,
        tool,
        by_camera(prior.camera, sight, best, prior.names),
    )
    return Pictured(sample, prior.camera, sight, resection, view)


def chain_of(facts: SessionFacts, located: LocatedPart, d_mm: float) -> PoseChain:
    """The calibrated chain with this part in it."""
    known = facts.hand_eye.covariance
    sigmas = [facts.robot.position_mm] * 3 + [np.radians(facts.robot.angle_deg)] * 3
    return PoseChain(
        located.base_from_part,
        facts.tool_from_camera(d_mm),
        located.covariance,
        np.zeros((6, 6)) if known is None else np.asarray(known, np.float64),
        np.diag(np.square(sigmas)),
        located.by_hand_eye,
    )


def rms_px_of(pictured: Pictured) -> float:
    """Of what the pose leaves of lines and rims."""
    sight = pictured.sight
    residuals = pictured.resection.best.estimate.residuals
    sigmas = np.concatenate(
        [np.repeat(sight.circles.sigmas_px, 2), sight.edges.sigmas_px]
    )
    return float(np.sqrt(np.mean((residuals * sigmas) ** 2)))


def points_of_part(pictured: Pictured) -> PointResiduals:
    """What the pose leaves of rims and of places on edges; of these, across the edge."""
    camera, sight = pictured.camera, pictured.sight
    pose = pictured.resection.best.camera_from_part
    problem = PoseProblem.of(camera, sight)
    off = problem.residuals((pose.rotation, pose.translation_mm))
    rims = 2 * len(sight.circles.pixels)
    errors = [(off[:rims].reshape(-1, 2)) * sight.circles.sigmas_px[:, None]]
    ends = pose.apply(sight.edges.ends_part_mm.reshape(-1, 3)).reshape(-1, 2, 3)
    line = np.cross(ends[:, 0], ends[:, 1])[:, :2] / [camera.fx_px, camera.fy_px]
    across = line / np.linalg.norm(line, axis=1, keepdims=True)
    lengths = off[rims:] * sight.edges.sigmas_px
    errors.append(-lengths[:, None] * across[sight.edges.edge])
    names = [sight.edges.names[edge] for edge in sight.edges.edge]
    ids = [*sight.circles.names, *names]
    return residuals(pictured.sample.name, ids, np.concatenate(errors))
