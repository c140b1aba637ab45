"""What holds before anything real moves, whichever command moves it."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import numpy as np
import pytest

from mvp.cell import home_job
from mvp.cell.engine import CellDevices
from mvp.cell.hardware import check_simulated
from mvp.cell.home_job import home_cell
from mvp.cell.loading import load_cell, load_task
from mvp.cell.session import start_speed
from mvp.devices import Arm, Camera, DeviceInfo, Lens, RealClock
from mvp.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from mvp.cell.plan_job import Setting
    from mvp.geometry import FloatArray


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
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """While a person thinks it over, somebody may move the arm at its pendant."""
    cell = load_cell("virtual")
    task = load_task(cell, None)
    devices: list[CellDevices] = []
    starts: list[FloatArray] = []
    make, search = home_job.devices_for, home_job.find_path

    @contextmanager
    def spied(setting: Setting) -> Iterator[CellDevices]:
        with make(setting) as found:
            devices.append(found)
            yield found

    def spied_search(bodies: object, here: FloatArray, *args: object, **keys: object):
        starts.append(here)
        return search(bodies, here, *args, **keys)  # type: ignore[arg-type]

    def allow(motion: object) -> bool:
        arm = devices[0].arm
        aside = np.add(arm.state().joints, [0.1, 0, 0, 0, 0, 0])
        arm.move_joints(aside.tolist(), timeout_s=60)
        return True

    monkeypatch.setattr(home_job, "devices_for", spied)
    monkeypatch.setattr(home_job, "find_path", spied_search)
    document = home_cell(cell, task, allow)
    assert len(starts) == 2
    assert starts[1][0] - starts[0][0] == pytest.approx(0.1)
    np.testing.assert_allclose(document.joints, cell.home_joints, atol=1e-6)
