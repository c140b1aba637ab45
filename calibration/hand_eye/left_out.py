"""How far off the target is in a view that took no part in the fit.

Leaving a view out moves the minimum by one step of Gauss and Newton that needs no new
fit: the view's share of the information, its own slack eliminated, is taken away.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibration.hand_eye.refine import camera_from_target
from calibration.poses import Poses
from calibration.projection import to_normalised

if TYPE_CHECKING:
    from calibration.hand_eye.noise import Refined
    from calibration.hand_eye.refine import Chain, HandEyeProblem
    from mvp.geometry import FloatArray, IntArray


def left_out_mm(refined: Refined) -> FloatArray:
    """(n,): root mean square over the points of each view left out, mm.

    The distance between a point where the other views and the robot's word put it and
    the ray on which the camera saw it.
    """
    problem, state = refined.problem, refined.fit.state
    shares = _shares(problem, state)
    k = len(problem.prior.names)
    total = sum(share for share, _ in shares) + _of_camera(problem)
    errors = []
    for view, (share, gradient) in enumerate(shares):
        step = np.zeros(len(problem.names))
        step[: 12 + k] = np.linalg.pinv(total - share, hermitian=True) @ gradient
        rows = problem.data.seen.view == view
        off = off_rays_mm(problem, problem.moved(state, step), rows)
        errors.append(np.sqrt((off**2).mean()))
    return np.array(errors)


def off_rays_mm(problem: HandEyeProblem, state: Chain, rows: IntArray) -> FloatArray:
    """Distances of points from their rays, the robot taken at its word, mm."""
    seen = problem.data.seen
    poses = camera_from_target(state, problem.data, problem.data.base_from_tool)
    view = seen.view[rows]
    chosen = Poses(poses.rotation[view], poses.translation_mm[view])
    points = chosen.apply(seen.points_target_mm[rows])
    ideal = to_normalised(state.camera, seen.pixels[rows])
    rays = np.pad(ideal, ((0, 0), (0, 1)), constant_values=1.0)
    rays = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    return np.asarray(np.linalg.norm(np.cross(points, rays), axis=1))


def _shares(
    problem: HandEyeProblem, state: Chain
) -> list[tuple[FloatArray, FloatArray]]:
    """Information and gradient of each view for all that the views share."""
    k, views = len(problem.prior.names), len(problem.data.base_from_tool)
    jacobian = problem.jacobian(state)
    residuals = problem.residuals(state)
    points = 2 * len(problem.data.seen.view)
    slack = residuals[points + k :].reshape(views, 6) / problem.slack_sigmas
    rows = np.repeat(problem.data.seen.view, 2)
    shares = []
    for view in range(views):
        own = np.flatnonzero(rows == view)
        block = jacobian[own].toarray()
        common = block[:, : 12 + k]
        arm = block[:, 12 + k + 6 * view : 18 + k + 6 * view]
        inner = arm.T @ arm + np.diag(1 / problem.slack_sigmas**2)
        solved = np.linalg.solve(inner, arm.T @ common)
        gradient = common.T @ residuals[own]
        gradient -= solved.T @ (arm.T @ residuals[own] + slack[view])
        shares.append((common.T @ common - common.T @ arm @ solved, gradient))
    return shares


def _of_camera(problem: HandEyeProblem) -> FloatArray:
    whitener = np.pad(problem.prior.whitener, ((0, 0), (12, 0)))
    return np.asarray(whitener.T @ whitener)
