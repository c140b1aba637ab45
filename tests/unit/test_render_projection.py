"""Where things appear: against OpenCV's projection, in formula and in the picture."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from mvp.geometry import Pose, TriangleMesh
from mvp.imaging import (
    Illumination,
    RenderBody,
    RenderQuality,
    render,
    textured_plane,
)
from mvp.optics import Intrinsics, Sensor

FLAT = Illumination(ambient=1.0, lamps=(), gloss=0.0, background=0.0)
F_MM, D_MM, A_MM, E_MM = 12.5, 13.0, 12.5 / 16, 2.4
F_CAL_MM = D_MM - E_MM * (D_MM - F_MM) / F_MM


def lens_intrinsics(width: int, height: int, pitch: float, **more: float) -> Intrinsics:
    sensor = Sensor(width, height, pitch, pitch * 0.9)
    return Intrinsics(sensor, width / 2 + 3.2, height / 2 - 5.1, **more)


def opencv_pixels(
    points_world: np.ndarray, world_from_camera: Pose, intrinsics: Intrinsics
) -> np.ndarray:
    camera = world_from_camera.inverse()
    pixels, _ = cv2.projectPoints(
        points_world,
        camera.rotvec_rad,
        camera.translation_mm,
        intrinsics.camera_matrix(F_CAL_MM),
        intrinsics.distortion,
    )
    return pixels[:, 0]


def polygon_centroid(corners: np.ndarray) -> np.ndarray:
    x, y = (corners - corners[0]).T
    cross = x * np.roll(y, -1) - np.roll(x, -1) * y
    weights = cross / (3 * cross.sum())
    return corners[0] + np.array(
        [(weights * (x + np.roll(x, -1))).sum(), (weights * (y + np.roll(y, -1))).sum()]
    )


def test_projection_is_that_of_opencv() -> None:
    rng = np.random.default_rng(2)
    intrinsics = lens_intrinsics(
        1280, 1024, 0.005, k1=-0.12, k2=0.05, p1=0.001, p2=-0.0007, k3=-0.01
    )
    points = rng.uniform([-60, -50, 250], [60, 50, 400], (200, 3))
    ours = intrinsics.project(points, F_CAL_MM)
    theirs = opencv_pixels(points, Pose.identity("world", "camera"), intrinsics)
    assert np.abs(ours - theirs).max() < 1e-9
    back = intrinsics.to_normalised(ours, F_CAL_MM)
    assert np.abs(back - points[:, :2] / points[:, 2:]).max() < 1e-12


@pytest.mark.parametrize("sharp", [True, False])
def test_small_bodies_appear_where_opencv_projects_them(sharp: bool) -> None:
    rng = np.random.default_rng(4)
    intrinsics = lens_intrinsics(320, 256, 0.02, k1=-0.1, p1=0.001)
    pose = Pose.from_rotvec("world", "camera", [0.1, -0.2, 0.3], [40.0, -30.0, 900.0])
    places = [(-45, -30), (42, -34), (-38, 30), (45, 32), (0, 0), (20, -15)]
    bodies, outlines = [], []
    for x, y in places:
        middle = np.array([x, y, rng.uniform(280, 330)])
        spin = Pose.from_rotvec("a", "b", rng.uniform(-0.4, 0.4, 3), middle)
        square = np.array([[-4, -4, 0], [4, -4, 0], [4, 4, 0], [-4, 4, 0]], float)
        corners = pose.apply(spin.apply(square))
        faces = np.array([[0, 1, 2], [0, 2, 3]])
        bodies.append(
            RenderBody(TriangleMesh(corners, faces, np.zeros(2, np.int64)), 1.0)
        )
        t = np.linspace(0, 1, 50, endpoint=False)[:, None]
        sides = zip(corners, np.roll(corners, -1, axis=0), strict=True)
        outlines.append(np.concatenate([a + t * (b - a) for a, b in sides]))
    grey = render(
        bodies,
        pose,
        d_mm=D_MM,
        f_mm=F_MM,
        a_mm=A_MM,
        e_mm=E_MM,
        intrinsics=intrinsics,
        light=FLAT,
        quality=RenderQuality(defocus=not sharp, diffraction=not sharp),
    ).grey.astype(np.float64)
    for outline in outlines:
        wanted = polygon_centroid(opencv_pixels(outline, pose, intrinsics))
        low = np.round(wanted).astype(int) - 22
        crop = grey[low[1] : low[1] + 45, low[0] : low[0] + 45]
        y, x = np.mgrid[: crop.shape[0], : crop.shape[1]]
        found = low + np.array([(crop * x).sum(), (crop * y).sum()]) / crop.sum()
        assert np.abs(found - wanted).max() < 0.02


def chessboard(columns: int, rows: int, texels: int) -> np.ndarray:
    cells = np.add.outer(np.arange(rows), np.arange(columns)) % 2
    board = np.kron(cells, np.ones((texels, texels)))
    framed = np.pad(board, texels, constant_values=1.0)
    return (0.05 + 0.85 * framed).astype(np.float32)


@pytest.mark.parametrize("tilt", [0.0, 0.5])
@pytest.mark.parametrize("texels", [6, 40])
def test_a_printed_chessboard_is_found_where_opencv_projects_it(
    tilt: float, texels: int
) -> None:
    size_mm = 8.0
    intrinsics = lens_intrinsics(640, 512, 0.01, k1=-0.1)
    world_from_print = Pose.from_rotvec(
        "world", "texture", [tilt, 0.1, 0.05], [-40.0, -32.0, 310.0]
    )
    pose = Pose.identity("world", "camera")
    board = textured_plane(chessboard(8, 6, texels), size_mm / texels, world_from_print)
    grey = render(
        [board],
        pose,
        d_mm=D_MM,
        f_mm=F_MM,
        a_mm=A_MM,
        e_mm=E_MM,
        intrinsics=intrinsics,
        light=Illumination(ambient=1.0, lamps=(), gloss=0.0, background=0.4),
    ).grey
    picture = np.clip(grey * 255, 0, 255).astype(np.uint8)
    found, corners = cv2.findChessboardCorners(picture, (7, 5))
    assert found
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-4)
    corners = cv2.cornerSubPix(picture, corners, (5, 5), (-1, -1), criteria)[:, 0]
    x, y = np.meshgrid(np.arange(7) + 2.0, np.arange(5) + 2.0)
    inner = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3) * size_mm
    wanted = opencv_pixels(world_from_print.apply(inner), pose, intrinsics)
    off = wanted[:, None] - corners[None]
    nearest = np.linalg.norm(off, axis=-1).argmin(axis=1)
    off = off[np.arange(len(wanted)), nearest]
    # The corner finder errs by as much itself where edges are sharper than its pixels.
    assert np.linalg.norm(off, axis=1).max() < 0.1
    assert np.abs(off.mean(axis=0)).max() < 0.012


def test_the_outline_of_a_printed_plane_is_as_exact_as_any_edge() -> None:
    intrinsics = lens_intrinsics(160, 128, 0.02)
    grey = np.full((20, 20), 0.7, dtype=np.float32)
    world_from_print = Pose("world", "texture", np.eye(3), np.array([-9, -11, 300.0]))
    picture = render(
        [textured_plane(grey, 1.0, world_from_print)],
        Pose.identity("world", "camera"),
        d_mm=D_MM,
        f_mm=F_MM,
        a_mm=A_MM,
        intrinsics=intrinsics,
        light=FLAT,
    ).grey
    area_px = (20 * D_MM / 300.0) ** 2 / (0.02 * 0.018)
    assert picture.sum() / 0.7 == pytest.approx(area_px, rel=2e-4)
