"""An alarm of the gantry while only the lens moves: seen and named before it matters."""

from __future__ import annotations

import threading
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pytest

from mvp.cell.engine import CellDevices, CellEngine, Exposure
from mvp.devices import Frame, LensState, RealClock
from mvp.errors import DeviceError, DeviceFault
from mvp.testing import refuses, wait_until

if TYPE_CHECKING:
    from collections.abc import Callable

    from mvp.planning.plan import PlannedView

STEPS = {"zoom": 1, "focus": 2, "iris": 3}
FIRMWARES = pytest.mark.parametrize("firmware", ["grblhal", "fluidnc"])


class SlowLens:
    """Moves until it is let go."""

    name = "lens"

    def __init__(self) -> None:
        self.moves = threading.Event()
        self.over = threading.Event()

    def state(self) -> LensState:
        return LensState(**STEPS, homed=True, standing=True)

    def move_steps(self, **asked: object) -> LensState:
        self.moves.set()
        self.over.wait(20)
        return self.state()

    def stop(self) -> None:
        self.over.set()


class Camera:
    """Takes grey pictures."""

    name = "camera"

    def configure(self, *, exposure_s: float, gain: float = 1.0) -> None: ...

    def capture(self, *, not_before_s: float, timeout_s: float) -> Frame:
        grey = np.full((4, 4), 7, np.uint8)
        return Frame(grey, 255, not_before_s, 0.01, not_before_s + 0.02, 1)

    def stop(self) -> None: ...


@dataclass
class Steps:
    zoom: int = 1
    focus: int = 2
    iris: int = 3

    def model_dump(self) -> dict[str, int]:
        return STEPS


def view(name: str, joints: tuple[float, ...]) -> PlannedView:
    found = SimpleNamespace(id=name, joints_rad=joints, lens_steps=Steps())
    return cast("PlannedView", found)


def engine_of(arm: Any, lens: SlowLens, kept: list[str]) -> CellEngine:
    devices = CellDevices(arm, cast("Any", lens), cast("Any", Camera()), RealClock())

    def keep(name: str, frame: Frame) -> tuple[str, str]:
        kept.append(name)
        return name, ""

    return CellEngine(
        devices,
        arrived=np.array([0.1, 0.1, 0.1, 0.01, 0.01]),
        settle_s=(0.0, 0.0),
        preflight=lambda: None,
        route=lambda start, goal: [goal.joints_rad],
        exposure=lambda goal, shoot: Exposure(0.01, 1.0, "task"),
        store=keep,
        verifier=cast("Any", None),
    )


@FIRMWARES
def test_a_gantry_alarm_while_only_the_lens_moves_ends_the_view(
    gantry_bench: Callable[..., Any], firmware: str
) -> None:
    bench = gantry_bench(firmware, hard_limits=True)
    arm, lens = bench.homed(), SlowLens()
    kept: list[str] = []
    engine = engine_of(arm, lens, kept)
    first, second = view("v1", bench.far), view("v2", bench.start)
    engine.move(first)
    adjusting = threading.Thread(target=engine.adjust, args=(first,))
    adjusting.start()
    wait_until(lens.moves.is_set, "the lens moves")
    bench.do("press", axis="Y")
    wait_until(lambda: not arm.homed, "the driver has heard of the alarm")
    lens.over.set()
    adjusting.join(20)
    sent = len(bench.tap.sent)
    error = refuses(DeviceFault, lambda: engine.capture(first))
    assert error.device == "arm"
    assert "alarm 1" in error.message
    assert "v1" in error.message
    assert "recover" in error.hint
    assert kept == [], "a picture from an arm that may have been pushed does not count"
    refuses(DeviceError, lambda: engine.move(second))
    assert b"G53" not in b"".join(bench.tap.sent[sent:])


@FIRMWARES
def test_an_alarm_at_rest_is_part_of_the_state(
    gantry_bench: Callable[..., Any], firmware: str
) -> None:
    bench = gantry_bench(firmware, hard_limits=True)
    arm = bench.homed()
    assert arm.state().fault == ""
    bench.do("press", axis="X")
    wait_until(lambda: not arm.homed, "the driver has heard of the alarm")
    assert "alarm 1" in _trouble(arm)
    bench.do("let_go", axis="X")
    for step in arm.recovery():
        step.act()
    assert replace(arm.state(), t_monotonic_s=0.0).fault == ""


def _trouble(arm: Any) -> str:
    """Controllers that fall silent in an alarm make it an error."""
    try:
        return str(arm.state().fault)
    except DeviceFault as error:
        return error.message
