"""Camera calibration from a target that is bent or stretched, beside OpenCV."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from calibration.camera import calibrate_camera
from calibration.observations import Observations
from calibration.projection import PinholeCamera, project
from calibration.target_shape import ShapePrior
from calibration.wizard.camera_views import camera_options
from tools.bench_calibration_rows import Clock, Row, rms

if TYPE_CHECKING:
    from collections.abc import Iterator

    from calibration.camera import CameraOptions

CAMERA = PinholeCamera(1500.0, 1500.0, 645.0, 475.0, k1=-0.1)
SIZE_PX, NOISE_PX, VIEWS = (1280, 960), 0.1, 14
BENDS = {
    "flat": (0.0, 0.0),
    "bow 0.6 mm": (0.6, 0.0),
    "stretched by 1 %": (0.0, 0.01),
}
FLAGS = cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_ASPECT_RATIO | cv2.CALIB_FIX_K3
# OpenCV 4.14 ends with an assertion where points are released and this is not set.
RELEASED = FLAGS | int(getattr(cv2, "CALIB_DISABLE_SCHUR_COMPLEMENT", 0))


def board() -> np.ndarray:
    """9 x 6 points, 200 x 125 mm."""
    x, y = np.meshgrid(np.linspace(-100, 100, 9), np.linspace(-62.5, 62.5, 6))
    return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)


def bent(points: np.ndarray, bow_mm: float, stretch: float) -> np.ndarray:
    """What is printed instead: bowed along x, longer along y."""
    bow = bow_mm * (1 - (points[:, 0] / points[:, 0].max()) ** 2)
    return points * [1, 1 + stretch, 1] + np.outer(bow, [0, 0, 1.0])


def views(
    rng: np.random.Generator, printed: np.ndarray, count: int = VIEWS
) -> Observations:
    """Tilted by 32 deg about axes all around."""
    about = rng.uniform(0, 1) + 2 * np.pi * np.arange(count) / count
    axis = np.stack([np.cos(about), np.sin(about), 0 * about], axis=1)
    roll = Rotation.from_rotvec(np.outer(0.7 * np.cos(3 * about), [0, 0, 1.0]))
    turns = (Rotation.from_rotvec(np.radians(32.0) * axis) * roll).as_matrix()
    places = np.array([0, 0, 420.0]) + rng.uniform(-8, 8, (count, 3))
    pixels = [
        project(CAMERA, turn, place, printed)
        + rng.normal(0, NOISE_PX, (len(printed), 2))
        for turn, place in zip(turns, places, strict=True)
    ]
    return Observations.from_views([board()] * count, pixels, size_px=SIZE_PX)


def opencv_focal(seen: Observations, *, released: bool) -> float:
    """By ``calibrateCamera``, or by ``calibrateCameraRO``, which moves the points too."""
    both = [seen.of_view(i) for i in range(seen.views)]
    points = [p.astype(np.float32) for p, _ in both]
    pixels = [q.astype(np.float32) for _, q in both]
    start = np.array([[1450.0, 0, 639.5], [0, 1450.0, 479.5], [0, 0, 1]])
    if released:
        fixed = 8
        found = cv2.calibrateCameraRO(
            points, pixels, SIZE_PX, fixed, start, np.zeros(5), flags=RELEASED
        )
    else:
        found = cv2.calibrateCamera(
            points, pixels, SIZE_PX, start, np.zeros(5), flags=FLAGS
        )
    return float(found[1][0, 0])


def bench_bent(trials: int, rng: np.random.Generator) -> Iterator[Row]:
    """f of 1500 px by the camera wizard's options and by OpenCV's two functions."""
    how = camera_options(1.0, ShapePrior.of_a_print(board()))
    how = replace(how, folds=0)
    for words, bend in BENDS.items():
        clock, ours, inside = Clock(), [], []
        theirs: dict[bool, list[float]] = {False: [], True: []}
        for _ in range(trials):
            seen = views(rng, bent(board(), *bend))
            found = clock.run("ours", lambda s=seen: calibrate_camera(s, how))
            ours.append(found.camera.fx_px - CAMERA.fx_px)
            inside.append(abs(ours[-1]) < found.sigma_of("fx_px"))
            for released, errors in theirs.items():
                f = clock.run(
                    f"cv2 {released}",
                    lambda s=seen, r=released: opencv_focal(s, released=r),
                )
                errors.append(f - CAMERA.fx_px)
        for released, errors in theirs.items():
            yield Row(
                f"target, {words}: f, 14 views",
                "px",
                rms(ours),
                rms(errors),
                "OpenCV calibrateCamera" + ("RO" if released else ""),
                1.0,
                float(np.mean(inside)),
                clock.mean_s("ours"),
                clock.mean_s(f"cv2 {released}"),
            )
    yield from cost_of_the_shape(trials, rng, how)


def cost_of_the_shape(
    trials: int, rng: np.random.Generator, how: CameraOptions
) -> Iterator[Row]:
    """What is stated of f on a flat board, its shape sought or taken at its word."""
    for count in (VIEWS, 4):
        clock, sought, told = Clock(), [], []
        for _ in range(trials):
            seen = views(rng, board(), count)
            for sigmas, one in ((sought, how), (told, replace(how, shape=None))):
                found = clock.run("ours", lambda s=seen, o=one: calibrate_camera(s, o))
                sigmas.append(found.sigma_of("fx_px"))
        yield Row(
            f"target, flat: stated deviation of f, {count} views",
            "px",
            rms(sought),
            rms(told),
            "ours, the board taken at its word",
            None,
            None,
            clock.mean_s("ours"),
            None,
        )
