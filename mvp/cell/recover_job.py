"""Lead the devices of a cell back from a fault, one confirmed step after the other."""

from __future__ import annotations

import logging
from contextlib import ExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from pydantic import Field

from mvp.cell.beside import call_beside
from mvp.cell.hardware import close_all
from mvp.cell.lock import cell_lock
from mvp.cell.plan_job import prepare
from mvp.cell.run_job import lock_of
from mvp.cell.session import devices_for
from mvp.devices import Recoverable
from mvp.errors import StoppedByOperator
from mvp.fileedge import FileModel

if TYPE_CHECKING:
    from collections.abc import Callable

    from mvp.cell.loading import LoadedCell, LoadedTask
    from mvp.devices import Device, RecoveryStep

_LOG = logging.getLogger(__name__)
RECOVER_SCHEMA: Literal["mvp-cell/recover/1"] = "mvp-cell/recover/1"


class RecoveredStep(FileModel):
    """One step that was done, and what it reached."""

    text: str
    reached: str


class RecoveredDevice(FileModel):
    """One device: whether it knows a way back, and what was done."""

    name: str
    recoverable: bool
    steps: list[RecoveredStep] = Field(default_factory=list)


class RecoverDocument(FileModel):
    """Every device of the cell after the walk."""

    schema_: Literal["mvp-cell/recover/1"] = Field(
        default=RECOVER_SCHEMA, alias="schema"
    )
    cell: str
    devices: list[RecoveredDevice]


@dataclass(frozen=True)
class Guide:
    """The person's side of a recovery.

    Attributes:
        agree: asked before each step, with the device's name; False ends the walk.
        tell: told what each step has reached.
    """

    agree: Callable[[str, RecoveryStep], bool]
    tell: Callable[[str, str], None]


def recover_cell(cell: LoadedCell, task: LoadedTask, guide: Guide) -> RecoverDocument:
    """Walk through every device that knows a way back; the others are named.

    Raises:
        DeviceError: a step did not have its effect.
        StoppedByOperator: a person did not agree to a step.
    """
    setting = prepare(cell, task)
    with ExitStack() as stack:
        if not cell.config.simulated:
            lock = lock_of(setting, cell.folder)
            stack.enter_context(cell_lock(lock, run_id="recover"))
        built = stack.enter_context(devices_for(setting))
        devices: dict[str, Device] = {
            "arm": built.arm,
            "lens": built.lens,
            "camera": built.camera,
        }
        stack.callback(close_all, devices)
        done = [recover_device(device, guide) for device in devices.values()]
    return RecoverDocument(cell=cell.config.name, devices=done)


def recover_device(device: Device, guide: Guide) -> RecoveredDevice:
    """Walk through one device.

    Raises:
        DeviceError, StoppedByOperator: as for ``recover_cell``.
    """
    if not isinstance(device, Recoverable):
        return RecoveredDevice(name=device.name, recoverable=False)
    done = []
    for step in device.recovery():
        if not guide.agree(device.name, step):
            raise StoppedByOperator(
                f"the operator did not agree to this step of the {device.name}: "
                f"{step.text}",
                hint="`mvp-cell recover CELL` goes on from where it is",
                where=device.name,
            )
        reached = call_beside(step.act, lambda: device.stop())
        _LOG.info("%s: recovery: %s", device.name, reached)
        guide.tell(device.name, reached)
        done.append(RecoveredStep(text=step.text, reached=reached))
    return RecoveredDevice(name=device.name, recoverable=True, steps=done)
