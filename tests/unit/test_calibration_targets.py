"""Targets: drawn at true scale, found again, and refused with the reason."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import cv2
import numpy as np
import pytest

from calibration.camera import CameraOptions, calibrate_camera
from calibration.targets import (
    Charuco,
    Chessboard,
    CircleGrid,
    Detection,
    Picture,
    Rejection,
    caliper,
    detect,
    gather,
    nominal,
    target_pdf,
    write_target_pdf,
)
from calibration.targets.checks import check_picture, measure_picture
from calibration.targets.discs import disc_centres
from mvp.errors import CalibrationError, OutputError

DATA = Path(__file__).parents[2].parent / "shared" / "data" / "opencv_chessboard"
BOARD = Chessboard(9, 6, nominal(20.0))
CHARUCO = Charuco(8, 6, nominal(24.0), 17.0)
DISCS = CircleGrid(7, 6, nominal(22.0), 14.0)
SHIFTED = CircleGrid(4, 9, nominal(15.0), 12.0, asymmetric=True)
SIZE = (960, 720)
PAPER_PX_PER_MM = 8


def on_paper(target):
    """A print of the target, 8 px per mm, and the place of its frame's origin, px."""
    scale = PAPER_PX_PER_MM
    if isinstance(target, Chessboard):
        side = int(target.square.mm * scale)
        rows, columns = np.mgrid[0 : target.rows + 1, 0 : target.columns + 1]
        print_ = np.kron((rows + columns) % 2 * 255, np.ones((side, side)))
        origin = np.array([side, side])
    elif isinstance(target, Charuco):
        width, height = (int(length * scale) for length in target.size_mm)
        dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_250)
        board = cv2.aruco.CharucoBoard(
            (target.columns, target.rows),
            target.square.mm,
            target.marker_mm,
            dictionary,
        )
        print_ = board.generateImage((width, height), marginSize=0)
        origin = np.zeros(2)
    else:
        width, height = (int(length * scale) for length in target.size_mm)
        print_ = np.full((height, width), 255.0)
        margin = (target.pitch.mm + target.diameter_mm) / 2
        origin = np.full(2, margin * scale)
        y, x = np.mgrid[0:height, 0:width] + 0.5
        for point in target.points_mm[:, :2] * scale + origin:
            far = np.hypot(x - point[0], y - point[1])
            print_[far < target.diameter_mm / 2 * scale] = 0
    wide = cv2.copyMakeBorder(
        print_.astype(np.uint8), 300, 300, 300, 300, cv2.BORDER_CONSTANT, value=255
    )
    return wide, origin + 300


def picture_of(target, *, turn=0.2, zoom=0.33, shift=(0, 0), blur=0.9, level=(35, 205)):
    """A tilted view and the true pixels of all points."""
    paper, origin = on_paper(target)
    middle = np.array(paper.shape[::-1]) / 2
    tilt = np.array([[1, 0.05, 0], [-0.03, 1, 0], [turn * 4e-4, turn * 2e-4, 1]])
    centred = np.array([[1, 0, -middle[0]], [0, 1, -middle[1]], [0, 0, 1.0]])
    place = np.array(SIZE) / 2 + np.array(shift)
    there = np.diag([zoom, zoom, 1.0]) @ tilt @ centred
    there = np.array([[1, 0, place[0]], [0, 1, place[1]], [0, 0, 1.0]]) @ there
    fine = np.diag([4, 4, 1.0]) @ there
    big = cv2.warpPerspective(
        paper, fine, (SIZE[0] * 4, SIZE[1] * 4), borderValue=255, flags=cv2.INTER_LINEAR
    )
    small = cv2.resize(big, SIZE, interpolation=cv2.INTER_AREA).astype(float)
    small = cv2.GaussianBlur(small, (0, 0), blur)
    grey = np.clip(level[0] + (level[1] - level[0]) * small / 255, 0, 255)
    corners = target.points_mm[:, :2] * PAPER_PX_PER_MM + origin - 0.5
    mapped = np.column_stack([corners, np.ones(len(corners))]) @ there.T
    pixels = mapped[:, :2] / mapped[:, 2:]
    pixels = pixels - 0.375  # the average of fine columns 0 to 3 lies at 1.5 / 4
    return grey.astype(np.uint8), pixels


