"""Camera files of other programs, there and back."""

from __future__ import annotations

import contextlib
from pathlib import Path

import cv2
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibration.exchange import (
    CameraFile,
    kalibr_camchain,
    opencv_yaml,
    parse_camera,
    read_camera,
    ros_camera_info,
    with_notes,
)
from calibration.plain_yaml import PlainYamlError, read_plain_yaml
from calibration.projection import PinholeCamera
from mvp.errors import CalibrationError

DATA = Path(__file__).parents[2].parent / "shared" / "data" / "opencv_chessboard"
FILE = CameraFile(
    PinholeCamera(532.83, 532.95, 342.49, 233.86, -0.281, 0.025, 1.2e-3, -1.4e-4),
    640,
    480,
)


@given(st.lists(st.floats(-1e3, 1e3), min_size=7, max_size=7), st.floats(1, 1e4))
@settings(max_examples=25, deadline=None)
def test_every_format_gives_back_the_same_camera(values, focal):
    camera = PinholeCamera(focal, focal * 1.1, *values[:6])
    for write in (opencv_yaml, ros_camera_info, kalibr_camchain):
        back = parse_camera(write(CameraFile(camera, 640, 480)))
        assert back.camera == camera
        assert (back.width_px, back.height_px) == (640, 480)


def test_opencv_reads_what_we_write(tmp_path):
    path = tmp_path / "camera.yml"
    path.write_text(opencv_yaml(FILE))
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    assert storage.getNode("camera_matrix").mat() == pytest.approx(FILE.camera.matrix)
    found = storage.getNode("distortion_coefficients").mat().ravel()
    assert found == pytest.approx(FILE.camera.distortion)
    assert storage.getNode("image_width").real() == 640
    storage.release()


def test_we_read_what_opencv_writes(tmp_path):
    path = tmp_path / "camera.yml"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", 640)
    storage.write("image_height", 480)
    storage.write("camera_matrix", FILE.camera.matrix)
    storage.write("distortion_coefficients", FILE.camera.distortion)
    storage.release()
    assert read_camera(path).camera.values == pytest.approx(FILE.camera.values)


def test_the_file_that_comes_with_opencv_is_read():
    if not DATA.is_dir():
        pytest.skip("the OpenCV chessboard pictures are not here")
    found = read_camera(DATA / "left_intrinsics.yml")
    assert found.camera.fx_px == pytest.approx(535.916, abs=1e-3)
    assert found.camera.cx_px == pytest.approx(342.283, abs=1e-3)
    assert found.camera.k1 == pytest.approx(-0.26637, abs=1e-5)
    assert (found.width_px, found.height_px) == (640, 480)


@pytest.mark.parametrize("write", [ros_camera_info, kalibr_camchain])
def test_a_common_yaml_reader_reads_the_same(write):
    yaml = pytest.importorskip("yaml", reason="PyYAML is not installed")
    text = write(FILE)

    def floats(value):
        if isinstance(value, dict):
            return {key: floats(inner) for key, inner in value.items()}
        if isinstance(value, list):
            return [floats(inner) for inner in value]
        return float(value) if isinstance(value, int) else value

    assert floats(yaml.safe_load(text)) == read_plain_yaml(text)


def test_a_printed_ros_message_is_read():
    text = """
header:
  stamp: {SEC}
height: 480
width: 640
distortion_model: plumb_bob
d:
- -0.281
- 0.025
- 0.0012
- -0.00014
- 0.0
k:
- 532.83
- 0.0
- 342.49
- 0.0
- 532.95
- 233.86
- 0.0
- 0.0
- 1.0
""".replace("{SEC}", "12")
    assert parse_camera(text).camera == FILE.camera


KALIBR = """
cam0:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, 0.1]
  - [0.0, 1.0, 0.0, 0.0]   # a comment
  camera_model: {model}
  distortion_coeffs: [-0.28, 0.07,
    0.0001, -0.0002]
  distortion_model: {distortion}
  intrinsics: [461.6, 460.3, 362.7, 248.1]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
"""


def test_a_kalibr_chain_is_read():
    found = parse_camera(KALIBR.format(model="pinhole", distortion="radtan"))
    assert found.camera.fx_px == 461.6
    assert found.camera.p2 == -0.0002
    assert found.name == "/cam0/image_raw"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (KALIBR.format(model="pinhole", distortion="equidistant"), "equidistant"),
        (KALIBR.format(model="omni", distortion="radtan"), "omni"),
        (ros_camera_info(FILE).replace("plumb_bob", "equidistant"), "equidistant"),
        (ros_camera_info(FILE).replace("image_width", "width_of"), "image_width"),
        (opencv_yaml(FILE).replace("532.83, 0.0", "532.83, 4.0"), "skewed"),
        (opencv_yaml(FILE).replace("532.83,", "-532.83,"), "positive"),
        (opencv_yaml(FILE).replace("532.83,", "many,"), "camera_matrix must be"),
        ("answer: 42\n", "no camera"),
    ],
)
def test_what_is_not_our_model_is_refused_by_name(text, words):
    with pytest.raises(CalibrationError, match=words):
        parse_camera(text)


