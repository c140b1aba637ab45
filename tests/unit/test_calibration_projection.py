"""The shared camera model against OpenCV and finite differences."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calibration.projection import (
    PinholeCamera,
    moved_pose,
    project,
    project_with_derivatives,
    to_normalised,
    to_pixels,
)

CAMERA = PinholeCamera(
    2300.0, 2290.0, 805.0, 590.0, -0.21, 0.13, 1.1e-3, -0.7e-3, -0.06
)
ROTATION = Rotation.from_rotvec([0.4, -0.3, 1.9]).as_matrix()
TRANSLATION = np.array([12.0, -20.0, 400.0])
POINTS = np.random.default_rng(3).uniform(-90, 90, (40, 3))


def numerical(function, n, step):
    columns = []
    for index in range(n):
        plus, minus = np.zeros(n), np.zeros(n)
        plus[index], minus[index] = step[index], -step[index]
        columns.append((function(plus) - function(minus)) / (2 * step[index]))
    return np.stack(columns, axis=-1)


def test_projection_agrees_with_opencv():
    ours = project(CAMERA, ROTATION, TRANSLATION, POINTS)
    theirs, _ = cv2.projectPoints(
        POINTS,
        cv2.Rodrigues(ROTATION)[0],
        TRANSLATION,
        CAMERA.matrix,
        CAMERA.distortion,
    )
    np.testing.assert_allclose(ours, theirs[:, 0], atol=1e-9)


def test_derivatives_agree_with_finite_differences():
    found = project_with_derivatives(CAMERA, ROTATION, TRANSLATION, POINTS)
    np.testing.assert_allclose(
        found.pixels, project(CAMERA, ROTATION, TRANSLATION, POINTS), atol=1e-10
    )
    d_camera = numerical(
        lambda s: project(
            PinholeCamera.from_values(CAMERA.values + s), ROTATION, TRANSLATION, POINTS
        ),
        9,
        np.array([1e-2] * 4 + [1e-4] * 5),
    )
    np.testing.assert_allclose(found.d_camera, d_camera, atol=1e-5)
    d_pose = numerical(
        lambda s: project(CAMERA, *moved_pose(ROTATION, TRANSLATION, s), POINTS),
        6,
        np.array([1e-3] * 3 + [1e-6] * 3),
    )
    np.testing.assert_allclose(found.d_pose, d_pose, rtol=1e-6, atol=2e-4)
    d_point = numerical(
        lambda s: project(CAMERA, ROTATION, TRANSLATION, POINTS + s),
        3,
        np.full(3, 1e-3),
    )
    np.testing.assert_allclose(found.d_point, d_point, atol=1e-6)


def test_many_views_are_projected_at_once():
    turns = Rotation.from_rotvec([[0.4, -0.3, 1.9], [0, 0, 0]]).as_matrix()
    shifts = np.array([TRANSLATION, [0, 0, 300.0]])
    together = project_with_derivatives(CAMERA, turns[:, None], shifts[:, None], POINTS)
    for view in range(2):
        alone = project_with_derivatives(CAMERA, turns[view], shifts[view], POINTS)
        np.testing.assert_allclose(together.d_pose[view], alone.d_pose)


def test_pixels_go_back_to_the_ray_they_came_from():
    ideal = np.random.default_rng(0).uniform(-0.35, 0.35, (200, 2))
    np.testing.assert_allclose(
        to_normalised(CAMERA, to_pixels(CAMERA, ideal)), ideal, atol=1e-12
    )


def test_a_pixel_beyond_the_fold_of_the_distortion_has_no_ray():
    folded = PinholeCamera(1000.0, 1000.0, 0.0, 0.0, k1=-0.3)
    assert np.isnan(to_normalised(folded, np.array([[900.0, 0.0]]))).all()


def test_a_point_behind_the_camera_has_no_pixel():
    found = project_with_derivatives(
        CAMERA, np.eye(3), np.zeros(3), np.array([[0, 0, -5.0], [0, 0, 5.0]])
    )
    assert found.in_front.tolist() == [False, True]
    assert np.isnan(found.pixels[0]).all()
    assert found.pixels[1] == pytest.approx([805.0, 590.0])
