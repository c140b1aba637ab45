"""``mvp-cell import-camera``: what it refuses, by file and key."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from mvp.cell.calibrate_job import LOCK_NAME
from mvp.cell.import_camera_job import ImportRequest, import_camera
from mvp.cell.init_job import copy_cell
from mvp.cell.lock import cell_lock
from mvp.cell.places import bundled_root
from mvp.errors import CalibrationError
from tests.camera_file_cells import (
    FORMATS,
    Capture,
    exported,
    told,
)

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


@pytest.fixture(scope="module")
def untouched(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cell that nothing may change, beside a good file of every format."""
    folder = tmp_path_factory.mktemp("untouched") / "cell"
    copy_cell("virtual", folder)
    for form in FORMATS:
        exported(folder, form)
    return folder


def is_untouched(cell: Path) -> bool:
    original = bundled_root() / "virtual" / "calibration"
    found = {path.name: path.read_bytes() for path in (cell / "calibration").iterdir()}
    return found == {path.name: path.read_bytes() for path in original.iterdir()}


def swapped(old: str, new: str) -> Callable[[str], str]:
    def spoil(text: str) -> str:
        assert old in text, f"{old!r} is not in {text}"
        return text.replace(old, new)

    return spoil


def scaled(key: str, factor: float) -> Callable[[str], str]:
    """The numbers of a list, but for zeros and ones."""

    def spoil(text: str) -> str:
        head, _, rest = text.partition(key)
        numbers, _, tail = rest.partition("[")[2].partition("]")
        values = [float(number) for number in numbers.split(",")]
        new = [v * factor if v not in (0, 1) else v for v in values]
        return f"{head}{key}{rest.partition('[')[0]}{new}{tail}"

    return spoil


BAD = [
    ("opencv", lambda text: text[: text.index("distortion") - 30], "bracket"),
    ("opencv", lambda text: text[: text.index("distortion")], "distortion_coeff"),
    ("ros", lambda text: text[: text.index("distortion_coeff")], "distortion_coeff"),
    (
        "kalibr",
        lambda text: text[: text.index("  resolution")],
        "resolution is missing",
    ),
    ("ros", swapped("plumb_bob", "equidistant"), "distortion_model is equidistant"),
    ("kalibr", swapped("radtan", "equidistant"), "equidistant distortion"),
    ("kalibr", swapped("pinhole", "omni"), "cam0 is omni"),
    ("opencv", lambda text: text + "fisheye_model: 1\n", "fisheye_model is 1"),
    ("ros", lambda text: text + "binning_x: 2\n", "binning_x is 2"),
    ("ros", lambda text: text + "roi:\n  x_offset: 8\n", "roi.x_offset is 8"),
    ("ros", lambda text: text + "camera_model: MEI\n", "camera_model is MEI"),
    ("kalibr", lambda text: text + text.replace("cam0", "cam1"), "cam0, cam1"),
    ("opencv", swapped("image_width: 1280", "image_width: 640"), "640 x 1024 px"),
    ("ros", swapped("1280", "1280.5"), "image_width: the size"),
    ("kalibr", swapped("[1280, 1024]", "[1024, 1280]"), "1024 x 1280 px"),
    ("opencv", scaled("camera_matrix", 0.005), "fx = 13.1"),
    ("ros", scaled("camera_matrix", 0.000005), "principal distance"),
    ("kalibr", scaled("intrinsics", 10.0), "intrinsics: fx = 26"),
    ("kalibr", swapped("cs: [", "cs: [5"), "intrinsics: fx / fy is 20"),
    ("kalibr", scaled("distortion_coeffs", 100.0), "coeffs: this distortion folds"),
    ("kalibr", swapped("coeffs: [-0.1", "coeffs: [1e300"), "this distortion folds"),
    ("kalibr", swapped("643.2", "6432"), "the principal point (6432, 508.7)"),
    ("kalibr", swapped("radtan", "none"), "4 numbers, but distortion_model is none"),
    ("kalibr", swapped("508.7", ".nan"), "intrinsics must be 4 numbers"),
    ("opencv", swapped("508.7", ".Nan"), "camera_matrix must be 9 numbers"),
    (
        "kalibr",
        swapped("coeffs: [-0.1, ", "coeffs: ["),
        "coeffs must be 0 or 4 numbers",
    ),
    (
        "opencv",
        swapped("-0.1, ", ""),
        "distortion_coefficients has 4 numbers, not 5 x 1",
    ),
    ("opencv", swapped("rows: 3", "rows: 2"), "camera_matrix has 9 numbers, not 2 x 3"),
    ("opencv", swapped("643.2, 0.0", "643.2, 9.0"), "row by row"),
    ("ros", swapped("0.0, 643.2", "0.5, 643.2"), "skewed"),
    ("ros", lambda text: text.replace("508.7", "508.7]"), "line "),
    ("ros", lambda _: "\x89PNG\r\n", "line 1"),
    ("ros", lambda _: "answer: 42\n", "neither camera_matrix nor K"),
    ("ros", lambda _: "!!python/object/apply:os.system ['true']\n", "line 1"),
    ("ros", lambda text: text + "# " + "x" * (1 << 20), "larger than any camera"),
]


