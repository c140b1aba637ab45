"""``mvp-cell jog`` with a person at a terminal: what moves is seen to, the picture too."""

from __future__ import annotations

import os
import pty
import re
import select
import signal
import subprocess
import sys
import time
from contextlib import suppress
from typing import TYPE_CHECKING, Self

import cv2
import pytest

if TYPE_CHECKING:
    from pathlib import Path

_PATIENCE_S = 90.0
_PROMPT = "jog> "


class Person:
    """Types at a terminal of 80 x 24 characters and reads what comes."""

    def __init__(self, cell: Path, *options: str) -> None:
        self._ours, its = pty.openpty()
        place = {"COLUMNS": "80", "LINES": "24", "TERM": "xterm-256color"}
        self._jog = subprocess.Popen(
            [sys.executable, "-m", "mvp", "jog", str(cell), *options],
            stdin=its,
            stdout=its,
            stderr=its,
            env=os.environ | place,
            start_new_session=True,
        )
        os.close(its)
        self.shown = ""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self._jog.kill()
        self._jog.wait()
        os.close(self._ours)

    def types(self, keys: str) -> None:
        os.write(self._ours, keys.encode())

    def presses_ctrl_c(self) -> None:
        self._jog.send_signal(signal.SIGINT)

    def sees(self, pattern: str) -> str:
        """Wait for it; what came up to its end, which is gone then."""
        end_s = time.monotonic() + _PATIENCE_S
        while not (found := re.search(pattern, self.shown)):
            if time.monotonic() > end_s or not self._read():
                pytest.fail(f"no {pattern!r} in {self.shown!r}")
        seen, self.shown = self.shown[: found.end()], self.shown[found.end() :]
        return seen

    def says(self, line: str) -> str:
        """A line, and what comes until the next prompt."""
        self.types(f"{line}\n")
        return self.sees(_PROMPT)

    def code(self) -> int:
        """How it ended; all that came is shown."""
        while self._read():
            pass
        return self._jog.wait(_PATIENCE_S)

    def _read(self) -> bool:
        """Whether there may be more."""
        if not select.select([self._ours], [], [], 1.0)[0]:
            return self._jog.poll() is None
        with suppress(OSError):  # the terminal's way to say that nobody has it open
            self.shown += os.read(self._ours, 65536).decode(errors="replace")
            return True
        return False


@pytest.fixture
def cell(virtual_copy: Path) -> Path:
    """Six times as fast as life, and no picture takes long to draw."""
    file = virtual_copy / "cell.toml"
    text = file.read_text().replace("clock_speed = 1.0", "clock_speed = 6.0")
    file.write_text(f"{text}\nsmear_instants = 1\n")
    return virtual_copy


def joints_seen(shown: str) -> list[float]:
    """Joint 1 in deg, as it was drawn while it moved."""
    return [float(j) for j in re.findall(r"\d s: joints (-?[\d.]+) deg", shown)]


def test_position_and_picture_are_live_and_a_dead_camera_ends_the_picture_only(
    cell: Path, tmp_path: Path
) -> None:
    file = tmp_path / "live.png"
    with (cell / "cell.toml").open("a") as text:
        text.write("\n[world.faults.camera]\ndead_after_frames = 10\n")
    with Person(cell, "--speed", "0.01") as person:
        person.sees(_PROMPT)
        assert re.search(r"\d s: lens zoom \d+", person.says("home"))
        seen = joints_seen(person.says("j1 10"))
        assert len(set(seen)) > 1
        assert seen == sorted(seen)

        person.types("live\n")
        person.sees("\u2580")
        person.sees("Enter or q: back to jogging")
        person.presses_ctrl_c()
        assert "lens zoom 0" in person.sees(_PROMPT)

        assert "live until live off" in person.says(f"live {file}")
        assert cv2.imread(str(file), cv2.IMREAD_UNCHANGED).shape == (1024, 1280)
        said = person.sees("the live picture has ended: camera: no frame in time")
        said += person.sees(_PROMPT)
        said += person.says("j1 -5")
        assert "5.00 deg" in said
        assert "has ended" not in said.partition("no frame in time")[2]
        person.types("quit\n")
        assert person.code() == 0, person.shown
    assert [path.name for path in tmp_path.glob("*.p*")] == ["live.png"]


def test_ctrl_c_stops_a_motion_while_a_picture_is_live(
    cell: Path, tmp_path: Path
) -> None:
    file = tmp_path / "live.png"
    with Person(cell, "--speed", "0.01") as person:
        person.sees(_PROMPT)
        assert "live until live off" in person.says(f"live {file}")
        person.types("j1 30\n")
        person.sees(r"\d s: joints (?!0.00)")
        person.presses_ctrl_c()
        assert person.code() == 6, person.shown
        assert "stopped by the operator" in person.shown
        assert "seen to stand: arm and lens" in person.shown
    assert cv2.imread(str(file), cv2.IMREAD_UNCHANGED).shape == (1024, 1280)
