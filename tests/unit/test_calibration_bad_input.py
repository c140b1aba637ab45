"""Mistakes that people make: each is named, none is believed.

The other half of the mistakes with robot poses is in the tests of the hand-eye estimator.
A case gives what the code says about bad data: a verdict, a rejected picture, or an
error. None may be GO, and the words must name the mistake or what to look at.
"""

from __future__ import annotations

import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calibration.camera import calibrate_camera
from calibration.exchange import parse_camera
from calibration.hand_eye import (
    Rehearsal,
    RobotNoise,
    calibrate_hand_eye,
    layouts_that_fit,
    rehearse,
)
from calibration.lens_table import (
    Conditions,
    LensNode,
    Measured,
    TravelPrior,
    TravelShots,
    measure_travel,
    separate,
)
from calibration.observations import Observations
from calibration.part_pose import (
    HandEye,
    PartSight,
    PartView,
    SeenPoints,
    judge_located,
    judge_resection,
    locate,
    resect,
)
from calibration.poses import Poses
from calibration.projection import PinholeCamera, project
from calibration.target_shape import ShapePrior
from calibration.targets import (
    Charuco,
    Chessboard,
    MeasuredLength,
    Picture,
    Rejection,
    caliper,
    gather,
    nominal,
)
from calibration.targets.detect import charuco_board, detect
from calibration.targets.gather import examined
from calibration.tsai import TsaiCamera, tsai_calibrate
from calibration.verdict import Verdict
from calibration.wizard.camera_views import camera_options
from mvp.calibrated import Validity
from mvp.errors import MvpCellError
from mvp.geometry import Pose
from mvp.testing.paraxial_lens import ParaxialLens

CAMERA = PinholeCamera(1500.0, 1500.0, 645.0, 475.0, k1=-0.1)
SIZE = (1280, 960)
SPEC = RobotNoise(0.2, float(np.radians(0.05)))
SMALL = Rehearsal(views=12, robot=SPEC, columns=5, rows=4, pitch_mm=25.0)
CUBE = 25.4 * (
    np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)]) - 0.5
)
CHESS = Chessboard(8, 5, nominal(20.0))
CHARUCO = Charuco(7, 5, nominal(24.0), 17.0)


def grid(columns=9, rows=6, pitch_mm=25.0):
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    flat = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1) * pitch_mm
    return flat - flat.mean(axis=0)


def views(
    rng,
    count=6,
    tilt_deg=32.0,
    *,
    camera=CAMERA,
    points=None,
    printed=None,
    place=(0.0, 0.0, 420.0),
):
    """Pictures of a board; ``printed`` is what it really looks like."""
    points = grid() if points is None else points
    printed = points if printed is None else printed
    pixels = []
    for angle in 2 * np.pi * np.arange(count) / count:
        tilt = np.radians(tilt_deg) * np.array([np.cos(angle), np.sin(angle), 0])
        roll = Rotation.from_rotvec([0, 0, 0.7 * np.cos(3 * angle)])
        turn = (Rotation.from_rotvec(tilt) * roll).as_matrix()
        seen = project(camera, turn, np.asarray(place), printed)
        pixels.append(seen + rng.normal(0, 0.1, seen.shape))
    return Observations.from_views([points] * count, pixels, size_px=SIZE)


def camera_of(seen, folds=0):
    """As the camera wizard judges; its cross-validation can only add causes."""
    how = camera_options(1.0, ShapePrior.of_a_print(seen.points_target_mm))
    return calibrate_camera(seen, replace(how, folds=folds)).verdict


# Pictures ---------------------------------------------------------------------------


