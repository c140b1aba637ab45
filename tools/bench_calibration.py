"""Calibration beside OpenCV: the same seeded data for both, errors against the truth."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from calibration.camera import CameraOptions, calibrate_camera
from calibration.lens_table import (
    LensNode,
    Measured,
    PixelGrid,
    TravelPrior,
    TravelShots,
    measure_travel,
    node_from_views,
    separate,
)
from calibration.observations import Observations
from calibration.projection import PinholeCamera, project
from calibration.tsai import TsaiCamera, TsaiOptions, tsai_calibrate
from mvp.testing.paraxial_lens import ParaxialLens
from tools.bench_calibration_charuco import bench_charuco
from tools.bench_calibration_poses import bench_hand_eye, bench_part
from tools.bench_calibration_real import bench_boards, bench_willson
from tools.bench_calibration_rows import Clock, Row, rms, shown, table
from tools.bench_calibration_target import bench_bent

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

PITCH_MM, F_MM, E_MM, NOISE_PX = 0.0055, 12.5, 8.0, 0.1
SIZE_PX = (1600, 1200)
CENTRE = np.array([806.0, 595.0])
K1_PER_MM2 = -2e-3
FOCUSED_MM = (150.0, 250.0, 500.0, 1000.0)
SHARP_SHARE = 0.005
CAMERA = PinholeCamera(13.07 / PITCH_MM, 13.07 / PITCH_MM, *CENTRE, k1=-0.34)
FIX_ALL_BUT_K1 = (
    cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST
) | cv2.CALIB_FIX_ASPECT_RATIO


def lens_at(u_mm: float) -> ParaxialLens:
    """Focused u from the front nodal point."""
    d = F_MM * u_mm / (u_mm - F_MM)
    return ParaxialLens.thin(f_mm=F_MM, d_mm=d, e_mm=E_MM, a_mm=1.0)


def f_cal_of(lens: ParaxialLens) -> float:
    """Principal distance, from a chief ray."""
    return float(lens.scale(100.0)) * 100.0


def board(lens: ParaxialLens, z_mm: float, fill: float = 0.8) -> np.ndarray:
    """12 x 9 points that fill a share of the picture's short side at a distance."""
    side = fill * SIZE_PX[1] * PITCH_MM / float(lens.scale(z_mm))
    x, y = np.meshgrid(np.linspace(-0.65, 0.65, 12), np.linspace(-0.5, 0.5, 9))
    return np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3) * side


def imaged(
    lens: ParaxialLens,
    points: np.ndarray,
    rng: np.random.Generator,
    k1_per_mm2: float = K1_PER_MM2,
) -> np.ndarray:
    """Pixels of points (m, 3) in camera axes: chief rays, k1, noise."""
    sensor = points[:, :2] * lens.scale(points[:, 2])[:, None]
    r2 = (sensor**2).sum(axis=1, keepdims=True)
    pixels = sensor * (1 + k1_per_mm2 * r2) / PITCH_MM + CENTRE
    return pixels + rng.normal(0, NOISE_PX, pixels.shape)


def tilted(
    lens: ParaxialLens,
    u_mm: float,
    views: int,
    rng: np.random.Generator,
    k1_per_mm2: float = K1_PER_MM2,
) -> Observations:
    """Pictures of the board tilted by 30 deg about axes all around."""
    points, z = board(lens, u_mm - E_MM), np.array([0, 0, u_mm - E_MM])
    pixels = []
    for angle in rng.uniform(0, 1) + 2 * np.pi * np.arange(views) / views:
        about = np.radians(30) * np.array([np.cos(angle), np.sin(angle), 0])
        turned = Rotation.from_rotvec(about).apply(points)
        pixels.append(imaged(lens, turned + z, rng, k1_per_mm2))
    return Observations.from_views([points] * views, pixels, size_px=SIZE_PX)


