"""What holds before anything real moves, whichever command moves it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import numpy as np
import pytest

from mvp.cell import home_job
from mvp.cell.arrival import arrival_tolerance
from mvp.cell.engine import CellDevices, CellEngine
from mvp.cell.hardware import check_simulated
from mvp.cell.home_job import home_cell
from mvp.cell.loading import load_cell, load_task
from mvp.cell.session import start_speed
from mvp.devices import Arm, ArmState, Camera, DeviceInfo, Lens, RealClock
from mvp.errors import ConfigError, DeviceFault

if TYPE_CHECKING:
    from mvp.cell.engine import ExposureRule, PictureStore, Verifier
    from mvp.cell.plan_job import Setting
    from mvp.geometry import FloatArray
    from mvp.planning.plan import PlannedView


def infos(*, arm: bool, lens: bool = True) -> dict[str, DeviceInfo]:
    said = {"arm": arm, "lens": lens, "camera": True}
    return {
        role: DeviceInfo(role, "x", f"X-{role}", "1", "1", simulated=simulated)
        for role, simulated in said.items()
    }


@pytest.mark.parametrize(("arm", "lens"), [(False, True), (True, False)])
def test_real_motors_are_not_moved_in_a_cell_that_calls_itself_simulated(
    arm: bool, lens: bool
) -> None:
    cell = load_cell("virtual")
    check_simulated(cell, infos(arm=True))
    with pytest.raises(ConfigError, match="real motors answer") as caught:
        check_simulated(cell, infos(arm=arm, lens=lens))
    assert "cell.toml:6" in str(caught.value)
    assert ("X-arm" in str(caught.value)) == (not arm)


def test_a_real_cell_may_have_real_motors() -> None:
    cell = load_cell("virtual")
    config = cell.config.model_copy(update={"simulated": False, "world": None})
    check_simulated(replace(cell, config=config), infos(arm=False, lens=False))


@pytest.mark.parametrize(
    ("simulated", "roles", "full"),
    [(True, (), True), (False, (), False), (True, ("arm", "lens"), False)],
)
def test_only_an_arm_in_the_computer_alone_begins_at_full_speed(
    simulated: bool, roles: tuple[str, ...], full: bool
) -> None:
    """A world in the cell file does not make the arm a virtual one."""
    setting = cast("Setting", SimpleNamespace(cell=load_cell("virtual")))
    devices = CellDevices(
        cast("Arm", None),
        cast("Lens", None),
        cast("Camera", None),
        RealClock(),
        simulated_roles=frozenset(roles),
    )
    share = start_speed(setting, devices, infos(arm=simulated))
    assert share == (1.0 if full else setting.cell.config.motion.start_speed_fraction)


def test_the_way_home_is_looked_for_from_where_the_arm_stands_then(
    monkeypatch: pytest.MonkeyPatch, devices_at_home: list[CellDevices]
) -> None:
    """While a person thinks it over, somebody may move the arm at its pendant."""
    cell = load_cell("virtual")
    task = load_task(cell, None)
    starts: list[FloatArray] = []
    search = home_job.find_path

    def spied_search(bodies: object, here: FloatArray, *args: object, **keys: object):
        starts.append(here)
        return search(bodies, here, *args, **keys)  # type: ignore[arg-type]

    def allow(motion: object) -> bool:
        arm = devices_at_home[0].arm
        aside = np.add(arm.state().joints, [0.1, 0, 0, 0, 0, 0])
        arm.move_joints(aside.tolist(), timeout_s=60)
        return True

    monkeypatch.setattr(home_job, "find_path", spied_search)
    document = home_cell(cell, task, allow)
    assert len(starts) == 2
    assert starts[1][0] - starts[0][0] == pytest.approx(0.1)
    np.testing.assert_allclose(document.joints, cell.home_joints, atol=1e-6)


class Steps:
    """A gantry arm that stands on whole steps, so far from its target."""

    name = "arm"

    def __init__(self, off: list[float]) -> None:
        self.off = off

    def state(self) -> ArmState:
        return ArmState((0.0,) * 5, np.eye(4), True, 0.0)

    def duration_s(self, *args: object, **keys: object) -> float:
        return 1.0

    def move_joints(self, target: list[float], **keys: object) -> ArmState:
        return ArmState(tuple(np.add(target, self.off)), np.eye(4), True, 0.0)


@pytest.mark.parametrize(
    ("off", "good"),
    [
        ([0.00625, 0, 0, 0, 0], True),  # 80 steps/mm
        ([0, 0, 0.05, 0.001, 0], True),
        ([0.2, 0, 0, 0, 0], False),
        ([0, 0, 0, 0.005, 0], False),
    ],
)
def test_whole_steps_of_a_slide_are_no_fault_and_a_missed_place_is_one(
    off: list[float], good: bool
) -> None:
    devices = CellDevices(
        cast("Arm", Steps(off)), cast("Lens", None), cast("Camera", None), RealClock()
    )
    view = cast("PlannedView", SimpleNamespace(id="v1", joints_rad=[1, 2, 3, 0.1, 0]))
    engine = CellEngine(
        devices,
        arrived=arrival_tolerance(["mm", "mm", "mm", "rad", "rad"]),
        settle_s=(0, 0),
        preflight=lambda: None,
        route=lambda start, view: [view.joints_rad],
        exposure=cast("ExposureRule", None),
        store=cast("PictureStore", None),
        verifier=cast("Verifier", None),
    )
    if good:
        engine.move(view)
    else:
        with pytest.raises(DeviceFault, match="does not stand at v1"):
            engine.move(view)