def drawn(target, *, blur=0.8, level=(40, 210), turn=0.3, shift=(0, 0), flip=False):
    """A tilted picture of a chessboard or ChArUco board."""
    per_mm = 3
    width, height = (round(length * per_mm) for length in target.size_mm)
    if isinstance(target, Charuco):
        paper = charuco_board(target).generateImage((width, height), marginSize=0)
    else:
        rows, columns = np.mgrid[0 : target.rows + 1, 0 : target.columns + 1]
        side = round(target.square.mm * per_mm)
        paper = np.kron((rows + columns) % 2 * 255, np.ones((side, side)))
    paper = cv2.copyMakeBorder(
        paper.astype(np.uint8), 60, 60, 60, 60, cv2.BORDER_CONSTANT, value=255
    )
    paper = paper[:, ::-1] if flip else paper
    middle = np.array(paper.shape[::-1]) / 2
    tilt = np.array([[1, 0.05, 0], [-0.03, 1, 0], [turn * 4e-4, turn * 2e-4, 1]])
    back = np.array([[1, 0, -middle[0]], [0, 1, -middle[1]], [0, 0, 1.0]])
    place = np.array([[1, 0, 320 + shift[0]], [0, 1, 240 + shift[1]], [0, 0, 1.0]])
    there = place @ tilt @ back
    small = cv2.warpPerspective(
        paper, there, (640, 480), borderValue=255, flags=cv2.INTER_AREA
    )
    soft = cv2.GaussianBlur(small.astype(float), (0, 0), blur)
    return np.clip(level[0] + (level[1] - level[0]) * soft / 255, 0, 255).astype(
        np.uint8
    )


def picture_twice():
    one = drawn(CHESS)
    other = drawn(CHESS, turn=0.6)
    found = gather([Picture("a", one), Picture("b", one), Picture("c", other)], CHESS)
    return found.rejected[0][2]


def picture_of_another_size():
    whole = drawn(CHESS)
    found = gather([Picture("a", whole), Picture("b", whole[:-8])], CHESS)
    return found.rejected[0][2]


# Cameras ----------------------------------------------------------------------------


def by_columns(rng):
    """Points counted down the columns, the layout along the rows."""
    seen = views(rng, 3)
    order = np.arange(54).reshape(6, 9).T.ravel()
    pixels = [seen.of_view(v)[1][order] for v in range(seen.views)]
    return camera_of(
        Observations.from_views([grid()] * seen.views, pixels, size_px=SIZE)
    )


def one_foreign_view(rng, other):
    seen, strange = views(rng), views(rng, camera=other)
    pixels = np.where((seen.view == 4)[:, None], strange.pixels, seen.pixels)
    return camera_of(replace(seen, pixels=pixels))


def one_view_of_half_size(rng):
    seen = views(rng)
    pixels = np.where((seen.view == 2)[:, None], seen.pixels / 2, seen.pixels)
    return camera_of(replace(seen, pixels=pixels))


def one_view_of_another_layout(rng):
    """Its points belong to a board with other squares in one direction."""
    seen = views(rng)
    other = views(rng, printed=grid() * [1.0, 1.1, 1.0])
    pixels = np.where((seen.view == 1)[:, None], other.pixels, seen.pixels)
    return camera_of(replace(seen, pixels=pixels))


def bent_board(rng):
    points = grid()
    bow = 2.0 * (1 - (points[:, 0] / points[:, 0].max()) ** 2)
    printed = points + np.outer(bow, [0, 0, 1.0])
    return camera_of(views(rng, printed=printed))


def swapped_pixels(rng):
    seen = views(rng)
    return camera_of(replace(seen, pixels=seen.pixels[:, ::-1]))


def points_on_a_line(rng):
    seen = views(rng)
    rows = [np.flatnonzero(seen.view == v)[:9] for v in range(6)]
    return camera_of(
        Observations.from_views(
            [seen.points_target_mm[r] for r in rows],
            [seen.pixels[r] for r in rows],
            size_px=SIZE,
        )
    )


def not_a_number(rng):
    pixels = np.array(views(rng).pixels)
    pixels[7] = np.nan
    return camera_of(replace(views(rng), pixels=pixels))


def tsai_parallel(rng):
    camera = TsaiCamera(0.0055, 0.0055, 8.25, 645.0, 475.0)
    return tsai_calibrate(camera, views(rng, 1, 2.0)).verdict


# Hand-eye ---------------------------------------------------------------------------


@pytest.fixture(scope="module")
def seen():
    return rehearse(SMALL, np.random.default_rng(11))


def judged(data, camera=SMALL.camera, robot=SPEC):
    result = calibrate_hand_eye(data, camera, robot)
    return result.verdict