def opencv_camera(seen: Observations, more_flags: int = 0) -> np.ndarray:
    """fx, cx, cy by ``cv2.calibrateCamera`` with k1 and one focal length."""
    views = [seen.of_view(i) for i in range(seen.views)]
    points = [p.astype(np.float32) for p, _ in views]
    pixels = [q.astype(np.float32) for _, q in views]
    start = np.array([[2300.0, 0, CENTRE[0]], [0, 2300.0, CENTRE[1]], [0, 0, 1]])
    flags = FIX_ALL_BUT_K1 | cv2.CALIB_USE_INTRINSIC_GUESS | more_flags
    found = cv2.calibrateCamera(
        points, pixels, SIZE_PX, start, np.zeros(5), flags=flags
    )
    return np.array([found[1][0, 0], *found[1][:2, 2]])


def wide_tilts(rng: np.random.Generator, views: int) -> Observations:
    """12 x 9 squares over 80 % of the short side at 500 mm, tilted by 25 to 40 deg."""
    squares = np.mgrid[:12, :9].T.reshape(-1, 2)
    points = np.pad(squares - squares.mean(axis=0), ((0, 0), (0, 1)))
    points *= 0.8 * SIZE_PX[1] / 8 * 500.0 / CAMERA.fx_px
    angles = rng.uniform(0, 1) + 2 * np.pi * np.arange(views) / views
    axes = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    tilts = np.radians(rng.uniform(25, 40, (views, 1)))
    turns = Rotation.from_rotvec(tilts * axes).as_matrix()
    pixels = project(CAMERA, turns[:, None], np.array([0, 0, 500.0]), points)
    pixels += rng.normal(0, NOISE_PX, pixels.shape)
    return Observations.from_views([points] * views, list(pixels), size_px=SIZE_PX)


def bench_camera(trials: int, rng: np.random.Generator) -> Iterator[Row]:
    """Five and ten views tilted by 25 to 40 deg: principal distance and centre.

    The bound beside is Cramer and Rao's: no estimator without bias has a smaller error
    on average, so that trials may well miss a bar that lies below it.
    """
    for views, share, centre_px in ((5, 1.6e-4, 0.5), (10, 0.9e-4, 0.35)):
        yield from camera_rows(trials, rng, views, (share, centre_px))


def camera_rows(
    trials: int, rng: np.random.Generator, views: int, bars: tuple[float, float]
) -> Iterator[Row]:
    """Both programs; bars: a share of the principal distance, and px of the centre."""
    names, clock = ("fx_px", "cx_px", "cy_px"), Clock()
    options = CameraOptions(
        free=("fx_px", "fy_px", "cx_px", "cy_px", "k1"),
        tied_focal=True,
        sigma_px=NOISE_PX,
        folds=0,
    )
    truth = np.array([getattr(CAMERA, name) for name in names])
    ours, rival, sigma = [], [], []
    for _ in range(trials):
        seen = wide_tilts(rng, views)
        found = clock.run("ours", lambda seen=seen: calibrate_camera(seen, options))
        ours.append([getattr(found.camera, name) for name in names] - truth)
        sigma.append([found.sigma_of(name) for name in names])
        rival.append(clock.run("cv2", lambda seen=seen: opencv_camera(seen)) - truth)
    ours, rival, sigma = (np.array(values) for values in (ours, rival, sigma))
    um = 1e3 * PITCH_MM
    for name, columns, unit, scale, bar in (
        ("principal distance", [0], "um", um, um * bars[0] * CAMERA.fx_px),
        ("image centre", [1, 2], "px", 1.0, bars[1]),
    ):
        bound = rms(sigma[:, columns]) * scale
        yield Row(
            f"camera: {name}, {views} views at 25-40 deg",
            unit,
            rms(ours[:, columns]) * scale,
            rms(rival[:, columns]) * scale,
            f"OpenCV calibrateCamera; bound {bound:.3g}",
            bar,
            float(np.mean(np.abs(ours[:, columns]) < sigma[:, columns])),
            clock.mean_s("ours"),
            clock.mean_s("cv2"),
        )


