"""``mvp-cell check``: every device reached, calibrated, inside its limits."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Literal

from pydantic import Field

from mvp.cell.hardware import check_serials, close_all, info_of, try_open
from mvp.cell.homing import is_homed
from mvp.cell.plan_job import prepare
from mvp.cell.session import devices_for
from mvp.errors import MvpCellError
from mvp.fileedge import FileModel

if TYPE_CHECKING:
    from collections.abc import Callable

    from mvp.cell.engine import CellDevices
    from mvp.cell.loading import LoadedCell, LoadedTask
    from mvp.devices import Device, DeviceInfo

CHECK_SCHEMA: Literal["mvp-cell/check/1"] = "mvp-cell/check/1"


class CheckItem(FileModel):
    """One thing that was checked."""

    name: str
    passed: bool
    detail: str
    hint: str = ""


class CheckDocument(FileModel):
    """All things that were checked; ``passed`` when every one did."""

    schema_: Literal["mvp-cell/check/1"] = Field(default=CHECK_SCHEMA, alias="schema")
    cell: str
    passed: bool
    items: list[CheckItem]


def check_cell(cell: LoadedCell, task: LoadedTask) -> CheckDocument:
    """Open every device at once and ask it where it stands; nothing moves.

    Raises:
        GeometryError, FeatureError, ConfigError, PluginError: the files themselves.
    """
    setting = prepare(cell, task)
    items = [
        CheckItem(name=f"calibration {name}", passed=True, detail=_verdict(cell, name))
        for name in cell.calibrations.sha256
    ]
    with devices_for(setting) as devices:
        items += _check_devices(cell, devices)
    passed = all(item.passed for item in items)
    return CheckDocument(cell=cell.config.name, passed=passed, items=items)


def _check_devices(cell: LoadedCell, devices: CellDevices) -> list[CheckItem]:
    """Reach all at once; every failure is an item."""
    roles: dict[str, Device] = {
        "arm": devices.arm,
        "lens": devices.lens,
        "camera": devices.camera,
    }
    items = []
    try:
        failures = try_open(roles)
        infos = {}
        for role in roles:
            if role in failures:
                items.append(_failure(role, failures[role]))
                continue
            infos[role] = info_of(devices, role)
            items.append(_answered(role, infos[role]))
            state = partial(_STATES[role], devices)
            items.append(_attempt(f"{role} state", state))
        if infos:
            items.append(_attempt("calibrated devices", lambda: _serials(cell, infos)))
    finally:
        unclosed = close_all(roles)
    return items + [_failure(role, error) for role, error in unclosed.items()]


def _verdict(cell: LoadedCell, name: str) -> str:
    model = getattr(cell.calibrations, name)
    reason = cell.calibrations.accepted.get(name)
    accepted = f", accepted: {reason}" if reason else ""
    return f"{model.quality.verdict} of {model.provenance.date}{accepted}"


def _answered(role: str, info: DeviceInfo) -> CheckItem:
    kind = "simulated" if info.simulated else "real"
    detail = f"{info.model}, serial {info.serial}, firmware {info.firmware}, {kind}"
    return CheckItem(name=role, passed=True, detail=detail)


def _failure(name: str, error: Exception) -> CheckItem:
    hint = error.hint if isinstance(error, MvpCellError) else ""
    return CheckItem(name=name, passed=False, detail=str(error), hint=hint)


def _attempt(name: str, check: Callable[[], str]) -> CheckItem:
    try:
        return CheckItem(name=name, passed=True, detail=check())
    except MvpCellError as error:
        return _failure(name, error)


def _arm_state(devices: CellDevices) -> str:
    state = devices.arm.state()
    if not is_homed(devices.arm):
        return "not homed yet (the run will do it)"
    devices.arm.check_joints(state.joints)
    joints = ", ".join(f"{j:.3f}" for j in state.joints)
    return f"{'stands' if state.standing else 'moves'} at {joints}"


def _lens_state(devices: CellDevices) -> str:
    state = devices.lens.state()
    homed = "homed" if state.homed else "not homed yet (the run will do it)"
    return f"{homed}; zoom {state.zoom}, focus {state.focus}, iris {state.iris}"


def _camera_state(devices: CellDevices) -> str:
    low, high = devices.camera.exposure_range_s()
    return f"exposure {low:g} to {high:g} s"


def _serials(cell: LoadedCell, infos: dict[str, DeviceInfo]) -> str:
    check_serials(cell, infos)
    return "calibrations belong to these devices"


_STATES: dict[str, Callable[[CellDevices], str]] = {
    "arm": _arm_state,
    "lens": _lens_state,
    "camera": _camera_state,
}
