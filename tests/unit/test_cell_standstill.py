"""After a stop: what is seen to stand, and what may still be moving and until when."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import pytest

from mvp.cell.home_job import home_cell
from mvp.cell.loading import load_cell, load_task
from mvp.cell.standstill import UnderWay, seen_at_rest, stopped_on_error, until
from mvp.cli.main import invoke
from mvp.cli.output import report_error, tell_error
from mvp.errors import (
    DeviceError,
    DeviceFault,
    DeviceTimeout,
    LimitError,
    LinkLost,
    MvpCellError,
    StoppedByOperator,
    UsageError,
)

if TYPE_CHECKING:
    from pathlib import Path

    from mvp.cell.engine import CellDevices

NOW = re.compile(r"until \d\d:\d\d:\d\d at the latest")


@dataclass
class Motor:
    """A device that stands after so many looks; None: it cannot be asked any more."""

    name: str
    looks: int | None = 0

    def state(self) -> object:
        if self.looks is None:
            raise LinkLost("unplugged", device=self.name)
        self.looks -= 1
        return SimpleNamespace(standing=self.looks < 0)


class Cell:
    """As much of a cell's devices as a stop sees."""

    def __init__(self, arm: int | None = 0, lens: int | None = 0) -> None:
        self.arm, self.lens = Motor("arm", arm), Motor("lens", lens)
        self.stops = 0

    def stop(self) -> list[Exception]:
        self.stops += 1
        return []


def of(cell: Cell) -> CellDevices:
    return cast("CellDevices", cell)


def stopped(cell: Cell, motion: str, error: BaseException) -> MvpCellError:
    """What comes out when a motion ends so."""
    under_way = UnderWay()
    with (
        pytest.raises(MvpCellError) as caught,
        stopped_on_error(of(cell), under_way, lambda text: None),
        under_way.moving(motion, 30),
    ):
        raise error
    return caught.value


def test_a_device_is_asked_until_it_stands() -> None:
    rest = seen_at_rest(of(Cell(arm=2)))
    assert rest.stands == "arm and lens"
    assert rest.may_still_move(until("the arm on its way", 5)) == ""


def test_a_device_that_cannot_be_asked_may_still_be_moving_until_its_time() -> None:
    error = stopped(
        Cell(arm=None), "the arm on its way to v1", DeviceTimeout("x", device="arm")
    )
    assert error.stands == "lens"
    assert error.may_still_move.startswith("the arm on its way to v1, until ")
    assert NOW.search(error.may_still_move)
    assert error.may_still_move.endswith("(it cannot be asked: unplugged)")


def test_ctrl_c_ends_as_a_stop_that_says_what_stands() -> None:
    cell = Cell()
    error = stopped(cell, "the lens", KeyboardInterrupt())
    assert isinstance(error, StoppedByOperator)
    assert (error.stands, error.may_still_move) == ("arm and lens", "")
    assert cell.stops == 1


@pytest.mark.parametrize(
    "error", [LimitError("too far", device="arm"), UsageError("what?")]
)
def test_a_refusal_says_nothing_about_motion_that_never_was(
    error: MvpCellError,
) -> None:
    cell, under_way = Cell(), UnderWay()
    with (
        pytest.raises(type(error)) as caught,
        stopped_on_error(of(cell), under_way, lambda text: None),
    ):
        raise error
    assert (caught.value.stands, caught.value.may_still_move) == ("", "")


def test_a_motion_that_was_refused_is_not_under_way() -> None:
    under_way = UnderWay()
    with pytest.raises(LimitError), under_way.moving("the arm", 5):
        raise LimitError("too far", device="arm")
    assert under_way.text == ""
    with pytest.raises(DeviceFault), under_way.moving("the arm", 5):
        raise DeviceFault("stuck", device="arm")
    assert under_way.text.startswith("the arm, until")


def test_the_error_says_what_stands_to_people_and_to_programs(
    capsys: pytest.CaptureFixture[str],
) -> None:
    error = DeviceFault("stuck", device="arm", hint="look at it")
    error.stands, error.may_still_move = "lens", "the arm, until 12:00:00 at the latest"
    tell_error(error)
    assert capsys.readouterr().err.splitlines() == [
        "error: arm: stuck",
        "seen to stand: lens",
        "may still be moving: the arm, until 12:00:00 at the latest",
        "hint:  look at it",
    ]
    report_error(error, as_json=True, told=True)
    out = capsys.readouterr().out
    assert '"stands": "lens"' in out
    assert '"may_still_move": "the arm, until 12:00:00 at the latest"' in out


@pytest.mark.parametrize(
    ("jogs", "fault"),
    [
        (["home", "zoom 1240"], '[world.faults.lens]\nstall = "zoom"'),
        (["j1 10"], "[world.faults.arm]\nprotective_stop_after_s = 0.05"),
    ],
)
def test_jog_says_what_stands_after_a_fault(
    jogs: list[str],
    fault: str,
    virtual_copy: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    file = virtual_copy / "cell.toml"
    text = file.read_text().replace("clock_speed = 1.0", "clock_speed = 100.0")
    file.write_text(f"{text}\n{fault}\n")
    words = [part for jog in jogs for part in ("--do", jog)]
    assert invoke(["jog", str(virtual_copy), *words, "--json"]) == 4
    out, err = capsys.readouterr()
    assert "looking whether arm and lens stand" in err
    assert "seen to stand: arm and lens" in err
    assert "may still be moving" not in err
    assert json.loads(out)["stands"] == "arm and lens"
    assert json.loads(out)["may_still_move"] is None


def test_home_says_what_may_still_be_moving_when_a_device_is_lost(
    devices_at_home: list[CellDevices],
) -> None:
    cell = load_cell("virtual")

    def allow(motion: object) -> bool:
        devices_at_home[0].lens.close()
        return True

    with pytest.raises(DeviceError) as caught:
        home_cell(cell, load_task(cell, None), allow)
    assert caught.value.stands == "arm"
    assert caught.value.may_still_move.startswith("the lens, homing, until ")