def bench_tsai(trials: int, rng: np.random.Generator) -> Iterator[Row]:
    """One view at 30 deg, centre known: two stages, refined, and OpenCV.

    Without distortion, which Tsai and OpenCV model in opposite directions; both seek k1.
    """
    lens, clock = lens_at(500.0), Clock()
    truth = f_cal_of(lens)
    known = TsaiCamera(PITCH_MM, PITCH_MM, 12.0, *CENTRE)
    staged, ours, sigma, rival = [], [], [], []
    for _ in range(trials):
        seen = tilted(lens, 500.0, 1, rng, 0.0)
        options = TsaiOptions(sigma_px=NOISE_PX)
        found = clock.run(
            "ours", lambda seen=seen, how=options: tsai_calibrate(known, seen, how)
        )
        staged.append(found.stages[0].camera.f_mm - truth)
        ours.append(found.camera.f_mm - truth)
        sigma.append(found.estimate.sigma_of("f_mm"))
        fixed = cv2.CALIB_FIX_PRINCIPAL_POINT
        theirs = clock.run("cv2", lambda s=seen, f=fixed: opencv_camera(s, f))
        rival.append(theirs[0] * PITCH_MM - truth)
    for name, errors, honest in (
        ("two stages", staged, None),
        ("refined", ours, float(np.mean(np.abs(ours) < np.array(sigma)))),
    ):
        yield Row(
            f"Tsai, 1 view at 30 deg: f, {name}",
            "um",
            rms(errors) * 1e3,
            rms(rival) * 1e3,
            "OpenCV calibrateCamera, centre fixed",
            0.8 * truth,
            honest,
            clock.mean_s("ours"),
            clock.mean_s("cv2"),
        )


def focused_nodes(
    rng: np.random.Generator, clock: Clock
) -> tuple[list[LensNode], np.ndarray]:
    """Nodes of four focus settings, and what OpenCV has for each f_cal."""
    nodes, theirs = [], []
    for step, u in enumerate(FOCUSED_MM):
        lens = lens_at(u)
        seen = tilted(lens, u, 5, rng)
        far = lens.sharp_from_pupil_mm()
        sharp = Measured(far * (1 + rng.normal(0, SHARP_SHARE)), far * SHARP_SHARE)
        grid = PixelGrid(PITCH_MM, PITCH_MM, NOISE_PX)
        node, _ = node_from_views(seen, (0, step), grid, sharp_mm=sharp, folds=0)
        nodes.append(node)
        found = clock.run("cv2", lambda seen=seen: opencv_camera(seen))
        theirs.append(found[0] * PITCH_MM)
    return nodes, np.array(theirs)


def bench_focus(trials: int, rng: np.random.Generator) -> Iterator[Row]:
    """f, d and e of four focus settings; OpenCV's focal length taken for d beside it."""
    d_true = np.array([lens_at(u).d_mm for u in FOCUSED_MM])
    clock, errors, sigmas, rival = Clock(), [], [], []
    for _ in range(trials):
        nodes, theirs = focused_nodes(rng, clock)
        found = clock.run("ours", lambda nodes=nodes: separate(nodes))
        off = [found.f_mm[0] - F_MM, found.e_mm - E_MM, *(found.d_mm - d_true)]
        errors.append(off)
        sigmas.append([found.f_sigma_mm[0], found.e_sigma_mm, *found.d_sigma_mm])
        rival.append(theirs - d_true)
    off, sigma = np.array(errors), np.array(sigmas)
    for name, columns, unit, scale, bar in (
        ("f", [0], "um", 1e3, 4.0),
        ("pupil offset e", [1], "mm", 1.0, 0.3),
        ("d", [2, 3, 4, 5], "um", 1e3, 0.5 * float(d_true.min())),
    ):
        theirs = rms(np.array(rival)) * scale if name == "d" else None
        yield Row(
            f"lens: {name} from 4 focus settings",
            unit,
            rms(off[:, columns]) * scale,
            theirs,
            "OpenCV's focal length taken for d" if theirs else "",
            bar,
            float(np.mean(np.abs(off[:, columns]) < sigma[:, columns])),
            clock.mean_s("ours"),
            4 * clock.mean_s("cv2") if theirs else None,
        )


