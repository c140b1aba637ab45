"""Files are whole or as they were before, and a full disk is called by its name."""

from __future__ import annotations

import errno
import sys
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from mvp.cell.durable import (
    append_durably,
    check_writable,
    cut_durably,
    output_error,
    write_durably,
)
from mvp.cell.lock import cell_lock
from mvp.cell.logs import log_to
from mvp.errors import OutputError

if TYPE_CHECKING:
    from collections.abc import Iterator

needs_limits = pytest.mark.skipif(sys.platform == "win32", reason="needs RLIMIT_FSIZE")


@contextmanager
def no_file_longer_than(size: int) -> Iterator[None]:
    """The system writes up to this size and refuses the rest."""
    import resource

    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@needs_limits
def test_a_line_that_finds_no_room_leaves_the_file_as_it_was(tmp_path: Path) -> None:
    file = tmp_path / "lines"
    append_durably(file, "first")
    with no_file_longer_than(9), pytest.raises(OutputError, match="takes no more"):
        append_durably(file, "second")
    assert file.read_bytes() == b"first\n"
    append_durably(file, "third")
    assert file.read_bytes() == b"first\nthird\n"


@needs_limits
def test_a_file_that_finds_no_room_leaves_the_old_one(tmp_path: Path) -> None:
    file = tmp_path / "document"
    write_durably(file, b"old")
    with no_file_longer_than(9), pytest.raises(OutputError):
        write_durably(file, b"a longer one")
    assert file.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [file]


@needs_limits
def test_a_lock_that_cannot_be_written_is_not_held(tmp_path: Path) -> None:
    file = tmp_path / "lock"
    with (
        no_file_longer_than(9),
        pytest.raises(OutputError, match="lock"),
        cell_lock(file, run_id="a"),
    ):
        pass
    assert not file.exists()
    with cell_lock(file, run_id="b") as crashed:
        assert not crashed


@needs_limits
def test_a_log_that_finds_no_room_keeps_whole_lines_and_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import logging

    file = tmp_path / "log.jsonl"
    logger = logging.getLogger("mvp.test")
    with log_to(file, "run") as log:
        logger.info("first")
        kept = file.read_bytes()
        with no_file_longer_than(len(kept) + 5):
            logger.info("second")
        logger.info("third")
    assert file.read_bytes() == kept
    assert log.error is not None
    assert log.error.where == str(file)
    assert capsys.readouterr().err == ""


def test_what_a_crash_left_is_cut_off_without_a_copy(tmp_path: Path) -> None:
    file = tmp_path / "lines"
    file.write_bytes(b"first\nsec")
    cut_durably(file, 6)
    assert file.read_bytes() == b"first\n"


@pytest.mark.parametrize(
    ("number", "says"),
    [
        (errno.ENOSPC, "the disk is full"),
        (errno.EDQUOT, "the quota is used up"),
        (errno.EFBIG, "takes no more"),
    ],
)
def test_a_full_disk_is_named_with_what_is_free(
    number: int, says: str, tmp_path: Path
) -> None:
    error = output_error(tmp_path / "not" / "there", OSError(number, "x"))
    assert says in error.message
    assert "B free" in error.message
    assert error.hint


def test_room_is_asked_for_before_anything_is_written(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"MB free, but .* MB may be needed"):
        check_writable(tmp_path / "runs", needed_bytes=10**18)
    assert list(tmp_path.iterdir()) == []


def test_a_device_that_is_always_full_is_reported() -> None:
    device = Path("/dev/full")
    if not device.exists():
        pytest.skip("this system has no /dev/full")
    with pytest.raises(OutputError, match="/dev/full: the disk is full"):
        append_durably(device, "line")
