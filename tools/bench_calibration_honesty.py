"""Every estimator against the bound of its own model, over many seeded trials.

    python tools/bench_calibration_honesty.py
    python tools/bench_calibration_honesty.py --robots

A trial gives an error and the covariance that was stated with it. Measured by the
covariance, the spread may exceed the Cramer-Rao bound by 15 % at most, and 55 to 80 %
of the errors must lie within one stated standard deviation. The second command counts
hand-eye alone, with robots that are better than was stated of them.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from calibration.camera import CameraOptions, calibrate_camera
from calibration.hand_eye import Rehearsal, RobotNoise, calibrate_hand_eye, rehearse
from calibration.lens_table import (
    BlurShots,
    LensNode,
    Measured,
    PixelGrid,
    TravelPrior,
    TravelShots,
    defocus,
    measure_aperture,
    measure_travel,
    node_from_views,
    separate,
)
from calibration.observations import Observations
from calibration.part_pose import PartSight, SeenCircles, SeenEdges, SeenPoints, resect
from calibration.part_pose.problem import rim_centres
from calibration.poses import Poses, difference, only
from calibration.projection import CAMERA_NAMES, PinholeCamera, project
from calibration.tsai import TsaiCamera, TsaiOptions, tsai_calibrate
from mvp.testing.paraxial_lens import ParaxialLens

NOISE_PX = 0.1
SIZE = (1600, 1200)
CAMERA = PinholeCamera(2376.4, 2376.4, 806.0, 595.0, k1=-0.12, k2=0.05)
PITCH_MM, F_MM, E_MM = 0.0055, 12.5, 8.0
TSAI = TsaiCamera(PITCH_MM, PITCH_MM, 13.07, 806.0, 595.0, 1.0, 2e-3)
SPEC = RobotNoise(0.2, float(np.radians(0.05)))
WIDE = RobotNoise(1.0, float(np.radians(0.25)))
CUBE = 25.4 * (
    np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)]) - 0.5
)


def board(width_mm=300.0, height_mm=225.0):
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, 12), np.linspace(-0.5, 0.5, 9))
    flat = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    return flat * [width_mm, height_mm, 0.0]


def tilted(rng, count, tilt_deg=30.0):
    about = rng.uniform(0, 1) + 2 * np.pi * np.arange(count) / count
    axis = np.stack([np.cos(about), np.sin(about), 0 * about], axis=1)
    roll = np.outer(rng.uniform(-0.4, 0.4, count), [0, 0, 1.0])
    turn = Rotation.from_rotvec(np.radians(tilt_deg) * axis)
    return (turn * Rotation.from_rotvec(roll)).as_matrix()


def seen_by(camera, rng, rotation, points, distance_mm=500.0):
    shift = np.column_stack(
        [rng.uniform(-8, 8, (len(rotation), 2)), np.full(len(rotation), distance_mm)]
    )
    pixels = [
        camera.project(r, t, points) + rng.normal(0, NOISE_PX, (len(points), 2))
        for r, t in zip(rotation, shift, strict=True)
    ]
    return Observations.from_views([points] * len(pixels), pixels, size_px=SIZE)


def camera(rng):
    free = ("fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2")
    seen = seen_by(CAMERA, rng, tilted(rng, 6), board())
    found = calibrate_camera(seen, CameraOptions(free=free, sigma_px=NOISE_PX, folds=0))
    index = [CAMERA_NAMES.index(name) for name in free]
    error = (found.camera.values - CAMERA.values)[index]
    return error, found.camera_covariance[np.ix_(index, index)]


def tsai(rng, *, views=1, depth_mm=0.0):
    points = board()
    if depth_mm:
        layers = [
            points + np.array([0, 0, z]) for z in np.linspace(-1, 1, 3) * depth_mm
        ]
        points = np.concatenate(layers)
    seen = seen_by(TSAI, rng, tilted(rng, views), points)
    found = tsai_calibrate(TSAI, seen, TsaiOptions(sigma_px=NOISE_PX))
    index = [TSAI.names.index(name) for name in found.free]
    error = (found.camera.values - TSAI.values)[index]
    return error, found.estimate.block(found.free)


def lens_at(u_mm):
    d = F_MM * u_mm / (u_mm - F_MM)
    return ParaxialLens.thin(f_mm=F_MM, d_mm=d, e_mm=E_MM, a_mm=1.0)


def imaged(lens, points, rng):
    sensor = points[:, :2] * lens.scale(points[:, 2])[:, None]
    pixels = sensor / PITCH_MM + CENTRE
    return pixels + rng.normal(0, NOISE_PX, pixels.shape)


CENTRE = np.array([806.0, 595.0])


def lens_node(rng):
    lens, z = lens_at(250.0), 250.0 - E_MM
    side = 0.8 * SIZE[1] * PITCH_MM / float(lens.scale(z))
    points = board(1.3 * side, side)
    pixels = [imaged(lens, points @ turn.T + [0, 0, z], rng) for turn in tilted(rng, 5)]
    seen = Observations.from_views([points] * 5, pixels, size_px=SIZE)
    grid = PixelGrid(PITCH_MM, PITCH_MM, NOISE_PX)
    node, _ = node_from_views(seen, (0, 0), grid, folds=0)
    truth = np.array([float(lens.scale(100.0)) * 100.0, *CENTRE, 0.0])
    return node.values - truth, node.covariance


def travel(rng):
    lens, z, reach = lens_at(250.0), 250.0 - E_MM, 75.0
    side = 0.8 * SIZE[1] * PITCH_MM / float(lens.scale(z - reach / 2))
    points = board(1.2 * side, side)
    along = np.array([0.012, -0.012, 1.0]) / np.linalg.norm([0.012, -0.012, 1.0])
    stops = np.linspace(-reach / 2, reach / 2, 9)
    pixels = []
    for s in stops:
        turn = Rotation.from_rotvec(rng.normal(0, 1e-4, 3))
        turn = turn * Rotation.from_rotvec([0.006, 0.006, 0.1])
        place = rng.normal(0, 0.02, 3) - s * along + [0, 0, z]
        pixels.append(imaged(lens, turn.apply(points) + place, rng))
    centre = CENTRE + rng.normal(0, 2, 2)
    prior = TravelPrior((float(centre[0]), float(centre[1])), 2.0)
    shots = TravelShots(stops, points, np.array(pixels), NOISE_PX, 0.02)
    found = measure_travel(shots, prior)
    truth = np.array([float(lens.scale(100.0)) * 100.0 / PITCH_MM, z])
    error = np.array([found.f_px, found.pupil_to_target_mm]) - truth
    return error, found.estimate.block(("f_px", "tz_mm"))


def separation(rng):
    nodes, truth = [], []
    for step, u in enumerate((150.0, 250.0, 500.0, 1000.0)):
        lens = lens_at(u)
        sigma = np.array([0.002, 0.35, 0.35, 1e-5])
        values = np.array([float(lens.scale(99.0)) * 99.0, 800, 600, 1e-3])
        far = lens.sharp_from_pupil_mm()
        sharp = Measured(far * (1 + rng.normal(0, 0.005)), 0.005 * far)
        cov = np.diag(sigma**2)
        nodes.append(LensNode(0, step, values + rng.normal(0, sigma), cov, sharp))
        truth.append(lens.d_mm)
    found = separate(nodes)
    error = np.array([found.f_mm[0] - F_MM, found.e_mm - E_MM])
    name = [n for n in found.estimate.names if n.startswith(("f_mm", "e_mm"))]
    assert len(name) == 2
    return error, found.estimate.block(name)


def aperture(rng):
    lens = ParaxialLens.thin(f_mm=12.5, d_mm=13.07, e_mm=8.0, a_mm=3.1)
    distances = lens.sharp_from_pupil_mm() * np.linspace(0.6, 1.8, 15)
    blur = np.hypot(lens.blur_mm(distances), 0.006)
    at = defocus(distances, float(lens.scale(100.0)) * 100.0, 0.57 / 12.5)
    sigma = 0.02 * blur + 1e-4
    found = measure_aperture(BlurShots(at, blur + rng.normal(0, sigma), sigma))
    error = np.array([found.a_mm - 3.1, found.sharp_at])
    return error, found.estimate.block(("a_mm", "sharp_at"))


def hand_eye(rng, mount="eye-in-hand"):
    seen = rehearse(Rehearsal(robot=SPEC, mount=mount, columns=7, rows=5), rng)
    found = calibrate_hand_eye(seen.data, Rehearsal().camera, WIDE).solution
    error = difference(only(found.moving_from_camera), seen.moving_from_camera)[0]
    return error, found.covariance


def part(rng, kinds):
    paper = PinholeCamera(13.07 / 0.01625, 13.07 / 0.0135, 255.5, 239.5)
    down = Rotation.from_euler("xyz", [200, 30, 20], degrees=True)
    turn = (down * Rotation.from_rotvec(rng.normal(0, 0.3, 3))).as_matrix()
    place = np.array([0.0, 0, 360]) + rng.normal(0, 5, 3)
    state, sigma = (turn, place), 0.2
    found = {}
    if "corners" in kinds:
        corners = CUBE[np.argsort((CUBE @ turn.T + place)[:, 2])[:7]]
        pixels = project(paper, *state, corners)
        noise = rng.normal(0, sigma, pixels.shape)
        found["points"] = SeenPoints(corners, pixels + noise, sigma)
    if "holes" in kinds:
        empty = SeenCircles(
            rng.uniform(-40, 40, (6, 3)),
            rng.normal(0, 0.3, (6, 3)) + turn.T @ [0, 0, -1.0],
            rng.uniform(3, 6, 6),
            np.zeros((6, 2)),
            sigma,
        )
        pixels, _ = rim_centres(paper, *state, empty)
        found["circles"] = SeenCircles(
            empty.centres_part_mm,
            empty.normals_part,
            empty.radii_mm,
            pixels + rng.normal(0, sigma, pixels.shape),
            sigma,
        )
    if "edges" in kinds:
        ends = CUBE[[[0, 1], [0, 2], [0, 4], [7, 6], [7, 5], [3, 2]]]
        share = rng.uniform(0.05, 0.95, (6, 8, 1))
        places = ends[:, None, 0] + share * (ends[:, None, 1] - ends[:, None, 0])
        pixels = project(paper, *state, places.reshape(-1, 3))
        noise = rng.normal(0, sigma, pixels.shape)
        edge = np.repeat(np.arange(6), 8)
        found["edges"] = SeenEdges(ends, pixels + noise, edge, sigma)
    best = resect(paper, PartSight(**found)).best
    truth = Poses(turn[None], place[None])
    return difference(only(best.camera_from_part), truth)[0], best.estimate.covariance


ESTIMATORS = {
    "camera, 6 views": (40, camera),
    "Tsai, one flat view": (60, tsai),
    "Tsai, planes in depth": (60, lambda rng: tsai(rng, depth_mm=60.0)),
    "Tsai, 4 views": (30, lambda rng: tsai(rng, views=4)),
    "lens node, 5 views": (60, lens_node),
    "lens, frontal target and travel": (60, travel),
    "lens, f and e of 4 focus settings": (200, separation),
    "lens, pupil from blur": (200, aperture),
    "hand-eye, camera on the hand": (30, hand_eye),
    "hand-eye, camera beside": (30, lambda rng: hand_eye(rng, "eye-to-hand")),
    "part, corners": (200, lambda rng: part(rng, "corners")),
    "part, edges": (200, lambda rng: part(rng, "edges")),
    "part, holes and corners": (200, lambda rng: part(rng, "corners holes")),
}


def spread_and_share(trials, estimator):
    """Root mean square error by the stated covariance, and share within one sigma."""
    squares, inside = [], []
    for seed in range(trials):
        error, covariance = estimator(np.random.default_rng([5, seed]))
        squares.append(error @ np.linalg.solve(covariance, error) / len(error))
        inside.append(np.abs(error) < np.sqrt(np.diag(covariance)))
    return float(np.sqrt(np.mean(squares))), float(np.mean(inside))


def robot(mm, deg):
    return RobotNoise(mm, float(np.radians(deg)))


# Robot as it is, as stated, views, columns and rows of corners.
ROBOTS = (
    (None, robot(0.05, 0.005), 25, (11, 8)),
    (None, robot(0.05, 0.005), 25, (7, 5)),
    (robot(0.05, 0.01), robot(0.1, 0.02), 14, (7, 5)),
    (robot(0.2, 0.05), robot(0.2, 0.05), 8, (7, 5)),
    (None, robot(0.2, 0.05), 8, (7, 5)),
)


def robot_row(true, stated, views, corners, trials=30):
    """Errors (trials, 6) in mm and rad, and the same by their stated sigmas."""
    errors, sigmas = [], []
    plan = Rehearsal(robot=true, views=views, columns=corners[0], rows=corners[1])
    for seed in range(trials):
        seen = rehearse(plan, np.random.default_rng([6, seed]))
        found = calibrate_hand_eye(seen.data, Rehearsal().camera, stated).solution
        pose = only(found.moving_from_camera)
        errors.append(difference(pose, seen.moving_from_camera)[0])
        sigmas.append(np.sqrt(np.diag(found.covariance)))
    return np.array(errors), np.array(errors) / sigmas


def named(noise):
    if noise is None:
        return "perfect"
    return f"{noise.position_mm:g} mm, {np.degrees(noise.angle_rad):g} deg"


def robots() -> None:
    """Hand-eye with 30 seeds a line."""
    print("| robot | stated | views | corners | within 1 sigma | within 95 % ", end="")
    print("| RMS by sigma | RMS |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for true, stated, views, corners in ROBOTS:
        errors, pulls = robot_row(true, stated, views, corners)
        rms = [
            np.sqrt((e**2).sum(axis=1).mean()) for e in (errors[:, :3], errors[:, 3:])
        ]
        cells = [named(true), named(stated), str(views), str(corners[0] * corners[1])]
        cells += [f"{100 * np.mean(np.abs(pulls) < w):.0f} %" for w in (1.0, 1.96)]
        cells.append(f"{np.sqrt((pulls**2).mean()):.2f}")
        cells.append(f"{np.degrees(rms[1]):.2g} deg, {rms[0]:.2g} mm")
        print("| " + " | ".join(cells) + " |", flush=True)


def main() -> int:
    asked = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    asked.add_argument("--robots", action="store_true")
    if asked.parse_args().robots:
        robots()
        return 0
    print("| estimator | trials | spread by the bound | within 1 sigma |")
    print("| --- | --- | --- | --- |")
    for name, (trials, estimator) in ESTIMATORS.items():
        spread, share = spread_and_share(trials, estimator)
        print(f"| {name} | {trials} | {spread:.2f} | {100 * share:.0f} % |", flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