def test_more_distortion_than_ours_is_refused_and_zeros_are_not():
    plain = (
        "image_width: 640\nimage_height: 480\nK: [500, 0, 320, 0, 500, 240, 0, 0, 1]\n"
    )
    assert parse_camera(plain + "D: [0.1, 0, 0, 0, 0, 0, 0, 0]\n").camera.k1 == 0.1
    with pytest.raises(CalibrationError, match="more terms"):
        parse_camera(plain + "D: [0.1, 0, 0, 0, 0, 0.2, 0, 0]\n")


def test_k3_is_not_dropped_on_the_way_to_kalibr():
    with pytest.raises(CalibrationError, match="no k3"):
        kalibr_camchain(CameraFile(PinholeCamera(1, 1, 0, 0, k3=0.1), 640, 480))


@pytest.mark.parametrize(
    "text",
    [
        "",
        "a: [1, 2",
        "a: {b: 1}",
        "a: &x 1",
        "a: *x",
        "a: |\n  text",
        "\ta: 1",
        "a: 1\na: 2",
        "a: 1\n   b: 2",
        "just words",
        "- 1\n- 2",
        "a: [1] 2",
    ],
)
def test_other_yaml_is_refused_with_its_line(text):
    with pytest.raises(PlainYamlError, match="line"):
        read_plain_yaml(text)


def test_files_that_cannot_be_read_are_named(tmp_path):
    with pytest.raises(CalibrationError, match=r"none\.yml"):
        read_camera(tmp_path / "none.yml")
    binary = tmp_path / "binary.yml"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(CalibrationError, match=r"binary\.yml"):
        read_camera(binary)
    broken = tmp_path / "broken.yml"
    broken.write_text("camera_matrix: [1, 2")
    with pytest.raises(CalibrationError, match=r"broken\.yml: line 1"):
        read_camera(broken)


@given(st.text(alphabet="ab:-[], \n#\"'1.e!%&*{}|", max_size=60))
@settings(max_examples=200, deadline=None)
def test_any_text_is_read_or_refused(text):
    with contextlib.suppress(PlainYamlError):
        assert isinstance(read_plain_yaml(text), dict)


@given(
    st.sampled_from([opencv_yaml, ros_camera_info, kalibr_camchain]),
    st.integers(0, 600),
    st.integers(0, 12),
    st.text(alphabet="0169.-e[],: \nnaif{", max_size=4),
)
@settings(max_examples=150, deadline=None)
def test_a_damaged_camera_file_is_read_or_refused(write, place, count, patch):
    text = write(FILE)
    with contextlib.suppress(PlainYamlError, CalibrationError):
        found = parse_camera(text[:place] + patch + text[place + count :])
        assert isinstance(found, CameraFile)


def test_small_numbers_are_numbers_for_every_reader():
    file = CameraFile(PinholeCamera(500, 500, 320, 240, k1=1e-05, p1=-2e-07), 640, 480)
    for write in (opencv_yaml, ros_camera_info, kalibr_camchain):
        assert "1.0e-05" in write(file)
        assert "-2.0e-07" in write(file)
        assert parse_camera(write(file)).camera == file.camera


def test_comments_stand_where_every_reader_passes_over_them(tmp_path):
    text = with_notes(opencv_yaml(FILE), ["one", "two\nlines: [", ""])
    assert text.startswith("%YAML:1.0\n---\n# one\n# two lines: [\n# \nimage_width")
    assert with_notes(ros_camera_info(FILE), ["one"]).startswith("# one\nimage_width")
    path = tmp_path / "camera.yml"
    path.write_text(text)
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    assert storage.getNode("camera_matrix").mat() == pytest.approx(FILE.camera.matrix)
    storage.release()


def test_a_comment_keeps_printable_characters_only():
    text = with_notes(
        kalibr_camchain(FILE), ["no \x00\x1b[1m7\x7f\ud800 of \xb5m\ufffe"]
    )
    assert text.startswith("# no [1m7 of \xb5m\n")
    assert parse_camera(text).camera == FILE.camera


ROI = "roi:\n  x_offset: {}\n  y_offset: 0\n  height: {}\n  width: {}\n  do_rectify: false\n"


@pytest.mark.parametrize("size", [(0, 0), (480, 640)])
def test_a_part_of_the_picture_that_is_all_of_it_is_read(size):
    text = ros_camera_info(FILE) + ROI.format(0, *size)
    assert parse_camera(text).camera == FILE.camera


@pytest.mark.parametrize(
    ("roi", "words"),
    [
        ((8, 480, 640), "roi.x_offset"),
        ((0, 480, 320), "roi.width"),
        ((0, 640, 0), "height"),
    ],
)
def test_a_part_of_the_picture_is_refused(roi, words):
    with pytest.raises(CalibrationError, match=words):
        parse_camera(ros_camera_info(FILE) + ROI.format(*roi))


def test_quotes_and_comments_are_told_apart():
    text = "a: it's # so\nb: 'x # y' # z\nc: \"p: q\"\nd: n#m"
    found = read_plain_yaml(text)
    assert found == {"a": "it's", "b": "x # y", "c": "p: q", "d": "n#m"}