def refusal(
    cell: Path, folder: Path, form: str, spoil: Callable[[str], str]
) -> CalibrationError:
    """Of a good file that was spoilt."""
    path = folder / "bad.yaml"
    path.write_text(spoil((cell.parent / f"{form}.yaml").read_text()))
    with pytest.raises(CalibrationError) as caught:
        import_camera(str(cell), path, ImportRequest())
    return caught.value


@pytest.mark.parametrize(("form", "spoil", "words"), BAD)
def test_a_bad_file_is_refused_by_file_and_key_and_nothing_is_written(
    form: str,
    spoil: Callable[[str], str],
    words: str,
    untouched: Path,
    tmp_path: Path,
) -> None:
    error = refusal(untouched, tmp_path, form, spoil)
    path = tmp_path / "bad.yaml"
    assert error.message.startswith(f"{path}: ")
    assert words in error.message
    assert "\n" not in error.message
    assert (error.where, error.exit_code) == (str(path), 2)
    assert error.hint
    assert is_untouched(untouched)


@pytest.mark.parametrize(
    ("factor", "hint"),
    [(0.005, "looks like mm"), (0.000005, "looks like m:"), (0.25, "whole pictures")],
)
def test_the_unit_of_the_focal_length_is_guessed(
    factor: float, hint: str, untouched: Path, tmp_path: Path
) -> None:
    spoil = scaled("intrinsics", factor)
    assert hint in refusal(untouched, tmp_path, "kalibr", spoil).hint


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (("--date", "31.1.2026"), "--date 31.1.2026 makes no sense"),
        (("--date", "2999-01-01"), "--date 2999-01-01 makes no sense"),
        (("--temperature-c", "nan"), "--temperature-c nan makes no sense"),
        (("--temperature-c", "300"), "--temperature-c 300 makes no sense"),
        (("--sigma", "cx_px"), "--sigma cx_px makes no sense"),
        (("--sigma", "cx_px=inf"), "--sigma cx_px=inf makes no sense"),
        (("--sigma", "cx_px=-1"), "cannot be a standard deviation"),
        (("--sigma", "cx_px=50"), "cannot be a standard deviation"),
        (("--sigma", "focal=1"), "there is no such value"),
        (("--sigma", "cx_px=2", "--sigma", " cx_px=3"), "--sigma cx_px is said twice"),
    ],
)
def test_what_a_person_says_must_make_sense(
    more: tuple[str, ...], words: str, untouched: Path, capsys: Capture
) -> None:
    path = untouched.parent / "ros.yaml"
    error = told(capsys, "import-camera", untouched, path, *more, code=2)
    assert words in error["message"]
    assert error["where"] == more[0]
    assert error["hint"]
    assert is_untouched(untouched)


def test_a_file_that_cannot_be_read_is_named(
    untouched: Path, tmp_path: Path, capsys: Capture
) -> None:
    (tmp_path / "binary.yaml").write_bytes(b"\xff\xfe\x00")
    for path in (untouched / "none.yaml", untouched, tmp_path / "binary.yaml"):
        error = told(capsys, "import-camera", untouched, path, code=2)
        assert error["message"].startswith(f"{path}: ")


def test_a_bundled_cell_is_not_changed(untouched: Path, capsys: Capture) -> None:
    path = untouched.parent / "ros.yaml"
    error = told(capsys, "import-camera", "virtual", path, code=2)
    assert "cannot be calibrated in place" in error["message"]
    assert "mvp-cell init" in error["hint"]


def test_nothing_is_put_in_place_during_a_calibration(
    untouched: Path, capsys: Capture
) -> None:
    lock = untouched / "calibration" / LOCK_NAME
    with cell_lock(lock, run_id="calibrate camera"):
        path = untouched.parent / "ros.yaml"
        error = told(capsys, "import-camera", untouched, path, code=2)
    assert "calibrate camera" in error["message"]
    assert is_untouched(untouched)
