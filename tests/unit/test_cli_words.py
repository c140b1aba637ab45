"""What a person reads: this very cell, one prefix, whole lines, each phase once."""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from mvp.cell.documents import RunSummary
from mvp.cell.engine import CellDevices
from mvp.cell.hardware import opened
from mvp.cell.session import Motion
from mvp.cell.wording import look_first
from mvp.cli import ask as asking
from mvp.cli.main import invoke
from mvp.cli.naming import name_cell, named
from mvp.cli.runs import print_runs
from mvp.devices import DeviceInfo, RealClock
from mvp.errors import ConnectError, DeviceFault, DeviceTimeout

if TYPE_CHECKING:
    from pathlib import Path


def test_hints_name_the_cell_as_it_was_given_ready_to_be_pasted() -> None:
    hint = "look; `mvp-cell recover CELL` leads back, then `mvp-cell home CELL`"
    assert named(hint, "my cell/cell.toml") == (
        "look; `mvp-cell recover 'my cell/cell.toml'` leads back, then "
        "`mvp-cell home 'my cell/cell.toml'`"
    )
    assert named("`mvp-cell calibrate hand-eye CELL`", "x").endswith(" x`")
    assert named("a cell is a CELL", "x") == "a cell is a CELL"
    error = DeviceFault("x", device="arm", hint=hint)
    name_cell(error, r"a\1b")
    assert r"recover 'a\1b'`" in error.hint


def test_the_hint_of_a_command_that_fails_names_its_cell(
    virtual_copy: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    with (virtual_copy / "cell.toml").open("a") as file:
        file.write("\n[world.faults.arm]\nunreachable = true\n")
    monkeypatch.chdir(virtual_copy.parent)
    for command in ("check", "home", "jog --do where"):
        name, *options = command.split()
        assert invoke([name, "my cell", *options]) == 4
        assert "CELL" not in capsys.readouterr().err


def test_a_device_is_named_once_however_often_its_error_is_passed_on() -> None:
    inner = DeviceTimeout("fell silent", device="arm")
    outer = DeviceFault(str(inner), device="arm")
    assert outer.message == "arm: fell silent"
    assert outer.detail == "fell silent"


class Dead:
    def __init__(self, name: str, error: Exception | None) -> None:
        self.name, self.error = name, error

    def open(self) -> None:
        if self.error is not None:
            raise self.error

    def close(self) -> None:
        pass


@pytest.mark.parametrize(
    ("dead", "said"),
    [
        (["arm"], "arm: nobody answers"),
        (
            ["arm", "lens"],
            "arm, lens: 2 devices cannot be used: arm: nobody answers; "
            "lens: nobody answers",
        ),
    ],
)
def test_devices_that_do_not_open_are_each_named_once(
    dead: list[str], said: str
) -> None:
    made = [
        Dead(
            name, ConnectError("nobody answers", device=name) if name in dead else None
        )
        for name in ("arm", "lens", "camera")
    ]
    devices = CellDevices(*made, RealClock())  # type: ignore[arg-type]
    with pytest.raises(ConnectError) as caught, opened(devices):
        pass
    assert caught.value.message == said


def test_every_command_says_in_one_whole_line_what_it_does() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "mvp", "--help"],
        capture_output=True,
        text=True,
        check=True,
        env={"COLUMNS": "80", "PATH": ""},
    )
    commands = done.stdout.partition("Commands:")[2].splitlines()[1:]
    assert len(commands) >= 13
    for line in commands:
        assert len(line) <= 80
        assert not line.endswith("...")
        assert line[:3].lstrip() == line[2], line


def test_runs_are_listed_one_a_line_however_long_their_ids(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    long = "20261122T090011Z-paper_object-" + "specimen" * 8
    print_runs(
        [
            RunSummary(run_id=long, folder="x", status="verified", cell="virtual"),
            RunSummary(
                run_id="short",
                folder="y",
                status="broken off",
                cell="virtual",
                views=4,
                captured=1,
            ),
        ]
    )
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 3
    assert lines[1].split() == [long, "verified", "virtual"]
    assert lines[2].split() == "short broken off 1 of 4 captured virtual".split()


@pytest.mark.parametrize(
    ("views", "errand", "said"),
    [
        (1, "", "will move to 1 place."),
        (3, "", "will move to 3 places."),
        (1, "move home", "will move home."),
    ],
)
def test_the_question_says_what_will_move(
    views: int,
    errand: str,
    said: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(asking, "terminal", lambda: True)
    monkeypatch.setattr(asking, "ask", lambda question: "y")
    info = DeviceInfo("arm", "gantry", "G", "1", "1", simulated=False)
    motion = Motion("cell", views, {"arm": info}, errand=errand)
    assert asking.allow_motion(motion, yes=False)
    assert said in " ".join(capsys.readouterr().err.split())


def test_each_phase_is_told_on_stderr_once_and_json_stays_alone(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert invoke(["check", "virtual", "--json"]) == 0
    out, err = capsys.readouterr()
    assert out.startswith("{")
    phases = [line for line in err.splitlines() if line.endswith(" ...")]
    assert phases == [
        "loading paper_object.stl ...",
        "asking arm, lens and camera; taking a test picture ...",
    ]


def test_a_misalignment_asks_after_axes_that_nothing_measures() -> None:
    plain = "part in its place? then hand-eye and part-pose calibration"
    told = look_first("misalignment", plain, "A, B")
    assert "axes A, B at their marks" in told
    assert told.endswith(plain)
    assert look_first("misalignment", plain, "") == plain
    assert look_first("defocus", plain, "A, B") == plain
