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
from mvp.cell.homing import HOMING_S, is_homed
from mvp.cell.in_use import using_devices
from mvp.cell.plan_job import prepare
from mvp.cell.progress import Tell, unheard
from mvp.cell.session import devices_for
from mvp.cell.standstill import UnderWay, stopped_on_error
from mvp.devices import Arm, Lens, Recoverable
from mvp.errors import DeviceError, StoppedByOperator
from mvp.fileedge import FileModel

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from mvp.cell.loading import LoadedCell, LoadedTask
    from mvp.devices import Device, RecoveryStep

_BY_HAND = {
    "arm": "bring it back at its own panel, then `mvp-cell check CELL`",
    "lens": "switch its controller off and on, then `mvp-cell home CELL`",
    "camera": "unplug it and plug it in again, then `mvp-cell check CELL`",
}
_HOMES = "`mvp-cell home CELL` homes it; a run does so before the first view"
_LOG = logging.getLogger(__name__)
RECOVER_SCHEMA: Literal["mvp-cell/recover/1"] = "mvp-cell/recover/1"


class RecoveredStep(FileModel):
    """One step that was done, and what it reached."""

    text: str
    reached: str


class RecoveredDevice(FileModel):
    """One device after the walk.

    ``recoverable``: it knows a way back of its own. ``ready``: nothing has to be done by
    hand; ``detail`` says how it is and ``hint`` what to do about it.
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
    """Walk through every device that knows a way back, and ask all how they are.

    Raises:
        DeviceError: a step did not have its effect; it says what stands.
        RecordError: another command uses the devices.
        StoppedByOperator: a person did not agree to a step, or stopped it.
    """
    with ExitStack() as stack:
        stack.enter_context(using_devices(cell, who="recover"))
        tell(f"loading {task.part_file.name}")
        setting = prepare(cell, task)
        devices = stack.enter_context(devices_for(setting, tell))
        stack.enter_context(devices_held(devices.by_role))
        stack.callback(close_all, devices.by_role)
        under_way = UnderWay()
        stack.enter_context(stopped_on_error(devices, under_way, tell))
        done = []
        for role, device in devices.by_role.items():
            tell(f"asking the {role}")
            done.append(recover_device(device, guide, under_way))
    return RecoverDocument(cell=cell.config.name, devices=done)


def recover_device(
    device: Device, guide: Guide, under_way: UnderWay | None = None
) -> RecoveredDevice:
    """Walk through one device, if it knows a way back, and ask how it is.

    Args:
        device: need not be open.
        guide: the person.
        under_way: told what a step may be moving.

    Raises:
        DeviceError, StoppedByOperator: as for ``recover_cell``.
    """
    knows_way = isinstance(device, Recoverable)
    done: list[RecoveredStep] = []
    try:
        for step in _asked(device):
            _confirm(device, step, guide)
            with (under_way or UnderWay()).moving(f"the {device.role}", HOMING_S):
                reached = call_beside(step.act, lambda: device.stop())
            _LOG.info("%s: recovery: %s", device.name, reached)
            guide.tell(device.name, reached)
            done.append(RecoveredStep(text=step.text, reached=reached))
        ready, detail, hint = _how_it_is(device, walked=bool(done))
    except _CannotBeAsked as error:
        why = error.why
        ready, detail, hint = False, why.detail, why.hint or _BY_HAND[device.role]
    return RecoveredDevice(
        name=device.name,
        recoverable=knows_way,
        ready=ready,
        detail=detail,
        hint=hint,
        steps=done,
    )


class _CannotBeAsked(Exception):
    """No answer; the other devices are asked nevertheless."""

    def __init__(self, why: DeviceError) -> None:
        super().__init__(why.detail)
        self.why = why


def _asked(device: Device) -> Iterator[RecoveryStep]:
    """The steps of a device that knows some.

    Raises:
        _CannotBeAsked: it does not say what is the matter.
    """
    if not isinstance(device, Recoverable):
        return
    steps = device.recovery()
    while True:
        try:
            step = next(steps, None)
        except DeviceError as error:
            raise _CannotBeAsked(error) from error
        if step is None:
            return
        yield step


def _confirm(device: Device, step: RecoveryStep, guide: Guide) -> None:
    if not guide.agree(device.name, step):
        raise StoppedByOperator(
            f"the operator did not agree to this step of the {device.name}: {step.text}",
            hint="`mvp-cell recover CELL` goes on from where it is",
            where=device.name,
        )


def _how_it_is(device: Device, *, walked: bool) -> tuple[bool, str, str]:
    """Whether a run could begin, how the device is, and what to do about it.

    Raises:
        _CannotBeAsked: it does not answer.
    """
    try:
        device.open()
        if isinstance(device, Arm):
            fault = device.state().fault
            if fault:
                return False, fault, _BY_HAND["arm"]
            if not is_homed(device):
                return True, "answers, but is not homed", _HOMES
        if isinstance(device, Lens) and not device.state().homed:
            return True, "answers; not homed", _HOMES
    except DeviceError as error:
        raise _CannotBeAsked(error) from error
    return True, "ready again" if walked else "ready, nothing to do", ""