def told(seen, rotation=None, translation_mm=None):
    robot = seen.data.base_from_tool
    poses = Poses(
        robot.rotation if rotation is None else rotation,
        robot.translation_mm if translation_mm is None else translation_mm,
    )
    return replace(seen.data, base_from_tool=poses)


def angles_read_wrongly(seen, factor):
    turn = Rotation.from_matrix(seen.data.base_from_tool.rotation).as_rotvec()
    wrong = Rotation.from_rotvec(turn * factor).as_matrix()
    return judged(told(seen, wrong))


def a_pose_that_stuck(seen):
    """The reported pose did not follow for three views."""
    robot = seen.data.base_from_tool
    index = np.array([0, 1, 2, 3, 3, 3, 3, 7, 8, 9, 10, 11])
    return judged(replace(seen.data, base_from_tool=robot[index]))


def board_bumped(seen):
    points = np.array(seen.data.seen.points_target_mm)
    points[seen.data.seen.view >= 6] += [8.0, 3.0, 0.0]
    return judged(
        replace(seen.data, seen=replace(seen.data.seen, points_target_mm=points))
    )


def board_half_turned(seen):
    """A symmetric board read from its other end in some views."""
    points = np.array(seen.data.seen.points_target_mm)
    rows = seen.data.seen.view % 3 == 1
    middle = points.max(axis=0) / 2
    points[rows] = 2 * middle - points[rows]
    return judged(
        replace(seen.data, seen=replace(seen.data.seen, points_target_mm=points))
    )


def scaled_board(seen, factor):
    found = seen.data.seen
    points = found.points_target_mm * factor
    return judged(replace(seen.data, seen=replace(found, points_target_mm=points)))


def four_poses_thrice(seen):
    return judged(seen.data.of_views([0, 3, 6, 9] * 3))


def not_a_rotation(seen):
    mirror = np.diag([1.0, 1.0, -1.0])
    return judged(told(seen, seen.data.base_from_tool.rotation @ mirror))


def pose_not_a_number(seen):
    place = np.array(seen.data.base_from_tool.translation_mm)
    place[5, 1] = np.nan
    return judged(told(seen, None, place))


def bare_angles(seen):
    """Degrees told as radians: the other layout fits better."""
    turn = Rotation.from_matrix(seen.data.base_from_tool.rotation)
    numbers = np.hstack(
        [seen.data.base_from_tool.translation_mm, np.degrees(turn.as_rotvec())]
    )
    best = layouts_that_fit(numbers, seen.camera_from_target, "eye-in-hand")[0]
    assert best.name == "rotation vector, deg"
    return Rejection("layout", best.name, "read it so")


# Lens -------------------------------------------------------------------------------


def focused(rng, *, pitch=1.0, sharp=1.0, order=(0, 1, 2, 3)):
    """Nodes at four focus settings, in units that may be wrong."""
    found = []
    for place, step in enumerate(order):
        d = 12.5 + (0.16, 0.32, 0.65, 1.1)[place]
        lens = ParaxialLens.thin(f_mm=12.5, d_mm=d, e_mm=8.0, a_mm=1.0)
        f_cal = float(lens.scale(99.0)) * 99.0 * pitch
        far = lens.sharp_from_pupil_mm()
        sigma = np.array([0.002 * pitch, 0.35, 0.35, 1e-5])
        values = np.array([f_cal, 800, 600, 1e-3]) + rng.normal(0, sigma)
        told = Measured(far * sharp * (1 + rng.normal(0, 0.005)), 0.005 * far * sharp)
        found.append(LensNode(0, 1000 * step, values, np.diag(sigma**2), told))
    return found


def travelled(factor=1.0, growth=75.0):
    rng = np.random.default_rng(0)
    points = grid(9, 7, 10.0)
    travel = np.linspace(0, growth, 7)
    pixels = [
        project(CAMERA, np.eye(3), np.array([2.0, 1.0, 300.0 - s]), points)
        + rng.normal(0, 0.1, (len(points), 2))
        for s in travel
    ]
    shots = TravelShots(travel * factor, points, np.array(pixels), 0.1, 0.02 * factor)
    return measure_travel(shots, TravelPrior((640.0, 480.0), 5.0))


# Parts ------------------------------------------------------------------------------


