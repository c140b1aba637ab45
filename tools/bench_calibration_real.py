"""Camera calibration on data that others took: Willson's points, OpenCV's chessboards."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from calibration.camera import CameraOptions, calibrate_camera
from calibration.observations import Observations
from calibration.target_shape import ShapePrior
from calibration.tsai import TsaiCamera, TsaiOptions, tsai_calibrate
from tools.bench_calibration_rows import Clock, Row

if TYPE_CHECKING:
    from collections.abc import Iterator

    from calibration.tsai import TsaiEstimate

DATA = Path(__file__).parents[2] / "shared" / "data"
SAMPLED = TsaiCamera(0.023, 0.023, 1.0, 262.0, 212.0)
WILLSON = {
    "cc": ("Willson's flat target", {"f / Tz": 270 / 6600}),
    "ncc": ("Willson's three planes", {"f": 70.0, "f / Tz": 70 / 2000}),
}
SIDES, WINDOW = ("left", "right"), (5, 5)
SQUARE_MM = 25.0


def willson(name: str) -> tuple[Observations, dict[str, float]]:
    """The points, and what his own program made of them."""
    folder = DATA / "tsai_3.0b3"
    rows = np.loadtxt(folder / f"{name}_cd.dat")
    numbers = np.loadtxt(folder / f"{name}_cpcc.dat")[6:17].tolist()
    names = "cx cy sx f k1 tx ty tz rx ry rz".split()
    seen = Observations.from_views([rows[:, :3]], [rows[:, 3:]], size_px=(576, 432))
    return seen, dict(zip(names, numbers, strict=True))


def bench_willson(trials: int, rng: np.random.Generator) -> Iterator[Row]:
    """How far off Willson's answer we are, and both off the truth of his generator.

    One view of a flat target hardly separates f from the distance: f / Tz is asked for.
    """
    del trials, rng
    if not (DATA / "tsai_3.0b3").is_dir():
        return
    for name, (words, truth) in WILLSON.items():
        (seen, his), clock = willson(name), Clock()
        free = TsaiOptions(free_centre=True)
        found = clock.run(
            "ours", lambda seen=seen, how=free: tsai_calibrate(SAMPLED, seen, how)
        )
        ratio = found.camera.f_mm / found.state.translation_mm[0, 2]
        both = {
            "f": (found.camera.f_mm, his["f"]),
            "f / Tz": (ratio, his["f"] / his["tz"]),
        }
        for what, unit, off, bar in off_willsons(found, his, both, flat=name == "cc"):
            yield Row(
                f"{words}: {what}",
                unit,
                off,
                None,
                "off Willson's program",
                bar,
                None,
                clock.mean_s("ours"),
                None,
            )
        for what, value in truth.items():
            ours, rival = (1e4 * abs(one / value - 1) for one in both[what])
            yield Row(
                f"{words}: {what} off the truth",
                "1e-4",
                ours,
                rival,
                "Willson's program",
                None,
                None,
                clock.mean_s("ours"),
                None,
            )


def off_willsons(
    found: TsaiEstimate,
    his: dict[str, float],
    both: dict[str, tuple[float, float]],
    *,
    flat: bool,
) -> Iterator[tuple[str, str, float, float]]:
    """What, unit, how far off his answer, and the bar."""
    camera, shift = found.camera, found.state.translation_mm[0]
    if flat:
        ours, theirs = both["f / Tz"]
        yield "f / Tz", "1e-4", 1e4 * abs(ours / theirs - 1), 1.0
    else:
        yield "f", "mm", abs(camera.f_mm - his["f"]), 0.35
        yield "sx", "1e-5", 1e5 * abs(camera.sx - his["sx"]), 3.0
    yield "k1", "%", 100 * abs(camera.k1_per_mm2 / his["k1"] - 1), 2.0
    turn = Rotation.from_matrix(found.state.rotation[0])
    theirs_turn = Rotation.from_euler("xyz", [his["rx"], his["ry"], his["rz"]])
    angle = float(np.degrees((turn * theirs_turn.inv()).magnitude()))
    yield "rotation", "deg", angle, 0.05
    across = float(np.abs(shift[:2] - [his["tx"], his["ty"]]).max())
    yield "Tx, Ty", "mm", across, 0.3
    yield "residual", "px", found.rms_px, 0.12 if flat else 0.09


def chessboards(side: str) -> Observations:
    """Corners of the thirteen pictures of one camera, by OpenCV's own detector."""
    points = np.zeros((54, 3))
    points[:, :2] = SQUARE_MM * np.mgrid[0:9, 0:6].T.reshape(-1, 2)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 60, 1e-4)
    pixels = []
    for path in sorted((DATA / "opencv_chessboard").glob(f"{side}*.jpg")):
        grey = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        _, corners = cv2.findChessboardCorners(grey, (9, 6))
        corners = cv2.cornerSubPix(grey, corners, WINDOW, (-1, -1), stop)
        pixels.append(corners[:, 0].astype(float))
    return Observations.from_views([points] * len(pixels), pixels, size_px=(640, 480))


def opencv_rms(seen: Observations) -> tuple[float, np.ndarray]:
    """Residual and camera matrix of ``cv2.calibrateCamera`` with five distortion terms."""
    views = [seen.of_view(i) for i in range(seen.views)]
    rms, matrix, *_ = cv2.calibrateCamera(
        [p.astype(np.float32) for p, _ in views],
        [q.astype(np.float32) for _, q in views],
        (seen.width_px, seen.height_px),
        None,
        None,
    )
    return rms, matrix


def bench_boards(trials: int, rng: np.random.Generator) -> Iterator[Row]:
    """The same corners for both; then with the board's own shape, which OpenCV has not."""
    del trials, rng
    if not (DATA / "opencv_chessboard").is_dir():
        return
    for side in SIDES:
        seen, clock = chessboards(side), Clock()
        rms, matrix = clock.run("cv2", lambda s=seen: opencv_rms(s))
        flat = CameraOptions(folds=0)
        found = clock.run("ours", lambda s=seen, o=flat: calibrate_camera(s, o))
        bent = replace(flat, shape=ShapePrior.of_a_print(seen.points_target_mm))
        shaped = clock.run("bent", lambda s=seen, o=bent: calibrate_camera(s, o))
        words = shaped.shape.words if shaped.shape else ""
        for how, one, name, bar in (
            ("as told", found, "ours", 0.02),
            ("with the board's shape", shaped, "bent", None),
        ):
            what = f"OpenCV's {side} chessboards, {how}"
            spent = clock.mean_s(name), clock.mean_s("cv2")
            against = "OpenCV calibrateCamera" + (f"; {words}" if bar is None else "")
            yield Row(
                f"{what}: residual",
                "px",
                one.rms_px,
                rms,
                against,
                1.001 * rms,
                None,
                *spent,
            )
            off = abs(one.camera.fx_px - float(matrix[0, 0]))
            yield Row(
                f"{what}: fx off OpenCV's",
                "px",
                off,
                None,
                against,
                bar,
                None,
                *spent,
            )
