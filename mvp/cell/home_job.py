"""Home arm and lens, and bring the arm home along a checked path."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING, Literal

import numpy as np
from pydantic import Field

from mvp.cell.beside import call_beside
from mvp.cell.hardware import check_simulated, opened
from mvp.cell.homing import home_arm, is_homed
from mvp.cell.lock import cell_lock
from mvp.cell.plan_job import Setting, prepare
from mvp.cell.run_job import lock_of
from mvp.cell.session import Motion, devices_for, start_speed
from mvp.errors import InfeasibleError, StoppedByOperator
from mvp.fileedge import FileModel
from mvp.kinematics import NoPath, find_path

if TYPE_CHECKING:
    from collections.abc import Callable

    from mvp.cell.engine import CellDevices
    from mvp.cell.loading import LoadedCell, LoadedTask
    from mvp.devices import ArmState, LensState
    from mvp.geometry import FloatArray

HOME_SCHEMA: Literal["mvp-cell/home/1"] = "mvp-cell/home/1"
_LENS_TIMEOUT_S = 180.0
_ARM_SPARE_S = 15.0


class HomeDocument(FileModel):
    """Where arm and lens stand now."""

    schema_: Literal["mvp-cell/home/1"] = Field(default=HOME_SCHEMA, alias="schema")
    cell: str
    joints: list[float]
    lens_steps: dict[str, int]


def home_cell(
    cell: LoadedCell, task: LoadedTask, allow: Callable[[Motion], bool]
) -> HomeDocument:
    """Move both home; on Ctrl-C both are stopped.

    An arm that knows where it is moves only when there is a clear path; another one
    drives to its references first. A real arm moves at the speed that a run begins with.

    Raises:
        ConfigError: the cell says that it is simulated, and is not.
        DeviceError: a device failed.
        InfeasibleError: no clear path home.
        StoppedByOperator: a person did not allow it.
    """
    setting = prepare(cell, task)
    with ExitStack() as stack:
        if not cell.config.simulated:
            lock = lock_of(setting, cell.folder)
            stack.enter_context(cell_lock(lock, run_id="home"))
        devices = stack.enter_context(devices_for(setting))
        infos = stack.enter_context(opened(devices))
        check_simulated(cell, infos)
        homes = not is_homed(devices.arm)
        if not homes:
            _path_home(setting, devices)
        if not allow(Motion(cell.config.name, 1, infos, homes=homes)):
            raise StoppedByOperator("the operator did not allow the arm to move")
        share = start_speed(setting, devices, infos)
        try:
            arm, lens = call_beside(
                lambda: _go_home(setting, devices, share), devices.stop
            )
        except BaseException:
            devices.stop()
            raise
    return _document(cell, arm, lens)


def _go_home(
    setting: Setting, devices: CellDevices, share: float
) -> tuple[ArmState, LensState]:
    """References, lens, arm; the path is looked for from where the arm stands then."""
    home_arm(devices)
    lens = devices.lens.home(timeout_s=_LENS_TIMEOUT_S)
    return _move(devices, _path_home(setting, devices), share), lens


def _path_home(setting: Setting, devices: CellDevices) -> FloatArray:
    home = np.asarray(setting.cell.home_joints, np.float64)
    here = np.asarray(devices.arm.state().joints, np.float64)
    path = find_path(
        setting.arm.bodies, here, home, required_mm=setting.arm.clearance_mm
    )
    if isinstance(path, NoPath):
        raise InfeasibleError(
            f"no clear way home: {path.reason}",
            hint="move the arm by hand to a free place first",
            where="arm",
        )
    return np.asarray(path.waypoints[1:])


def _move(devices: CellDevices, path: FloatArray, share: float) -> ArmState:
    arm = devices.arm
    state = arm.state()
    for target in path.tolist():
        expected_s = arm.duration_s(state.joints, target, speed_fraction=share)
        timeout_s = 2 * expected_s + _ARM_SPARE_S
        state = arm.move_joints(target, speed_fraction=share, timeout_s=timeout_s)
    return state


def _document(cell: LoadedCell, arm: ArmState, lens: LensState) -> HomeDocument:
    return HomeDocument(
        cell=cell.config.name,
        joints=[float(j) for j in arm.joints],
        lens_steps=lens.steps(),
    )