def cube_seen(rng, turn=(200, 30, 20), corners=CUBE, place=(4.0, 3.0, 300.0)):
    pose = Pose(
        "camera",
        "part",
        Rotation.from_euler("xyz", turn, degrees=True).as_matrix(),
        np.array(place),
    )
    pixels = project(CAMERA, pose.rotation, pose.translation_mm, corners)
    return pose, pixels + rng.normal(0, 0.1, pixels.shape)


def part_from(rng, points, pixels, **options):
    sight = PartSight(SeenPoints(points, pixels, 0.1))
    return judge_resection(sight, resect(CAMERA, sight, **options))


def part_in_inches(rng, drawing, moved_mm=0.0):
    """Two views through the robot: the drawing is too small, or the part moved."""
    x = Pose.from_rotvec("tool", "camera", [0.02, -0.03, 1.5], [10.0, 60.0, 90.0])
    part = Pose.from_rotvec("base", "part", [0.1, 0.2, 0.4], [400.0, 50.0, 60.0])
    eye = HandEye(
        x, np.diag([0.2] * 3 + [5e-4] * 3) ** 2, np.diag([0.1] * 3 + [3e-4] * 3) ** 2
    )
    found = []
    for number, turn in enumerate([(200, 30, 20), (170, -20, 90)]):
        shown, pixels = cube_seen(rng, turn, place=(4.0, 3.0, 300.0 + 60 * number))
        sight = PartSight(SeenPoints(CUBE * drawing, pixels, 0.1))
        best = resect(CAMERA, sight).best
        tool = part @ shown.inverse() @ x.inverse()
        shift = np.array([moved_mm * number, 0.0, 0.0])
        tool = Pose("base", "tool", tool.rotation, tool.translation_mm + shift)
        found.append(PartView(best.camera_from_part, best.estimate.covariance, tool))
    return judge_located(locate(found, eye))


# The table --------------------------------------------------------------------------

PICTURES = {
    "blurred": (
        lambda: examined(drawn(CHESS, blur=7.0), CHESS),
        "blurred|target-not-found",
    ),
    "overexposed": (
        lambda: examined(drawn(CHESS, level=(120, 560)), CHESS),
        "overexposed",
    ),
    "too dark": (lambda: examined(drawn(CHESS, level=(10, 28)), CHESS), "contrast"),
    "taken twice": (picture_twice, "duplicate.*stands as in a"),
    "another camera's size": (picture_of_another_size, "another-size"),
    "mirrored print": (
        lambda: detect(drawn(CHARUCO, flip=True), CHARUCO),
        "markers are mirrored",
    ),
    "wrong dictionary": (
        lambda: detect(drawn(CHARUCO), replace(CHARUCO, dictionary="4X4_50")),
        "family 5X5, not of 4X4_50",
    ),
    "wrong number of squares, ChArUco": (
        lambda: examined(drawn(CHARUCO), replace(CHARUCO, columns=6)),
        "6 x 5 squares",
    ),
    "rows and columns exchanged, ChArUco": (
        lambda: examined(drawn(CHARUCO), replace(CHARUCO, columns=5, rows=7)),
        "5 x 7 squares",
    ),
    "old layout of the board": (
        lambda: examined(
            drawn(replace(CHARUCO, rows=6, legacy=True)), replace(CHARUCO, rows=6)
        ),
        "legacy",
    ),
    "wrong number of corners, chessboard": (
        lambda: detect(drawn(CHESS), replace(CHESS, rows=6)),
        "not-found",
    ),
    "out of the picture": (
        lambda: detect(drawn(CHESS, shift=(260, 0)), CHESS),
        "not-found",
    ),
    "colour picture": (lambda: detect(np.zeros((9, 9, 3), np.uint8), CHESS), "grey"),
    "no picture shows it": (
        lambda: gather([Picture("wall", np.full((480, 640), 99, np.uint8))], CHESS),
        "wall: the target was not found",
    ),
    "unknown dictionary": (
        lambda: detect(drawn(CHARUCO), replace(CHARUCO, dictionary="9X9_1")),
        "no marker dictionary '9X9_1'",
    ),
    "caliper over another number of squares": (
        lambda: caliper([200.1, 199.9, 175.2], across=10),
        "same number of squares",
    ),
    "length not a number": (lambda: MeasuredLength(float("nan"), 0.1), "positive"),
    "length without end": (lambda: MeasuredLength(float("inf"), 0.1), "finite"),
    "markers larger than squares": (
        lambda: replace(CHARUCO, marker_mm=30.0),
        "smaller",
    ),
}

