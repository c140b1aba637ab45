"""Home arm and lens, and bring the arm home along a checked path."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np
from pydantic import Field

from mvp.cell.beside import call_beside
from mvp.cell.hardware import check_simulated, opened
from mvp.cell.homing import HOMING_S, home_arm, homing_of, is_homed
from mvp.cell.in_use import using_devices
from mvp.cell.plan_job import Setting, prepare
from mvp.cell.progress import Tell, unheard
from mvp.cell.session import Motion, devices_for, start_speed
from mvp.cell.standstill import UnderWay, stopped_on_error
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
    """Where arm and lens stand now.

    ``believed_axes``: those that nothing measures, with the place where each was taken
    to be before homing, and by whose word.
    """

    schema_: Literal["mvp-cell/home/1"] = Field(default=HOME_SCHEMA, alias="schema")
    cell: str
    joints: list[float]
    lens_steps: dict[str, int]
    believed_axes: dict[str, str] = Field(default_factory=dict)


def home_cell(
    cell: LoadedCell,
    task: LoadedTask,
    allow: Callable[[Motion], bool],
    tell: Tell = unheard,
    *,
    word: str = "the calling program",
) -> HomeDocument:
    """Move both home; on Ctrl-C both are stopped.

    An arm that knows where it is moves only when there is a clear path; another one
    drives to its references first. A real arm moves at the speed that a run begins with.

    Args:
        cell: whose arm and lens.
        task: what stands in it.
        allow: asked once before the first motion.
        tell: hears what takes time.
        word: whose word ``allow`` is, for axes that nothing measures.

    Raises:
        ConfigError: the cell says that it is simulated, and is not.
        DeviceError: a device failed; it says what stands and what may still be moving.
        InfeasibleError: no clear path home.
        RecordError: another command uses the devices.
        StoppedByOperator: a person did not allow it, or stopped it.
    """
    with ExitStack() as stack:
        stack.enter_context(using_devices(cell, who="home"))
        tell(f"loading {task.part_file.name}")
        setting = prepare(cell, task)
        devices = stack.enter_context(devices_for(setting, tell))
        tell("connecting to arm, lens and camera")
        infos = stack.enter_context(opened(devices))
        check_simulated(cell, infos)
        homing = homing_of(devices.arm)
        if homing is None:
            tell("looking for a clear way home")
            _path_home(setting, devices)
        motion = Motion(cell.config.name, 1, infos, homing, errand="move home")
        if not allow(motion):
            raise StoppedByOperator("the operator did not allow the arm to move")
        going = _Going(setting, devices, start_speed(setting, devices, infos), tell)
        with stopped_on_error(devices, going.under_way, tell):
            arm, lens = call_beside(going.home, devices.stop)
    return _document(cell, arm, lens, motion.believed(word))


@dataclass(eq=False)
class _Going:
    """References, lens, arm; the path is looked for from where the arm stands then."""

    setting: Setting
    devices: CellDevices
    share: float
    tell: Tell
    under_way: UnderWay = field(default_factory=UnderWay)

    def home(self) -> tuple[ArmState, LensState]:
        """All of it; returns where both stand."""
        arm, lens = self.devices.arm, self.devices.lens
        if not is_homed(arm):
            self.tell("homing the arm")
        with self.under_way.moving("the arm, homing", HOMING_S):
            bodies, clearance_mm = (
                self.setting.arm.bodies,
                self.setting.arm.clearance_mm,
            )
            home_arm(self.devices, bodies, clearance_mm)
        self.tell("homing the lens")
        with self.under_way.moving("the lens, homing", _LENS_TIMEOUT_S):
            reached = lens.home(timeout_s=_LENS_TIMEOUT_S)
        path = _path_home(self.setting, self.devices)
        self.tell("moving the arm home")
        return self._move(path), reached

    def _move(self, path: FloatArray) -> ArmState:
        arm, share = self.devices.arm, self.share
        state = arm.state()
        for target in path.tolist():
            expected_s = arm.duration_s(state.joints, target, speed_fraction=share)
            timeout_s = 2 * expected_s + _ARM_SPARE_S
            with self.under_way.moving("the arm on its way home", timeout_s):
                state = arm.move_joints(
                    target, speed_fraction=share, timeout_s=timeout_s
                )
        return state


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


def _document(
    cell: LoadedCell, arm: ArmState, lens: LensState, believed: dict[str, str]
) -> HomeDocument:
    return HomeDocument(
        cell=cell.config.name,
        joints=[float(j) for j in arm.joints],
        lens_steps=lens.steps(),
        believed_axes=believed,
    )
