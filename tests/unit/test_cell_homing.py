"""Arms that have to find their references before anything else moves."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import numpy as np
import pytest

from mvp.cell.homing import home_arm, homing_of, is_homed
from mvp.cell.jog_job import Jogger
from mvp.cell.jog_words import Plain
from mvp.cell.loading import load_cell
from mvp.cell.session import Motion
from mvp.cli import ask as asking
from mvp.devices import DeclaresAxes, DeviceInfo, Homable, Homing
from mvp.errors import DeviceFault, LimitError, UsageError
from mvp.geometry import Box
from mvp.kinematics import Capsule, CellBodies, Gantry, obstacles

if TYPE_CHECKING:
    from mvp.cell.engine import CellDevices
    from mvp.cell.plan_job import Setting
    from mvp.devices import Arm, Device
    from mvp.devices.protocols import ClearWay


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


class Head(Slides):
    """As much of an arm with a declared axis as homing sees."""

    def __init__(self, start: tuple[float, ...], marks: tuple[float, ...]) -> None:
        super().__init__()
        self.driven: list[tuple[float, ...]] = []
        self._way = start, marks

    def homing(self) -> Homing:
        return Homing("X, Y and Z go to their switches.", ("A",))

    def home(self, *, timeout_s: float, clear: ClearWay | None = None) -> None:
        if clear is None:
            raise DeviceFault("nobody can say", device=self.name)
        clear(*self._way)
        self.driven.append(self._way[1])
        self.homed = True


UP = (0.0, 0.0, 500.0, 0.0, 0.0)
TILTED = (0.0, 0.0, 500.0, 0.0, 1.5)


def bodies_with(low: tuple[float, ...], high: tuple[float, ...]) -> CellBodies:
    """A gantry with a camera of 150 mm, and one box in its cell."""
    camera = Capsule("camera", np.array([0, 0, 20.0]), np.array([0, 0, 150.0]), 30.0)
    box = obstacles(None, (), [("clamp", Box(np.array(low), np.array(high)))])
    return CellBodies(Gantry(), (camera,), box)


def test_the_head_goes_back_to_its_marks_along_a_way_that_is_clear() -> None:
    arm = Head(TILTED, UP)
    assert isinstance(arm, DeclaresAxes)
    home_arm(cell_of(arm, []), bodies_with((400, 400, 0), (500, 500, 100)), 5.0)
    assert arm.driven == [UP]


def test_the_head_is_not_driven_against_what_stands_in_its_way() -> None:
    arm, stops = Head(TILTED, UP), []
    # Straight and tilted it is clear; half-way down it would meet the clamp.
    clamp = bodies_with((-50, 110, 330), (50, 200, 430))
    assert clamp.nearest(np.array(TILTED)).distance_mm > 5
    assert clamp.nearest(np.array(UP)).distance_mm > 5
    with pytest.raises(LimitError, match=r"camera would come within .* of clamp"):
        home_arm(cell_of(arm, stops), clamp, 5.0)
    assert arm.driven == []
    assert not arm.homed
    assert stops == ["stopped"]


def test_nothing_is_driven_where_nothing_is_known_of_the_cell() -> None:
    arm = Head(TILTED, UP)
    with pytest.raises(DeviceFault, match="nobody can say"):
        home_arm(cell_of(arm, []))
    assert not arm.driven


def asked_about(
    motion: Motion, monkeypatch: pytest.MonkeyPatch, answer: str = "y"
) -> bool:
    monkeypatch.setattr(asking, "terminal", lambda: True)
    monkeypatch.setattr(asking, "ask", lambda question: answer)
    return asking.allow_motion(motion, yes=False)


def a_motion(homing: Homing | None) -> Motion:
    info = DeviceInfo("arm", "gantry", "G", "1", "1", simulated=False)
    return Motion("cell", 3, {"arm": info}, homing)


@pytest.mark.parametrize("homes", [True, False])
def test_the_question_says_what_homing_moves_where(
    homes: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    arm = cast("Arm", Head(TILTED, UP)) if homes else cast("Arm", SimpleNamespace())
    assert asked_about(a_motion(homing_of(arm)), monkeypatch)
    told = " ".join(capsys.readouterr().err.split())
    assert ("X, Y and Z go to their switches" in told) is homes


@pytest.mark.parametrize("answer", ["", "n", "no", "maybe", "yse", "j"])
def test_nothing_but_yes_allows_it(
    answer: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    motion = a_motion(Homing("It moves."))
    assert not asked_about(motion, monkeypatch, answer)


def test_yes_on_the_command_line_cannot_say_where_an_axis_stands(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert asking.allow_motion(a_motion(Homing("It moves.")), yes=True)
    assert "It moves." in capsys.readouterr().err
    with pytest.raises(UsageError, match="A of cell are counted away"):
        asking.allow_motion(a_motion(Homing("It moves.", ("A",))), yes=True)


BELIEVED = ("A 0 (its mark)", "B 12.5 (its mark)")


def test_what_is_believed_is_said_with_whose_word_it_is(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    motion = a_motion(Homing("It moves.", believed=BELIEVED))
    assert asking.allow_motion(motion, yes=True)
    told = " ".join(capsys.readouterr().err.split())
    for axis in BELIEVED:
        assert f"axis {axis}: nothing measures it" in told
    assert told.count("on the word of whoever gave --yes") == 2
    assert asked_about(motion, monkeypatch)
    told = " ".join(capsys.readouterr().err.split())
    assert told.count("on the word of whoever answers y") == 2


@pytest.mark.parametrize("yes", [True, False])
def test_a_device_that_cannot_be_stopped_is_named_before_it_moves(
    yes: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    motion = a_motion(None)
    extra = {"can_stop": "no: it goes on to its end"}
    stopless = replace(motion, infos={"arm": replace(motion.infos["arm"], extra=extra)})
    for one in (motion, stopless):
        if yes:
            asking.allow_motion(one, yes=True)
        else:
            asked_about(one, monkeypatch)
        told = " ".join(capsys.readouterr().err.split())
        said = "arm (G) cannot be stopped at once: it goes on to its end" in told
        assert said is (one is stopless)


def test_what_is_believed_is_kept_with_whose_word_it_is() -> None:
    motion = a_motion(Homing("It moves.", believed=BELIEVED))
    assert motion.believed("the person") == dict.fromkeys(BELIEVED, "the person")
    info = replace(motion.infos["arm"], simulated=True)
    simulated = replace(motion, infos={"arm": info})
    assert set(simulated.believed("the person").values()) == {
        "nobody: everything is simulated"
    }
    assert a_motion(None).believed("the person") == {}


def jogger_of(arm: Slides, simulated: frozenset[str] = frozenset()) -> Jogger:
    steps = {"zoom": 0, "focus": 0, "iris": 0}
    lens = SimpleNamespace(home=lambda timeout_s: SimpleNamespace(steps=steps.copy))
    devices = SimpleNamespace(
        arm=arm, lens=lens, simulated_roles=simulated, stop=lambda: None
    )
    setting = SimpleNamespace(
        arm=SimpleNamespace(
            bodies=bodies_with((400, 400, 0), (500, 500, 100)), clearance_mm=5.0
        ),
        cell=load_cell("virtual"),
    )
    return Jogger(
        cast("Setting", setting),
        cast("CellDevices", devices),
        lambda path, frame: None,
        lambda frame: None,
        0.1,
    )


def test_jogging_homes_only_when_told_twice_what_it_would_move() -> None:
    arm = Head(TILTED, UP)
    jogger = jogger_of(arm)
    with pytest.raises(UsageError, match="switches") as refused:
        jogger.do(Plain("home"))
    assert "again" in refused.value.hint
    assert not arm.homed
    jogger.do(Plain("home"))
    assert arm.homed


def test_a_simulated_arm_is_homed_at_once() -> None:
    arm = Head(TILTED, UP)
    jogger_of(arm, frozenset({"arm"})).do(Plain("home"))
    assert arm.homed