CAMERAS = {
    "mirrored board": (
        lambda rng: camera_of(views(rng, printed=grid() * [-1, 1, 1])),
        "target-mirrored",
    ),
    "rows and columns exchanged": (
        lambda rng: camera_of(views(rng, points=grid()[:, [1, 0, 2]], printed=grid())),
        "mirrored, or its rows and columns are swapped",
    ),
    "counted down the columns": (by_columns, "rows and columns|order"),
    "pixels as row, column": (swapped_pixels, "target-mirrored"),
    "one picture of another camera": (
        lambda rng: one_foreign_view(
            rng, replace(CAMERA, fx_px=1900.0, fy_px=1900.0, cx_px=600.0, k1=0.1)
        ),
        "view 5",
    ),
    "one picture of half the size": (one_view_of_half_size, "view 3"),
    "one picture of another board": (one_view_of_another_layout, "view 2"),
    "a bent board": (bent_board, "the target is not flat.*bow 1.9"),
    "a print stretched by 2 %": (
        lambda rng: camera_of(views(rng, printed=grid() * [1.02, 1.0, 1.0])),
        "the target is stretched.* % longer along x",
    ),
    "all views parallel": (
        lambda rng: camera_of(views(rng, tilt_deg=1.0)),
        "target nearly parallel",
    ),
    "board at one border only": (
        lambda rng: camera_of(
            views(rng, points=grid(4, 9, 12.0), place=(-150.0, 0.0, 420.0))
        ),
        "target-too-small",
    ),
    "board far away": (
        lambda rng: camera_of(views(rng, place=(0.0, 0.0, 2000.0))),
        "target-too-small",
    ),
    "two views": (lambda rng: camera_of(views(rng, 2), folds=2), "few-views"),
    "one view squarely, Tsai": (tsai_parallel, "target nearly parallel"),
    "points on a line": (points_on_a_line, "view 1"),
    "a point that is not a number": (not_a_number, "finite"),
    "as many names as views, but other ones": (
        lambda rng: replace(views(rng), names=("a", "b")),
        "every view",
    ),
}

HAND_EYES = {
    "target in metres": (lambda s: scaled_board(s, 1e-3), "in metres"),
    "squares 3 % too large": (lambda s: scaled_board(s, 1.03), "scale.*squares"),
    "radians read as degrees": (
        lambda s: angles_read_wrongly(s, np.pi / 180),
        "radians.*degrees",
    ),
    "degrees read as radians": (
        lambda s: angles_read_wrongly(s, 180 / np.pi),
        "degrees.*radians",
    ),
    "degrees in a file of radians": (bare_angles, "rotation vector, deg"),
    "four poses, each three times": (four_poses_thrice, "few-views"),
    "a pose that stuck": (a_pose_that_stuck, "view [4567]"),
    "the board was moved": (board_bumped, "fixed firmly"),
    "a symmetric board": (board_half_turned, "half a turn"),
    "the zoom was moved": (
        lambda s: judged(s.data, replace(SMALL.camera, fx_px=2700.0, fy_px=2700.0)),
        "scale|intrinsics",
    ),
    "mirrored axes of the robot": (not_a_rotation, "rotation"),
    "a pose that is not a number": (pose_not_a_number, "finite"),
    "noise of zero": (lambda s: RobotNoise(0.0, 0.001), "positive"),
}

LENSES = {
    "sharp distances in metres": (
        lambda rng: separate(focused(rng, sharp=1e-3)),
        "sharp|unit|metres",
    ),
    "pixel pitch in um": (lambda rng: separate(focused(rng, pitch=1e3)), "pitch|unit"),
    "travel in metres": (lambda rng: travelled(1e-3), "unit|metres"),
    "no travel": (lambda rng: travelled(growth=0.5), "size"),
    "temperatures upside down": (
        lambda rng: Validity(temperature_min_c=30.0, temperature_max_c=20.0),
        "above temperature_max_c",
    ),
    "negative range of temperature": (
        lambda rng: Conditions(21.0, "operator", -5.0),
        "range",
    ),
    "temperature not a number": (
        lambda rng: Conditions(float("nan"), "device"),
        "finite",
    ),
    "temperature from nowhere": (lambda rng: Conditions(21.0), "source"),
    "one focus setting": (lambda rng: separate(focused(rng, order=(1,))), "one focus"),
    "a sigma of zero": (lambda rng: Measured(250.0, 0.0), "sigma > 0"),
}

