"""Arms that have to find their references before anything else moves."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import pytest

from mvp.cell.homing import home_arm, is_homed
from mvp.cell.session import Motion
from mvp.cli import ask as asking
from mvp.devices import DeviceInfo, Homable
from mvp.errors import DeviceFault

if TYPE_CHECKING:
    from mvp.cell.engine import CellDevices
    from mvp.devices import Device


class Slides:
    """As much of an arm as homing sees."""

    name = "arm"

    def __init__(self, *, stuck: bool = False) -> None:
        self.homed = False
        self.homings = 0
        self._stuck = stuck

    def home(self, *, timeout_s: float) -> None:
        self.homings += 1
        if self._stuck:
            raise DeviceFault("no switch", device=self.name)
        self.homed = timeout_s > 0


def cell_of(arm: object, stops: list[str]) -> CellDevices:
    found = SimpleNamespace(arm=arm, stop=lambda: stops.append("stopped"))
    return cast("CellDevices", found)


def test_an_arm_that_was_homed_is_not_homed_again() -> None:
    arm = Slides()
    assert isinstance(arm, Homable)
    assert not is_homed(cast("Device", arm))
    home_arm(cell_of(arm, []))
    home_arm(cell_of(arm, []))
    assert arm.homings == 1
    assert is_homed(cast("Device", arm))


def test_an_arm_that_always_knows_where_it_is() -> None:
    arm = SimpleNamespace(name="arm")
    assert is_homed(cast("Device", arm))
    home_arm(cell_of(arm, []))


def test_everything_is_stopped_when_homing_fails() -> None:
    stops: list[str] = []
    with pytest.raises(DeviceFault):
        home_arm(cell_of(Slides(stuck=True), stops))
    assert stops == ["stopped"]


@pytest.mark.parametrize("homes", [True, False])
def test_the_question_says_that_the_arm_will_be_homed(
    homes: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(asking, "terminal", lambda: True)
    monkeypatch.setattr(asking, "ask", lambda question: "y")
    info = DeviceInfo("arm", "gantry", "G", "1", "1", simulated=False)
    assert asking.allow_motion(Motion("cell", 3, {"arm": info}, homes=homes), yes=False)
    told = " ".join(capsys.readouterr().err.split())
    assert ("to their references" in told) is homes
