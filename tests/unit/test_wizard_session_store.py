"""A session's folder keeps what was told, whatever happens to the program."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from calibration.targets import Detection
from calibration.wizard.session_store import Finding, SessionStore
from mvp.cell.loading import load_cell
from mvp.errors import OutputError, RecordError
from mvp.geometry import Pose
from mvp.wizard import SessionFacts, Shot

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture(scope="module")
def facts() -> SessionFacts:
    found = load_cell("virtual").calibrations
    return SessionFacts.model_validate(
        {
            "key": "camera",
            "cell": "virtual",
            "simulated": True,
            "date": "2026-01-01",
            "serials": {"camera": "C-1"},
            "arm_model": "ur5e",
            "camera": found.camera,
            "lens_table": found.lens_table,
            "hand_eye": found.hand_eye,
            "part_pose": found.part_pose,
            "robot": {"position_mm": 0.1, "angle_deg": 0.02},
            "blur_circle_mm": 0.0135,
            "workspace_low_mm": (0, 0, 0),
            "workspace_high_mm": (1, 1, 1),
        }
    )


@pytest.fixture
def store(tmp_path: Path, facts: SessionFacts) -> SessionStore:
    return SessionStore.create(tmp_path / "session", facts)


def shot(grey: int = 7, *, wide: bool = False) -> Shot:
    kind, most = (np.uint16, 4095) if wide else (np.uint8, 255)
    turn = np.array([0.1, 0.2, 0.3])
    return Shot(
        np.full((6, 8), grey, kind),
        most,
        0.01,
        1.0,
        np.array([0.1, 1 / 3, np.pi]),
        Pose.from_rotvec("base", "tool", turn, np.array([1 / 7, 2.0, 3.0])),
        {"zoom": 1, "focus": 2, "iris": 3},
        {"received": 1 / 3},
        settled=True,
        frame_id=5,
    )


def finding() -> Finding:
    pixels = np.array([[1 / 3, 2 / 7], [5.0, 1e-17]])
    points = np.array([[0.0, 0.1, 0.0], [15.0, 0.0, 0.0]])
    ids, spacing = np.array([0, 3]), np.array([4.0, 4.0])
    return Finding(Detection(ids, points, pixels, spacing, ids), extra={"node": 2})


def test_what_comes_back_is_what_was_told_to_the_last_digit(
    store: SessionStore,
) -> None:
    told = store.add(shot(200), finding(), name="first")
    store.remember("square_mm", 15.003)
    again = SessionStore.open(store.path)
    (sample,) = again.samples
    assert sample == told
    assert np.array_equal(sample.found_pixels, [[1 / 3, 2 / 7], [5.0, 1e-17]])
    assert sample.pose.matrix.tolist() == shot().base_from_tool.matrix.tolist()
    assert np.array_equal(again.image(sample), shot(200).pixels)
    assert again.recall("square_mm") == 15.003
    assert again.sha256() == store.sha256()


def test_pictures_of_more_than_8_bits_are_kept_whole(store: SessionStore) -> None:
    sample = store.add(shot(3000, wide=True), Finding())
    assert np.array_equal(store.image(sample), shot(3000, wide=True).pixels)
    assert shot(4095, wide=True).grey.max() == 255


def test_a_number_is_never_used_twice(store: SessionStore) -> None:
    store.add(shot(1), Finding())
    store.add(shot(2), Finding())
    taken_back = store.undo()
    assert taken_back is not None
    assert taken_back.number == 2
    again = SessionStore.open(store.path)
    assert again.add(shot(3), Finding()).number == 3
    assert [s.number for s in SessionStore.open(store.path).samples] == [1, 3]


def test_a_picture_that_does_not_count_says_why(store: SessionStore) -> None:
    store.add(shot(), Finding(reason="blurred", action="focus"))
    assert store.usable() == ()
    assert store.count == 1


def test_after_a_crash_half_a_line_is_dropped_and_its_picture_written_over(
    store: SessionStore,
) -> None:
    store.add(shot(1), Finding())
    lines = store.path / "samples.jsonl"
    with lines.open("a") as file:
        file.write('{"schema": ')
    (store.path / "images" / "002.png").write_bytes(b"half")
    with pytest.raises(RecordError, match="cut off"):
        SessionStore.open(store.path)
    again = SessionStore.open(store.path, repair=True)
    again.add(shot(2), Finding())
    assert [s.number for s in SessionStore.open(store.path).samples] == [1, 2]


def test_a_line_that_is_missing_is_noticed(store: SessionStore) -> None:
    for grey in (1, 2, 3):
        store.add(shot(grey), Finding())
    lines = store.path / "samples.jsonl"
    first, _, third = lines.read_text().splitlines()
    lines.write_text(f"{first}\n{third}\n")
    with pytest.raises(RecordError, match="missing, added or foreign"):
        SessionStore.open(store.path)


def test_another_picture_is_noticed(store: SessionStore) -> None:
    store.add(shot(1), Finding())
    other = store.add(shot(2), Finding())
    content = (store.path / other.image).read_bytes()
    (store.path / "images" / "001.png").write_bytes(content)
    with pytest.raises(RecordError, match="not the picture that was taken"):
        SessionStore.open(store.path)


@pytest.mark.parametrize("text", ["", "{}", "[1]", '{"facts": 1}'])
def test_a_file_that_is_no_session_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "session.json").write_text(text)
    with pytest.raises(RecordError, match="damaged"):
        SessionStore.open(tmp_path)


@pytest.mark.parametrize("line", ["[]", "1", '{"undone": 1}', '{"number": 1}', "x"])
def test_a_line_that_is_no_sample_is_refused(store: SessionStore, line: str) -> None:
    (store.path / "samples.jsonl").write_text(line + "\n")
    with pytest.raises(RecordError, match=r"samples\.jsonl:1: damaged"):
        SessionStore.open(store.path)


def test_a_session_does_not_begin_in_a_folder_that_exists(
    store: SessionStore, facts: SessionFacts
) -> None:
    with pytest.raises(OutputError):
        SessionStore.create(store.path, facts)
