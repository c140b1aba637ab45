"""A view kept apart: does the place of the part foretell where its lines and rims are?"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibration.part_pose import locate
from calibration.part_pose.problem import PoseProblem
from calibration.projection import skew
from calibration.wizard.camera_prior import camera_prior
from calibration.wizard.part_pictured import (
    chain_of,
    pictured_of,
    setting_of_sample,
    tool_from_camera_of,
)
from calibration.wizard.verification import HeldOutView, Verification
from mvp.optics import single_view

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibration.part_pose import HandEye, LocatedPart
    from calibration.wizard.part_pictured import Pictured
    from calibration.wizard.session_store import SessionStore
    from mvp.geometry import FloatArray, Pose
    from mvp.wizard import SessionFacts

VERIFICATION = "verification"
HELD_OUT = "held_out_view"
_WHAT = "where edges and holes of the part are seen"


def not_wanted(store: SessionStore) -> bool:
    """The session was to find the part for a run, without a view kept apart."""
    return store.recall(HELD_OUT) is not True


def held_out(
    store: SessionStore, located: LocatedPart, hand_eye: HandEye
) -> Verification:
    """The views that had no part in the result."""
    facts = store.facts
    return Verification(
        _WHAT,
        tuple(
            foretold(facts, located, pictured_of(facts, sample, hand_eye))
            for sample in store.usable(VERIFICATION)
        ),
    )


def left_out(
    facts: SessionFacts, pictured: Sequence[Pictured], hand_eye: HandEye
) -> Verification:
    """Every view by what the others say; none for a single one."""
    if len(pictured) < 2:
        return Verification(_WHAT, ())
    covariance = camera_prior(facts, setting_of_sample(pictured[0].sample)).covariance
    views = []
    for one in pictured:
        others = [other.view for other in pictured if other is not one]
        views.append(foretold(facts, locate(others, hand_eye, covariance), one))
    return Verification(_WHAT, tuple(views))


def foretold(
    facts: SessionFacts, located: LocatedPart, pictured: Pictured
) -> HeldOutView:
    """Where arm, hand-eye and part put lines and rims, against where they were seen.

    Errors and what was to be expected of them are those in the picture, at the depth of
    the part's features. What a picture's own errors and those of the intrinsics amount
    to is added as if the located pose knew nothing of the latter.
    """
    sample, sight = pictured.sample, pictured.sight
    base_from_camera = sample.pose @ tool_from_camera_of(facts, sample)
    there = base_from_camera.inverse() @ located.base_from_part
    state = there.rotation, there.translation_mm
    problem = PoseProblem.of(pictured.camera, sight)
    sigmas = np.concatenate(
        [np.repeat(sight.circles.sigmas_px, 2), sight.edges.sigmas_px]
    )
    off_px = problem.residuals(state) * sigmas
    slope_px = problem.jacobian(state) * sigmas[:, None]
    spread = _of_pose(facts, located, pictured, there) + _of_camera(facts, pictured)
    variance = np.einsum("ki,ij,kj->k", slope_px, spread, slope_px) + sigmas**2
    depth = float(there.apply(sight.places_part_mm)[:, 2].mean())
    mm = depth / pictured.camera.fx_px
    return HeldOutView(
        sample.name,
        mm * float(np.sqrt(np.mean(off_px**2))),
        mm * float(np.sqrt(variance.mean())),
    )


def _of_pose(
    facts: SessionFacts, located: LocatedPart, pictured: Pictured, there: Pose
) -> FloatArray:
    """(6, 6) of ``camera_from_part`` by part, arm and hand-eye, as the estimator steps.

    The chain's covariance is of the camera: its shift in part axes, its turn in its own.
    """
    d_mm = facts.lens_at(pictured.sample.lens_steps).d_mm
    view = single_view(there.inverse(), d_mm=d_mm, f_mm=d_mm, a_mm=1.0)
    covariance = chain_of(facts, located, d_mm).covariance(view)[0]
    lever = np.zeros((6, 6))
    lever[:3, :3] = -there.rotation
    lever[:3, 3:] = skew(there.translation_mm[None])[0]
    lever[3:, 3:] = -np.eye(3)
    return np.asarray(lever @ covariance @ lever.T)


def _of_camera(facts: SessionFacts, pictured: Pictured) -> FloatArray:
    """(6, 6) of the pose that errors of the intrinsics amount to."""
    by_camera = pictured.view.by_camera
    if by_camera is None:
        return np.zeros((6, 6))
    prior = camera_prior(facts, setting_of_sample(pictured.sample))
    return np.asarray(by_camera @ prior.covariance @ by_camera.T)