@pytest.mark.parametrize("target", [BOARD, CHARUCO, DISCS, SHIFTED])
def test_a_tilted_target_is_found_to_a_tenth_of_a_pixel(target):
    grey, truth = picture_of(target)
    found = detect(grey, target)
    assert isinstance(found, Detection)
    assert len(found.ids) > 0.8 * len(truth)
    if isinstance(target, Charuco):
        error = found.pixels - truth[found.ids]
    else:
        candidates = [truth, truth[::-1]]
        error = min((found.pixels - c for c in candidates), key=lambda e: (e**2).sum())
    error = error - error.mean(axis=0)
    assert np.sqrt((error**2).sum(axis=1).mean()) < 0.1


@pytest.mark.parametrize("target", [DISCS, SHIFTED])
@pytest.mark.parametrize("blur", [0.9, 2.0])
def test_light_and_blur_across_a_disc_do_not_move_it(target, blur):
    """OpenCV's blobs are moved by up to 0.09 px here, and by another 0.02 px each."""
    grey, truth = picture_of(target, blur=blur, level=(20, 235))
    x, y = np.meshgrid(*(np.linspace(0, 1, count) for count in SIZE))
    rng = np.random.default_rng(1)
    lit = grey * (1 - 0.3 * x - 0.3 * y - 0.15 * x**2) + rng.normal(0, 1, grey.shape)
    error = errors_of_discs(lit, target, truth)
    assert np.linalg.norm(error.mean(axis=0)) < 0.005
    assert np.sqrt((error**2).sum(axis=1).mean()) < 0.01


SMALL = CircleGrid(7, 6, nominal(22.0), 7.0)
SMALL_SHIFTED = CircleGrid(4, 9, nominal(15.0), 7.5, asymmetric=True)


def errors_of_discs(grey, target, truth):
    found = detect(np.clip(np.round(grey), 0, 255).astype(np.uint8), target)
    assert isinstance(found, Detection)
    return min((found.pixels - c for c in (truth, truth[::-1])), key=np.linalg.norm)


@pytest.mark.parametrize("target", [DISCS, SMALL, SHIFTED, SMALL_SHIFTED])
@pytest.mark.parametrize("white_mm", ["as printed", 2.0])
def test_a_dark_table_beside_the_print_is_not_taken_for_white(target, white_mm):
    grey, truth = picture_of(target, level=(20, 235))
    margin = target.pitch.mm / 2 if white_mm == "as printed" else white_mm
    reach = (target.diameter_mm / 2 + margin) * PAPER_PX_PER_MM * 0.33
    outside = np.ones(grey.shape, np.uint8)
    cv2.fillConvexPoly(outside, cv2.convexHull(np.round(truth).astype(np.int32)), 0)
    dark = cv2.distanceTransform(outside, cv2.DIST_L2, 5) > reach
    error = errors_of_discs(np.where(dark, 60, grey), target, truth)
    assert np.linalg.norm(error, axis=1).max() < 0.05


@pytest.mark.parametrize("target", [DISCS, SHIFTED])
def test_the_edge_of_a_shadow_moves_no_disc_far(target):
    """OpenCV's blobs are moved by it too."""
    grey, truth = picture_of(target, level=(20, 235))
    x = np.indices(grey.shape)[1]
    lit = grey * np.where(x > SIZE[0] / 2 + 11, 0.5, 1.0)
    error = errors_of_discs(lit, target, truth)
    assert np.linalg.norm(error, axis=1).max() < 1.0


def test_the_middle_of_an_ellipse_is_not_taken_for_the_middle_of_the_disc():
    plane = np.array([[4.0, 0.3, 100], [-0.2, 3.5, 120], [3e-3, 1e-3, 1]])

    def image_of(points):
        there = np.column_stack([points, np.ones(len(points))]) @ plane.T
        return there[:, :2] / there[:, 2:]

    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    rim = 7 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points = DISCS.points_mm
    middles = np.array(
        [
            cv2.fitEllipseDirect(image_of(rim + p[:2]).astype(np.float32))[0]
            for p in points
        ]
    )
    truth = image_of(points[:, :2])
    before = np.linalg.norm(middles - truth, axis=1).max()
    after = np.linalg.norm(disc_centres(DISCS, points, middles) - truth, axis=1).max()
    assert before > 0.2
    assert after < 0.2 * before


