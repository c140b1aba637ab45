"""Held-out views: does the result foretell pictures that had no part in it?

A calibration is judged by its own residuals, and those are small whenever there are
enough parameters. Views taken afterwards, at poses and lens settings of their own, have
nothing to hide behind. Each is compared with what the stated uncertainty allows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibration.hand_eye.refine import Chain, camera_from_target
from calibration.poses import only
from calibration.projection import skew, to_normalised
from calibration.verdict import Cause, Verdict
from mvp.calibrated import VerdictCause

if TYPE_CHECKING:
    from calibration.hand_eye import HandEyeData, HandEyeSolution
    from calibration.poses import Poses
    from mvp.calibrated import Quality
    from mvp.geometry import FloatArray

_BEYOND = 3.0
_FAR_BEYOND = 6.0


@dataclass(frozen=True)
class HeldOutView:
    """One view that had no part.

    Attributes:
        name: of the view.
        error: root mean square, in ``unit``.
        expected: one standard deviation of it, by all stated uncertainties.
        unit: of both.
    """

    name: str
    error: float
    expected: float
    unit: str = "mm"

    @property
    def ratio(self) -> float:
        """Error by what was to be expected."""
        return self.error / max(self.expected, 1e-12)


@dataclass(frozen=True)
class Verification:
    """All held-out views together.

    Attributes:
        what: in words, what was foretold.
        views: one by one.
    """

    what: str
    views: tuple[HeldOutView, ...]

    @property
    def error(self) -> float:
        """Root mean square over the views; nan without any."""
        if not self.views:
            return float("nan")
        return float(np.sqrt(np.mean([view.error**2 for view in self.views])))

    @property
    def ratio(self) -> float:
        """Root mean square of error by expectation; nan without any."""
        if not self.views:
            return float("nan")
        return float(np.sqrt(np.mean([view.ratio**2 for view in self.views])))

    def causes(self) -> tuple[Cause, ...]:
        """What speaks against the result."""
        if not self.views:
            return (
                Cause(
                    "not-verified",
                    "marginal",
                    f"{self.what} was not tried on any held-out view",
                    "run the calibration to its end, with its held-out views",
                ),
            )
        worst = max(self.views, key=lambda view: view.ratio)
        if worst.ratio <= _BEYOND:
            return ()
        return (
            Cause(
                "held-out-view-does-not-fit",
                "no-go" if self.ratio > _FAR_BEYOND else "marginal",
                f"{self.what} is off by {worst.error:.3g} {worst.unit} in {worst.name}, "
                f"{worst.ratio:.1f} times what was to be expected",
                "look for something that moved or slipped between the pictures; "
                "calibrate again",
            ),
        )

    @property
    def words(self) -> str:
        """One line for a person."""
        if not self.views:
            return f"{self.what}: not tried on held-out views"
        unit, count = self.views[0].unit, len(self.views)
        return (
            f"{count} held-out view{'s' * (count > 1)}: {self.what} off by {self.error:.3g} "
            f"{unit} (root mean square), {self.ratio:.1f} times what was to be expected"
        )


def with_causes(quality: Quality, causes: tuple[Cause, ...]) -> Quality:
    """What was found afterwards, put to what is said already."""
    if not causes:
        return quality
    rank = {"go": 0, "marginal": 1, "no-go": 2}
    own = Verdict(causes)
    worse = rank[own.grade] > rank[quality.verdict]
    told = [
        VerdictCause(
            code=cause.code,
            grade="no-go" if cause.grade == "no-go" else "marginal",
            message=cause.message,
            action=cause.action,
        )
        for cause in causes
    ]
    return quality.model_copy(
        update={
            "verdict": own.grade if worse else quality.verdict,
            "reasons": [*own.reasons, *quality.reasons],
            "causes": [*told, *quality.causes],
            "next_action": own.next_action if worse else quality.next_action,
        }
    )


def verify_hand_eye(solution: HandEyeSolution, data: HandEyeData) -> Verification:
    """Where robot, hand-eye and target put the points, against the rays they were seen on.

    Args:
        solution: made without these views.
        data: views that had no part in it, with the arm's own word for its pose.
    """
    chain = Chain(
        solution.camera,
        only(solution.moving_from_camera),
        only(solution.fixed_from_target),
        data.base_from_tool,
    )
    slack = np.repeat(solution.robot_sigmas, 3)
    poses = camera_from_target(chain, data, data.base_from_tool)
    common = solution.estimate.covariance[:12, :12]
    views = []
    for view, name in enumerate(data.seen.names):
        points, pixels = data.seen.of_view(view)
        in_camera = poses[view : view + 1].apply(points[None])[0]
        across = _across(in_camera, to_normalised(solution.camera, pixels))
        error = float(np.sqrt(((across @ in_camera[:, :, None]) ** 2).sum(1).mean()))
        slope = _slopes(chain, poses[view : view + 1], points, in_camera)
        spread = slope @ _both(common, slack) @ slope.swapaxes(1, 2)
        seen = across @ spread @ across.swapaxes(1, 2)
        pixel_mm = solution.sigma_px * in_camera[:, 2] / solution.camera.fx_px
        variance = np.trace(seen, axis1=1, axis2=2) + 2 * pixel_mm**2
        views.append(HeldOutView(name, error, float(np.sqrt(variance.mean()))))
    return Verification("the target's place by robot and hand-eye", tuple(views))


def _across(points: FloatArray, ideal: FloatArray) -> FloatArray:
    """(m, 2, 3): two directions square to each ray, so that ``across @ point`` is off it."""
    rays = np.pad(ideal, ((0, 0), (0, 1)), constant_values=1.0)
    rays = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    side = np.cross(rays, [0.0, 1.0, 0.0])
    side = side / np.linalg.norm(side, axis=1, keepdims=True)
    return np.stack([side, np.cross(rays, side)], axis=1)


def _slopes(
    chain: Chain, pose: Poses, points: FloatArray, in_camera: FloatArray
) -> FloatArray:
    """(m, 3, 18): a point in camera axes for steps of X, Z and the arm."""
    x, z = chain.moving_from_camera, chain.fixed_from_target
    to_camera = x.rotation[0].T
    from_fixed = pose.rotation[0] @ z.rotation[0].T
    turned = points @ z.rotation[0].T
    lever = in_camera @ x.rotation[0].T
    arm = (in_camera + to_camera @ x.translation_mm[0]) @ from_fixed
    ones = np.broadcast_to(np.eye(3), (len(points), 3, 3))
    return np.concatenate(
        [
            to_camera @ np.concatenate([-ones, skew(lever)], axis=2),
            from_fixed @ np.concatenate([ones, -skew(turned)], axis=2),
            from_fixed @ np.concatenate([-ones, skew(arm)], axis=2),
        ],
        axis=2,
    )


def _both(common: FloatArray, slack: FloatArray) -> FloatArray:
    """(18, 18): of X and Z, and of the arm in one view."""
    found = np.zeros((18, 18))
    found[:12, :12] = common
    found[12:, 12:] = np.diag(slack**2)
    return found
