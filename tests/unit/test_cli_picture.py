"""A camera's picture in a file that others read meanwhile, and in a terminal."""

from __future__ import annotations

import threading
from contextlib import suppress
from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest

from mvp.cli.picture import fitted, grey_blocks, save_picture
from mvp.devices import Frame
from mvp.errors import OutputError

if TYPE_CHECKING:
    from pathlib import Path


def a_frame(number: int = 0) -> Frame:
    pixels = np.full((30, 40), number % 256, np.uint8)
    return Frame(pixels, 255, 0.0, 0.01, 0.0, number)


def test_who_reads_the_file_finds_a_whole_picture(tmp_path: Path) -> None:
    file = tmp_path / "live.png"
    save_picture(file, a_frame())
    done = threading.Event()

    def write() -> None:
        try:
            with suppress(OutputError):
                for number in range(200):
                    save_picture(file, a_frame(number))
        finally:
            done.set()

    writer = threading.Thread(target=write)
    writer.start()
    while not done.is_set():
        picture = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
        assert picture is not None
        assert picture.shape == (30, 40)
    writer.join()
    assert [path.name for path in tmp_path.iterdir()] == ["live.png"]


def test_what_cannot_be_replaced_stays_and_nothing_is_left_behind(
    tmp_path: Path,
) -> None:
    (tmp_path / "live.png").mkdir()
    with pytest.raises(OutputError, match=r"live\.png"):
        save_picture(tmp_path / "live.png", a_frame())
    assert [path.name for path in tmp_path.iterdir()] == ["live.png"]


def test_what_cannot_be_made_a_png_leaves_the_last_good_picture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "live.png"
    save_picture(file, a_frame())
    good = file.read_bytes()
    nothing = np.empty(0, np.uint8)
    monkeypatch.setattr(cv2, "imencode", lambda *given: (False, nothing))
    with pytest.raises(OutputError, match=r"live\.png"):
        save_picture(file, a_frame(1))
    assert file.read_bytes() == good
    assert [path.name for path in tmp_path.iterdir()] == ["live.png"]


@pytest.mark.parametrize(
    ("shape", "columns", "lines", "size"),
    [
        ((1024, 1280), 100, None, (100, 40)),
        ((1024, 1280), 100, 20, (50, 20)),
        ((1024, 1280), 20, 20, (20, 8)),
        ((10, 1000), 80, 5, (80, 1)),
        ((1000, 10), 80, 5, (2, 5)),
    ],
)
def test_a_picture_fits_the_terminal_undistorted(
    shape: tuple[int, int], columns: int, lines: int | None, size: tuple[int, int]
) -> None:
    assert fitted(shape, columns, lines) == size


def test_a_picture_is_drawn_with_two_rows_of_pixels_in_a_line() -> None:
    pixels = np.array([[0, 255], [128, 64]], np.uint8).repeat(2, 0).repeat(2, 1)
    frame = Frame(pixels, 255, 0.0, 0.01, 0.0, 1)
    drawn = [s for s in grey_blocks(frame, 2, 1).segments if s.text.strip()]
    shades = [
        (s.style.color.triplet.red, s.style.bgcolor.triplet.red)
        for s in drawn
        if s.style and s.style.color and s.style.bgcolor
        if s.style.color.triplet and s.style.bgcolor.triplet
    ]
    assert shades == [(0, 128), (255, 64)]