def test_part_of_a_charuco_board_is_enough():
    grey, truth = picture_of(CHARUCO, shift=(250, 60))
    found = detect(grey, CHARUCO)
    assert isinstance(found, Detection)
    assert 6 <= len(found.ids) < len(truth)
    error = found.pixels - truth[found.ids]
    assert np.abs(error - error.mean(axis=0)).max() < 0.3


def test_the_window_of_a_corner_never_reaches_the_next_corner():
    grey, _ = picture_of(BOARD, zoom=0.12)
    found = detect(grey, BOARD)
    assert isinstance(found, Detection)
    assert (found.half_window_px < 0.5 * found.spacing_px).all()
    assert found.half_window_px.max() <= 6


def test_a_corner_whose_neighbours_are_hidden_is_found_as_well_as_any():
    """A window sized from corners far away would take in the markers."""
    grey, truth = picture_of(CHARUCO)
    alone, column = 12, truth[:, 0].reshape(5, 7).mean(axis=0)
    square = np.linalg.norm(truth[alone] - truth[alone - 1])
    y, x = np.indices(grey.shape)
    near = np.maximum(*(abs(a - b) for a, b in zip((x, y), truth[alone], strict=True)))
    hidden = (x > column[2] + square / 2) & (near > 1.15 * square)
    found = detect(np.where(hidden, 128, grey).astype(np.uint8), CHARUCO)
    assert isinstance(found, Detection)
    others = np.abs(found.ids - alone)
    assert sorted(others)[0] == 0
    assert not np.isin(found.ids, [alone - 7, alone - 1, alone + 1, alone + 7]).any()
    assert (found.half_window_px < 0.3 * square).all()
    assert np.linalg.norm(found.pixels - truth[found.ids], axis=1).max() < 0.15


def test_points_on_a_line_are_no_target():
    grey, truth = picture_of(CHARUCO)
    y = np.indices(grey.shape)[0]
    row = truth[14:21, 1]
    square = np.linalg.norm(truth[1] - truth[0])
    hidden = (y < row.min() - 1.05 * square) | (y > row.max() + 1.05 * square)
    found = detect(np.where(hidden, 128, grey).astype(np.uint8), CHARUCO)
    assert isinstance(found, Rejection)
    assert found.code == "points-on-a-line"


def reason(grey, target=BOARD):
    with pytest.raises(CalibrationError) as refused:
        gather([Picture("one", grey)], target)
    return refused.value


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"blur": 6.0}, "edges are"),
        ({"level": (120, 520)}, "end of the scale"),
        ({"level": (100, 115)}, "grey levels"),
        ({"shift": (2000, 0)}, "not found"),
    ],
)
def test_a_bad_picture_is_refused_with_its_reason(change, words):
    assert words in reason(picture_of(BOARD, **change)[0]).message


def test_wrong_numbers_of_rows_and_columns_find_no_target():
    grey, _ = picture_of(BOARD)
    assert "not found" in reason(grey, Chessboard(8, 7, nominal(20.0))).message


def test_a_wrong_corner_is_no_plane():
    grey, _ = picture_of(BOARD)
    found = detect(grey, BOARD)
    found.pixels[20] += [0, 30]
    refused = check_picture(measure_picture(grey, found), found)
    assert isinstance(refused, Rejection)
    assert refused.code == "not-a-plane"


def test_duplicates_and_other_cameras_are_set_aside_and_the_rest_kept():
    first, second = picture_of(BOARD)[0], picture_of(BOARD, turn=0.5)[0]
    noisy = np.clip(
        first.astype(int) + np.random.default_rng(0).integers(-2, 3, first.shape),
        0,
        255,
    )
    pictures = [
        Picture("a", first),
        Picture("b", noisy.astype(np.uint8)),
        Picture("c", first[:, 100:]),
        Picture("d", second),
    ]
    found = gather(pictures, BOARD)
    assert found.accepted == (0, 3)
    assert found.observations.names == ("a", "d")
    assert [(name, why.code) for _, name, why in found.rejected] == [
        ("b", "duplicate"),
        ("c", "another-size"),
    ]
    assert "stands as in a" in found.rejected[0][2].reason


def test_a_colour_picture_is_a_mistake_of_the_caller():
    with pytest.raises(ValueError, match="grey"):
        detect(np.zeros((10, 10, 3), np.uint8), BOARD)


