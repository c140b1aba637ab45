"""Lead the devices of a cell back from a fault, one confirmed step after the other."""

from __future__ import annotations

import logging
from contextlib import ExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from pydantic import Field

from mvp.cell.beside import call_beside
from mvp.cell.device_locks import devices_held
from mvp.cell.hardware import close_all
from mvp.cell.in_use import using_devices
from mvp.cell.plan_job import prepare
from mvp.cell.progress import Tell, unheard
from mvp.cell.session import devices_for
from mvp.devices import Arm, Lens, Recoverable
from mvp.errors import DeviceError, StoppedByOperator
from mvp.fileedge import FileModel

if TYPE_CHECKING:
    from collections.abc import Callable

    from mvp.cell.loading import LoadedCell, LoadedTask
    from mvp.devices import Device, RecoveryStep

_BY_HAND = {
    "arm": "bring it back at its own panel, then `mvp-cell check CELL`",
    "lens": "switch its controller off and on, then `mvp-cell home CELL`",
    "camera": "unplug it and plug it in again, then `mvp-cell check CELL`",
}
_LOG = logging.getLogger(__name__)
RECOVER_SCHEMA: Literal["mvp-cell/recover/1"] = "mvp-cell/recover/1"


class RecoveredStep(FileModel):
    """One step that was done, and what it reached."""

    text: str
    reached: str


class RecoveredDevice(FileModel):
    """One device after the walk.

    ``recoverable``: it knows a way back of its own. ``ready``: nothing is left to do by
    hand; otherwise ``detail`` says what is the matter and ``hint`` what to do.
    """

    name: str
    recoverable: bool
    ready: bool
    detail: str
    hint: str = ""
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


def recover_cell(
    cell: LoadedCell, task: LoadedTask, guide: Guide, tell: Tell = unheard
) -> RecoverDocument:
    """Walk through every device that knows a way back, and ask the others how they are.

    Raises:
        DeviceError: a step did not have its effect.
        RecordError: another command uses the devices.
        StoppedByOperator: a person did not agree to a step.
    """
    with ExitStack() as stack:
        stack.enter_context(using_devices(cell, who="recover"))
        tell(f"loading {task.part_file.name}")
        setting = prepare(cell, task)
        built = stack.enter_context(devices_for(setting, tell))
        devices: dict[str, Device] = {
            "arm": built.arm,
            "lens": built.lens,
            "camera": built.camera,
        }
        stack.enter_context(devices_held(devices))
        stack.callback(close_all, devices)
        done = []
        for role, device in devices.items():
            tell(f"asking the {role}")
            done.append(recover_device(device, guide))
    return RecoverDocument(cell=cell.config.name, devices=done)


def recover_device(device: Device, guide: Guide) -> RecoveredDevice:
    """Walk through one device; one that knows no way back is only asked how it is.

    Raises:
        DeviceError, StoppedByOperator: as for ``recover_cell``.
    """
    if not isinstance(device, Recoverable):
        return _looked_at(device)
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
    said = "ready again" if done else "ready, there was nothing to do"
    return RecoveredDevice(
        name=device.name, recoverable=True, ready=True, detail=said, steps=done
    )


def _looked_at(device: Device) -> RecoveredDevice:
    """How a device is that can only be brought back by hand."""
    try:
        device.open()
        detail, ready = _state_of(device)
        hint = "" if ready else _BY_HAND[device.role]
    except DeviceError as error:
        detail, ready = error.detail, False
        hint = error.hint or _BY_HAND[device.role]
    return RecoveredDevice(
        name=device.name, recoverable=False, ready=ready, detail=detail, hint=hint
    )


def _state_of(device: Device) -> tuple[str, bool]:
    """In words, and whether a run could begin."""
    if isinstance(device, Arm):
        fault = device.state().fault
        return (fault, False) if fault else ("answers, and reports no fault", True)
    if isinstance(device, Lens) and not device.state().homed:
        return "answers; not homed, the next run homes it before it moves it", True
    return "answers, nothing to do", True