PARTS = {
    "features exchanged": (
        lambda rng: part_from(rng, CUBE[[1, 0, 2, 3, 4, 5, 7, 6]], cube_seen(rng)[1]),
        "which feature is which",
    ),
    "mirrored drawing": (
        lambda rng: part_from(rng, CUBE * [-1, 1, 1], cube_seen(rng)[1]),
        "which feature is which|explains",
    ),
    "drawing in inches": (lambda rng: part_in_inches(rng, 1 / 25.4), "apart"),
    "the part moved between views": (
        lambda rng: part_in_inches(rng, 1.0, 5.0),
        "did not move",
    ),
    "two features": (
        lambda rng: part_from(rng, CUBE[:2], cube_seen(rng)[1][:2]),
        "three features",
    ),
    "a flat part far away": (
        lambda rng: part_from(
            rng,
            grid(4, 3, 8.0),
            cube_seen(rng, (188, 5, 20), grid(4, 3, 8.0), (0, 0, 1500.0))[1],
        ),
        "mirror-ambiguity.*second pose",
    ),
    "noise of zero": (lambda rng: SeenPoints(CUBE, CUBE[:, :2], 0.0), "positive"),
}

FILES = {
    "half a camera file": (
        lambda: parse_camera("camera_matrix:\n  rows: 3\n  cols: 3\n  data: [1, 2"),
        "line|matrix",
    ),
    "a fisheye camera": (
        lambda: parse_camera("K: [1,0,1,0,1,1,0,0,1]\ndistortion_model: fisheye\n"),
        "fisheye",
    ),
}


LONG = {
    "one picture of half the size",
    "one picture of another board",
    "a print stretched by 2 %",
}


def said(found):
    """Grade and words of whatever came back."""
    if isinstance(found, Rejection):
        return "refused", f"{found.code} {found.reason} {found.action}"
    if isinstance(found, Verdict):
        words = [f"{c.code} {c.message} {c.action}" for c in found.ordered]
        return found.grade, " ".join(words)
    return "believed", repr(found)


def check(make, words):
    try:
        grade, text = said(make())
    except (MvpCellError, ValueError) as error:
        grade, text = "refused", f"{error} {getattr(error, 'hint', '')}"
    assert grade in ("refused", "no-go", "marginal"), text
    assert re.search(words, text), f"{grade}: {text}"
    return grade


@pytest.mark.parametrize("case", PICTURES)
def test_a_bad_picture_or_target_is_named(case):
    assert check(*PICTURES[case]) == "refused"


@pytest.mark.parametrize(
    "case",
    [pytest.param(c, marks=pytest.mark.full if c in LONG else ()) for c in CAMERAS],
)
def test_bad_views_of_a_camera_are_named_and_not_believed(case):
    make, words = CAMERAS[case]
    assert check(lambda: make(np.random.default_rng(7)), words) != "marginal"


@pytest.mark.parametrize("case", HAND_EYES)
def test_bad_poses_of_a_robot_are_named_and_not_believed(seen, case):
    make, words = HAND_EYES[case]
    assert check(lambda: make(seen), words) != "marginal"


@pytest.mark.parametrize("case", LENSES)
def test_bad_measurements_of_a_lens_are_named_and_not_believed(case):
    make, words = LENSES[case]
    assert check(lambda: make(np.random.default_rng(7)), words) == "refused"


@pytest.mark.parametrize("case", PARTS)
def test_bad_sights_of_a_part_are_named_and_not_believed(case):
    make, words = PARTS[case]
    assert check(lambda: make(np.random.default_rng(7)), words) != "marginal"


@pytest.mark.parametrize("case", FILES)
def test_bad_files_are_named(case):
    assert check(*FILES[case]) == "refused"