@pytest.mark.parametrize(
    ("side", "limit_px"),
    [("left", 0.1954), pytest.param("right", 0.2070, marks=pytest.mark.full)],
)
def test_windows_of_their_own_size_beat_any_fixed_one(side, limit_px):
    if not DATA.is_dir():
        pytest.skip("the OpenCV chessboard pictures are not here")
    pictures = (
        Picture(path.stem, cv2.imread(str(path), cv2.IMREAD_GRAYSCALE))
        for path in sorted(DATA.glob(f"{side}*.jpg"))
    )
    found = gather(pictures, Chessboard(9, 6, nominal(25.0)))
    assert not found.rejected
    result = calibrate_camera(found.observations, CameraOptions(folds=0))
    assert result.rms_px < limit_px
    assert result.view_rms_px.max() < 0.27
    assert result.verdict.grade == "go"


def test_caliper_readings_give_a_size_with_its_uncertainty():
    size = caliper([160.1, 160.2, 160.0], across=8)
    assert size.mm == pytest.approx(20.0125)
    assert size.sigma_mm == pytest.approx(np.hypot(0.02, 0.1 / np.sqrt(3)) / 8)
    assert nominal(20.0).relative == pytest.approx(0.002)
    with pytest.raises(ValueError, match="same number of squares"):
        caliper([160.1, 140.0], across=8)


@pytest.mark.parametrize(
    "make",
    [
        lambda: Chessboard(2, 9, nominal(10)),
        lambda: Charuco(5, 7, nominal(10), 12),
        lambda: CircleGrid(4, 4, nominal(10), 11),
        lambda: nominal(-1),
    ],
)
def test_impossible_targets_are_refused(make):
    with pytest.raises(ValueError, match=r"^a|^the"):
        make()


def rendered(tmp_path, target, paper="A4"):
    if not shutil.which("pdftoppm"):
        pytest.skip("poppler is not installed")
    path = tmp_path / "target.pdf"
    write_target_pdf(path, target, paper=paper)
    subprocess.run(
        ["pdftoppm", "-r", "127", "-gray", "-singlefile", str(path), str(path)],
        check=True,
        capture_output=True,
    )
    text = subprocess.run(
        ["pdftotext", str(path), "-"], check=True, capture_output=True, text=True
    ).stdout
    return cv2.imread(f"{path}.pgm", cv2.IMREAD_GRAYSCALE), text


@pytest.mark.parametrize("target", [BOARD, CHARUCO, DISCS, SHIFTED])
def test_the_sheet_shows_the_target_at_true_scale(tmp_path, target):
    grey, text = rendered(tmp_path, target)
    found = detect(grey, target)
    assert isinstance(found, Detection)
    assert len(found.ids) == len(target.points_mm)
    spread_px = np.ptp(found.pixels, axis=0)
    wanted = np.ptp(target.points_mm, axis=0)[:2] * 127 / 25.4
    np.testing.assert_allclose(spread_px, wanted, atol=0.3)
    assert "actual size" in text
    assert f"{target.spacing.mm:g} mm" in text


def test_the_ruler_is_as_long_as_it_says(tmp_path):
    grey, text = rendered(tmp_path, BOARD)
    row = 1000  # 10 mm above the lower edge of A4 in landscape, 5 px per mm
    dark = np.flatnonzero(grey[row - 1 : row + 2].min(axis=0) < 200)
    assert "Ruler 250 mm" in text or "Ruler 200 mm" in text or "Ruler 150 mm" in text
    length = float(text.split("Ruler ")[1].split(" mm")[0])
    assert np.ptp(dark) / 5 == pytest.approx(length, abs=0.5)


def test_a_target_larger_than_the_paper_is_refused():
    with pytest.raises(CalibrationError, match="does not fit on A4") as refused:
        target_pdf(Chessboard(11, 8, nominal(28.0)))
    assert "larger paper" in refused.value.hint
    assert target_pdf(Chessboard(11, 8, nominal(28.0)), paper="A3").startswith(b"%PDF")
    with pytest.raises(CalibrationError, match="unknown paper"):
        target_pdf(BOARD, paper="B7")


def test_a_folder_that_is_not_there_is_named(tmp_path):
    with pytest.raises(OutputError, match=r"nowhere"):
        write_target_pdf(tmp_path / "nowhere" / "t.pdf", BOARD)