def travel_shots(rng: np.random.Generator) -> TravelShots:
    """Nine stops over 75 mm with 0.02 mm, one degree off the axis."""
    lens, z = lens_at(250.0), 250.0 - E_MM
    points = board(lens, z - 37.5)
    travel = np.linspace(-37.5, 37.5, 9)
    along = np.array([0.012, -0.012, 1.0]) / np.linalg.norm([0.012, -0.012, 1.0])
    pixels = []
    for s in travel:
        turn = Rotation.from_rotvec(np.array([0.006, 0.006, 0.1]))
        turn = Rotation.from_rotvec(rng.normal(0, 1e-4, 3)) * turn
        place = np.array([0, 0, z]) - s * along + rng.normal(0, 0.02, 3)
        pixels.append(imaged(lens, turn.apply(points) + place, rng))
    return TravelShots(travel, points, np.array(pixels), NOISE_PX, 0.02)


def opencv_frontal(shots: TravelShots) -> float:
    """What ``cv2.calibrateCamera`` makes of the same nearly frontal pictures, px."""
    count = len(shots.travel_mm)
    seen = Observations.from_views(
        [shots.points_target_mm] * count, list(shots.pixels), size_px=SIZE_PX
    )
    return float(opencv_camera(seen)[0])


def bench_travel(trials: int, rng: np.random.Generator) -> Iterator[Row]:
    """A squarely faced target and a travel of 75 mm."""
    truth = f_cal_of(lens_at(250.0))
    clock, errors, sigmas, rival = Clock(), [], [], []
    for _ in range(trials):
        shots = travel_shots(rng)
        centre = CENTRE + rng.normal(0, 2, 2)
        prior = TravelPrior((float(centre[0]), float(centre[1])), 2.0)
        found = clock.run("ours", lambda s=shots, p=prior: measure_travel(s, p))
        off = found.pupil_to_target_mm - (250.0 - E_MM)
        errors.append([found.f_px * PITCH_MM - truth, off])
        sigmas.append([found.f_sigma_px * PITCH_MM, found.pupil_sigma_mm])
        theirs = clock.run("cv2", lambda s=shots: opencv_frontal(s))
        rival.append(theirs * PITCH_MM - truth)
    off, sigma = np.array(errors), np.array(sigmas)
    names = ("principal distance", "um", 1e3, 6.5), ("entrance pupil", "mm", 1.0, 0.3)
    for column, (name, unit, scale, bar) in enumerate(names):
        theirs = rms(rival) * scale if column == 0 else None
        yield Row(
            f"travel: {name}, 75 mm at 0.02 mm",
            unit,
            rms(off[:, column]) * scale,
            theirs,
            "OpenCV calibrateCamera, same pictures" if theirs else "",
            bar,
            float(np.mean(np.abs(off[:, column]) < sigma[:, column])),
            clock.mean_s("ours"),
            clock.mean_s("cv2") if theirs else None,
        )


BENCHES: dict[str, Callable[[int, np.random.Generator], Iterator[Row]]] = {
    "camera": bench_camera,
    "tsai": bench_tsai,
    "focus": bench_focus,
    "travel": bench_travel,
    "hand-eye": bench_hand_eye,
    "part": bench_part,
    "charuco": bench_charuco,
    "willson": bench_willson,
    "boards": bench_boards,
    "target": bench_bent,
}


def main() -> int:
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--trials", type=int, default=10)
    asked.add_argument("--seed", type=int, default=0)
    asked.add_argument("--only", choices=BENCHES, action="append")
    asked.add_argument("--json", action="store_true")
    asked.add_argument("--markdown", action="store_true")
    given = asked.parse_args()
    rows = []
    for name in given.only or BENCHES:
        rng = np.random.default_rng([given.seed, list(BENCHES).index(name)])
        rows += list(BENCHES[name](given.trials, rng))
    if given.json:
        print(json.dumps([asdict(row) for row in rows], indent=1))
    elif given.markdown:
        print(table(rows))
    else:
        print(f"{'RMS error':46} {'ours':>9} {'rival':>9} {'':>4} {'bar':>7}")
        print("\n".join(shown(row) for row in rows))
    return 0 if all(row.kept for row in rows) else 1


if __name__ == "__main__":
    raise SystemExit(main())
