"""Targets as they are drawn: found by the detector where the camera projects them."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from calibration.targets import (
    Charuco,
    Chessboard,
    CircleGrid,
    Detection,
    Target,
    detect,
    nominal,
    target_of_print,
)
from mvp.calibrated import TargetPrint
from mvp.errors import ConfigError
from mvp.geometry import Pose
from mvp.imaging import Illumination, SensorNoise, expose, printed_target, render
from mvp.imaging.printed_target import extent_mm, target_albedo
from mvp.optics import Intrinsics, Sensor

F_MM, D_MM, A_MM, E_MM = 12.5, 12.97, 12.5 / 16, 2.4
F_CAL_MM = D_MM - E_MM * (D_MM - F_MM) / F_MM
BOARD = TargetPrint(kind="charuco", columns=12, rows=9, square_mm=15.0, marker_mm=10.5)
CASES: dict[str, tuple[TargetPrint, Target]] = {
    "charuco": (BOARD, Charuco(12, 9, nominal(15.0), 10.5)),
    "charuco with an even number of rows": (
        TargetPrint(kind="charuco", columns=9, rows=8, square_mm=17.3, marker_mm=11.9),
        Charuco(9, 8, nominal(17.3), 11.9),
    ),
    "chessboard": (
        TargetPrint(kind="chessboard", columns=9, rows=6, square_mm=14.0),
        Chessboard(9, 6, nominal(14.0)),
    ),
    "circle grid": (
        TargetPrint(kind="circle-grid", columns=9, rows=7, square_mm=14.0, disc_mm=8.0),
        CircleGrid(9, 7, nominal(14.0), 8.0),
    ),
    "legacy charuco": (
        TargetPrint(
            kind="charuco",
            columns=9,
            rows=8,
            square_mm=17.3,
            marker_mm=11.9,
            legacy=True,
        ),
        Charuco(9, 8, nominal(17.3), 11.9, legacy=True),
    ),
    "asymmetric grid": (
        TargetPrint(
            kind="circle-grid",
            columns=5,
            rows=9,
            square_mm=13.0,
            disc_mm=10.0,
            asymmetric=True,
        ),
        CircleGrid(5, 9, nominal(13.0), 10.0, asymmetric=True),
    ),
}


@pytest.mark.parametrize(
    ("case", "tilt_deg"),
    [
        ("charuco", 35.0),
        ("charuco with an even number of rows", 0.0),
        ("chessboard", 20.0),
        ("circle grid", 35.0),
        ("legacy charuco", 20.0),
        ("asymmetric grid", 30.0),
    ],
)
def test_every_corner_is_found_where_opencv_projects_it(
    case: str, tilt_deg: float
) -> None:
    layout, target = CASES[case]
    sensor = Sensor(640, 512, 0.01, 0.01)
    intrinsics = Intrinsics(sensor, 323.4, 252.2, k1=-0.1)
    middle = np.mean(extent_mm(layout), axis=0)
    turn = Pose.from_rotvec(
        "camera", "target", np.radians([tilt_deg, 0.3 * tilt_deg, 4.0]), np.zeros(3)
    )
    place = np.array([2.0, -3.0, 470.0]) - turn.apply(np.array([*middle, 0.0]))
    pose = Pose("world", "target", turn.rotation, place)
    picture = render(
        [printed_target(layout, pose)],
        Pose.identity("world", "camera"),
        d_mm=D_MM,
        f_mm=F_MM,
        a_mm=A_MM,
        e_mm=E_MM,
        intrinsics=intrinsics,
        light=Illumination(ambient=1.0, lamps=(), gloss=0.0, background=0.3),
    )
    grey = expose(
        picture,
        0.015,
        sensor=SensorNoise(10_000.0, 8.0),
        rng=np.random.default_rng(3),
    )
    found = detect(np.asarray(grey, np.uint8), target)
    assert isinstance(found, Detection), found
    assert len(found.ids) == len(target.points_mm)
    wanted, _ = cv2.projectPoints(
        target.points_mm[found.ids],
        pose.rotvec_rad,
        pose.translation_mm,
        intrinsics.camera_matrix(F_CAL_MM),
        intrinsics.distortion,
    )
    gap = found.pixels - wanted[:, 0]
    assert np.abs(gap.mean(axis=0)).max() < 0.03
    assert np.linalg.norm(gap, axis=1).max() < 0.15
    assert np.sqrt((gap**2).sum(axis=1).mean()) < 0.08


@pytest.mark.parametrize("case", CASES)
def test_a_layout_is_the_target_that_is_looked_for(case: str) -> None:
    layout, target = CASES[case]
    assert target_of_print(layout, target.spacing.sigma_mm) == target


@pytest.mark.parametrize("rows", [8, 9])
@pytest.mark.parametrize("legacy", [False, True])
def test_a_charuco_board_is_that_of_opencv(rows: int, legacy: bool) -> None:
    layout = BOARD.model_copy(update={"rows": rows, "legacy": legacy})
    texel = 0.75  # of a square of 15 and a marker of 7 modules: nothing is cut
    drawn = target_albedo(layout, texel)
    border = round(7.5 / texel)
    inner = drawn[border:-border, border:-border]
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_250)
    board = cv2.aruco.CharucoBoard((12, rows), 15.0, 10.5, dictionary)
    board.setLegacyPattern(legacy)
    wanted = board.generateImage((inner.shape[1], inner.shape[0]))
    assert ((inner > 0.5) == (wanted > 127)).all()


def test_an_edge_between_texels_darkens_them_by_its_part() -> None:
    layout = TargetPrint(kind="chessboard", columns=3, rows=3, square_mm=10.0)
    fine, coarse = target_albedo(layout, 0.05), target_albedo(layout, 0.4)
    shares = [
        (0.85 - drawn).sum() * texel**2
        for drawn, texel in ((fine, 0.05), (coarse, 0.4))
    ]
    assert shares[0] == pytest.approx(0.8 * 8 * 100, rel=1e-5)
    assert shares[1] == pytest.approx(shares[0], rel=1e-5)


def test_what_cannot_be_drawn_is_refused() -> None:
    with pytest.raises(ConfigError, match="no marker dictionary"):
        target_albedo(BOARD.model_copy(update={"dictionary": "9X9_9"}), 0.5)
    with pytest.raises(ConfigError, match="needs 54"):
        target_albedo(BOARD.model_copy(update={"dictionary": "5X5_50"}), 0.5)
    with pytest.raises(ValueError, match="needs marker_mm"):
        TargetPrint(kind="charuco", columns=12, rows=9, square_mm=15.0)
    with pytest.raises(ValueError, match="below square_mm"):
        TargetPrint(kind="charuco", columns=4, rows=4, square_mm=5.0, marker_mm=5.0)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"legacy": True}, "only a ChArUco board"),
        ({"kind": "chessboard", "asymmetric": True}, "only a circle grid"),
        ({"asymmetric": True, "rows": 8}, "odd number of rows"),
        ({"asymmetric": True, "disc_mm": 14.0}, "below 1.4 square_mm"),
        ({"disc_mm": 10.5}, "below square_mm"),
    ],
)
def test_a_layout_that_cannot_be_is_refused(wrong: dict, words: str) -> None:
    grid = {"kind": "circle-grid", "columns": 5, "rows": 9, "square_mm": 10.0}
    with pytest.raises(ValueError, match=words):
        TargetPrint.model_validate(grid | wrong)
