"""An arm that rings after its encoders stand: seen in two frames, told, not driven on."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import numpy as np
import pytest

from drivers.virtual_settings import Faults
from drivers.virtual_world import VirtualWorld
from mvp.cell.engine import CellDevices, CellEngine, Exposure
from mvp.cell.stillness import StillCheck
from mvp.devices import Frame
from mvp.errors import DeviceFault
from mvp.testing import VirtualCell, example_belief, virtual_cell

if TYPE_CHECKING:
    from collections.abc import Callable

    from mvp.cell.engine import Verifier
    from mvp.cell.records import Stillness
    from mvp.planning.plan import PlannedView

AWAY = tuple(np.radians([1.0, -89.5, 89.5, -90, -90, 3]).tolist())
STEPS = {"zoom": 500, "focus": 1400, "iris": 300}
EXPOSURE_S = 0.001
CHECK = StillCheck(within_px=0.34, settle_s=0.2)
RINGS = {"ring_mm": 1.0, "ring_hz": 7.0, "ring_decay_s": 0.5}


def standing_arm(**faults: float) -> tuple[VirtualCell, VirtualWorld]:
    """A cell whose arm has just arrived; all devices stay open for nobody else."""
    cell = virtual_cell(belief=example_belief(width_px=320, height_px=256))
    world = cell.world
    assert isinstance(world, VirtualWorld)
    world.inject(Faults.model_validate({"arm": faults}))
    world.begin_arm(np.array(AWAY), speed_fraction=1.0, t_s=cell.clock.now_s())
    return cell, world


def frame_at(world: VirtualWorld, after_s: float, index: int) -> Frame:
    """What is seen so long after the arm's encoders stand."""
    start_s = world.arm_end_s() + after_s
    pixels = world.frame(start_s, EXPOSURE_S, index=index)
    return Frame(pixels, 255, start_s, EXPOSURE_S, start_s + 0.02, index)


def compared(world: VirtualWorld, first_s: float, second_s: float) -> Stillness:
    one, other = frame_at(world, first_s, 0), frame_at(world, second_s, 1)
    return CHECK.of(one, other, standing_s=world.arm_end_s())


def test_a_ringing_arm_is_seen_soon_after_it_stands_and_no_more_when_it_is_still():
    _, world = standing_arm(**RINGS)
    early = compared(world, 0.2, 0.27)
    late = compared(world, 5.0, 5.07)
    assert early.waited_s == pytest.approx(0.2)
    assert early.apart_s == pytest.approx(0.07)
    assert early.shift_px is not None
    assert early.shift_px > 3 * CHECK.within_px
    assert late.shift_px is not None
    assert late.shift_px < CHECK.within_px / 5


def test_a_stiff_arm_is_found_still():
    _, world = standing_arm()
    found = compared(world, 0.0, 0.07)
    assert found.shift_px is not None
    assert found.shift_px < CHECK.within_px / 5
    CHECK.require(found, view="v1", arm="arm")


def test_the_fault_names_arm_view_and_settling_time():
    _, world = standing_arm(**RINGS)
    with pytest.raises(DeviceFault, match=r"arm: is not still at v1.*reported") as told:
        CHECK.require(compared(world, 0.2, 0.27), view="v1", arm="arm")
    assert "[settle] arm_s (now 0.2 s)" in told.value.hint


def test_frames_of_other_brightness_are_not_compared():
    frame = Frame(np.zeros((4, 4), np.uint8), 255, 0.0, 0.01, 0.1, 1)
    assert CHECK.comparable(frame, replace(frame, exposure_s=0.012))
    assert not CHECK.comparable(frame, replace(frame, exposure_s=0.03))
    assert not CHECK.comparable(frame, replace(frame, gain=2.0))


def test_a_picture_that_shows_something_else_is_not_still():
    _, world = standing_arm(ring_mm=150.0, ring_hz=0.25, ring_decay_s=1e6)
    found = compared(world, 0.0, 1.0)  # the part has left the picture
    assert found.likeness < 0.3
    with pytest.raises(DeviceFault, match="changed altogether"):
        CHECK.require(found, view="v1", arm="arm")


class Counting:
    """A camera that counts its pictures."""

    def __init__(self, cell: VirtualCell) -> None:
        self._camera = cell.camera
        self.name = cell.camera.name
        self.taken = 0

    def configure(self, *, exposure_s: float, gain: float) -> None:
        self._camera.configure(exposure_s=exposure_s, gain=gain)

    def capture(self, *, not_before_s: float, timeout_s: float) -> Frame:
        self.taken += 1
        return self._camera.capture(not_before_s=not_before_s, timeout_s=500)


def fixed(view: object, shoot: object) -> Exposure:
    return Exposure(EXPOSURE_S, 1.0, "task")


def metered(view: object, shoot: Callable[[float, float], Frame]) -> Exposure:
    shoot(EXPOSURE_S / 8, 1.0)
    shoot(EXPOSURE_S, 1.0)
    return Exposure(1.1 * EXPOSURE_S, 1.0, "metered")


def engine_of(
    cell: VirtualCell, camera: Counting, rule: object, kept: list[str]
) -> CellEngine:
    devices = CellDevices(cell.arm, cell.lens, cast("object", camera), cell.clock)  # type: ignore[arg-type]

    def keep(view_id: str, frame: Frame) -> tuple[str, str]:
        kept.append(view_id)
        return "images/v1.png", "0" * 64

    return CellEngine(
        devices,
        arrived=np.full(6, 1e-3),
        settle_s=(0.2, 0.1),
        preflight=lambda: None,
        route=lambda start, view: [view.joints_rad],
        exposure=rule,  # type: ignore[arg-type]
        store=keep,
        verifier=cast("Verifier", None),
        still=CHECK,
    )


def view() -> PlannedView:
    steps = SimpleNamespace(**STEPS, model_dump=lambda: STEPS)
    found = SimpleNamespace(id="v1", joints_rad=list(AWAY), lens_steps=steps)
    return cast("PlannedView", found)


@pytest.mark.parametrize(("rule", "pictures"), [(fixed, 2), (metered, 3)])
def test_the_check_costs_one_picture_and_none_where_the_exposure_is_metered(
    rule, pictures
):
    cell = virtual_cell(belief=example_belief(width_px=320, height_px=256))
    camera, kept = Counting(cell), []
    with cell.arm, cell.lens, cell.camera:
        engine = engine_of(cell, camera, rule, kept)
        engine.move(view())
        engine.adjust(view())
        captured = engine.capture(view())
    assert camera.taken == pictures
    assert kept == ["v1"]
    assert captured.stillness is not None
    assert captured.stillness.shift_px is not None
    assert captured.stillness.shift_px < CHECK.within_px / 5


def test_of_an_arm_that_is_not_still_no_picture_is_kept():
    """It swings so slowly and so far that it creeps, 10 mm/s whenever it is looked at."""
    creeps = {"ring_mm": 1.6e4, "ring_hz": 1e-4, "ring_decay_s": 1e6}
    cell = virtual_cell(
        belief=example_belief(width_px=320, height_px=256), clock_speed=5.0
    )
    world = cell.world
    assert isinstance(world, VirtualWorld)
    camera, kept = Counting(cell), []
    with cell.arm, cell.lens, cell.camera:
        engine = engine_of(cell, camera, fixed, kept)
        engine.adjust(view())
        engine.move(view())
        world.inject(Faults.model_validate({"arm": creeps}))
        world.draw_ahead()
        with pytest.raises(DeviceFault, match="is not still at v1"):
            engine.capture(view())
    assert kept == []
