"""Open every device and ask it where it stands, all at once; nothing moves."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from mvp.cell.calibrated_devices import device_objections
from mvp.cell.calibration_items import CALIBRATED_DEVICES, objection_items
from mvp.cell.check_items import (
    CheckedDevice,
    CheckedFrame,
    CheckItem,
    doubtful,
    failed,
    failure,
    from_findings,
    good,
)
from mvp.cell.hardware import close_all, info_of
from mvp.cell.homing import is_homed
from mvp.devices import AXES, HasDoubts, Homable, cannot_stop
from mvp.errors import CalibrationError, MvpCellError
from mvp.optics import LensTable, achievable_words

if TYPE_CHECKING:
    from collections.abc import Mapping

    from mvp.cell.engine import CellDevices
    from mvp.cell.plan_job import Setting
    from mvp.devices import Arm, ArmState, Device, DeviceInfo, Frame, Role

_STALE_S = 1.0
_EXPOSURE_S = 0.01
_FRAME_S = 10.0
_ROLES: tuple[Role, ...] = ("arm", "lens", "camera")


@dataclass
class Answers:
    """What one device said.

    Attributes:
        items: in the order in which it was asked.
        info: who it is; None when it did not answer.
        measured: further keys of its ``CheckedDevice``.
    """

    items: list[CheckItem] = field(default_factory=list)
    info: DeviceInfo | None = None
    measured: dict[str, object] = field(default_factory=dict)


def check_devices(
    setting: Setting, devices: CellDevices
) -> tuple[list[CheckItem], list[CheckedDevice]]:
    """Ask all devices in parallel; every failure is an item."""
    everyone: dict[str, Device] = {role: getattr(devices, role) for role in _ROLES}
    try:
        with ThreadPoolExecutor(len(_ROLES)) as pool:
            asked = [pool.submit(_ask, setting, devices, role) for role in _ROLES]
            answers = dict(zip(_ROLES, (one.result() for one in asked), strict=True))
        infos: dict[str, DeviceInfo] = {
            role: one.info for role, one in answers.items() if one.info is not None
        }
        calibrated = _calibrated(setting, devices, infos)
    finally:
        unclosed = close_all(everyone)
    items = [item for role in _ROLES for item in answers[role].items]
    items += calibrated
    items += [failure(role, error) for role, error in unclosed.items()]
    return items, [_checked(r, answers[r]) for r in _ROLES if r in infos]


def _ask(setting: Setting, devices: CellDevices, role: Role) -> Answers:
    """Open one device and put every question to it; raises nothing."""
    answers = Answers()
    try:
        getattr(devices, role).open()
        answers.info = info_of(devices, role)
        answers.items.append(_who(role, answers.info))
        answers.items += _doubts(role, getattr(devices, role), answers.info)
    except Exception as error:
        answers.items.append(failure(role, error))
        return answers
    questions = {"arm": _arm, "lens": _lens, "camera": _camera}[role]
    try:
        questions(setting, devices, answers)
    except Exception as error:
        answers.items.append(failure(f"{role} state", error))
    return answers


def _who(role: str, info: DeviceInfo) -> CheckItem:
    kind = "simulated" if info.simulated else "real"
    return good(
        role,
        f"{info.model}, serial {info.serial or '-'}, firmware {info.firmware}, {kind}",
    )


def _doubts(role: Role, device: Device, info: DeviceInfo) -> list[CheckItem]:
    """What it says against itself."""
    items = from_findings(
        role, device.doubts() if isinstance(device, HasDoubts) else ()
    )
    if why := cannot_stop(info):
        items.append(
            doubtful(
                f"{role} stop",
                f"cannot be stopped at once: {why}",
                "leave no hand near it while it moves; the emergency stop is what stops it",
            )
        )
    return items


def _checked(role: Role, answers: Answers) -> CheckedDevice:
    info = answers.info
    if info is None:
        raise ValueError(f"{role} did not answer")
    return CheckedDevice.model_validate(
        {
            "role": role,
            "driver": info.driver,
            "model": info.model,
            "serial": info.serial,
            "firmware": info.firmware,
            "simulated": info.simulated,
            "extra": info.extra,
            **answers.measured,
        }
    )


def _calibrated(
    setting: Setting, devices: CellDevices, infos: Mapping[str, DeviceInfo]
) -> list[CheckItem]:
    """Whether the calibrations are for these devices, as they are now."""
    if not infos:
        return []
    try:
        objections = device_objections(setting.cell, devices, infos)
    except Exception as error:
        return [failure(CALIBRATED_DEVICES, error)]
    items = objection_items(objections, setting.cell.accept_calibration)
    said = "calibrations belong to these devices, as they are now"
    return items or [good(CALIBRATED_DEVICES, said)]


def _arm(setting: Setting, devices: CellDevices, answers: Answers) -> None:
    arm = devices.arm
    began = time.perf_counter()
    state = arm.state()
    answer_ms = _ms(time.perf_counter() - began)
    age_s = max(0.0, devices.clock.now_s() - state.t_monotonic_s)
    answers.measured |= {
        "answer_ms": answer_ms,
        "data_age_ms": _ms(age_s),
        "homed": is_homed(arm) if isinstance(arm, Homable) else None,
    }
    answers.items.append(_fresh(answer_ms, age_s))
    answers.items.append(_movable(arm, state))
    if is_homed(arm):
        answers.items.append(_place(setting, arm, state))
    elif not state.fault:
        answers.items.append(
            doubtful(
                "arm place",
                "not homed: it does not know where it is",
                "`mvp-cell home CELL` homes it; a run does so before the first view",
            )
        )


def _movable(arm: Arm, state: ArmState) -> CheckItem:
    """Whether anything holds the arm against motion as it is."""
    if state.fault:
        hint = "look what it touched; `mvp-cell recover CELL` walks the way back"
        if not is_homed(arm):
            hint += ". If it was only switched on, `mvp-cell home CELL` unlocks it"
        return failed("arm state", f"cannot move as it is: {state.fault}", hint)
    if not state.standing:
        return doubtful(
            "arm state", "moves, and no command of ours is under way", "who drives it?"
        )
    return good("arm state", "stands, and nothing holds it")


def _place(setting: Setting, arm: Arm, state: ArmState) -> CheckItem:
    """Where it stands; outside of its limits a run would not begin."""
    try:
        arm.check_joints(state.joints)
    except MvpCellError as error:
        return failure("arm place", error)
    named = zip(state.joints, setting.cell.arm.joint_units, strict=False)
    joints = ", ".join(f"{value:.3f} {unit}" for value, unit in named)
    return good("arm place", joints)


def _fresh(answer_ms: float, age_s: float) -> CheckItem:
    said = f"answered in {answer_ms:.1f} ms, data {_ms(age_s):.0f} ms old"
    if age_s <= _STALE_S:
        return good("arm data", said)
    return doubtful(
        "arm data", said, "is the controller, or this computer, overloaded?"
    )


def _lens(setting: Setting, devices: CellDevices, answers: Answers) -> None:
    lens = devices.lens
    began = time.perf_counter()
    state = lens.state()
    answer_ms = _ms(time.perf_counter() - began)
    answers.measured |= {"answer_ms": answer_ms, "homed": state.homed}
    homed = "homed" if state.homed else "not homed yet (the run will do it)"
    counted = ", by the host's own count" if state.position_is_estimated else ""
    steps = ", ".join(f"{axis} {step}" for axis, step in state.steps().items())
    answers.items.append(good("lens state", f"{homed}; {steps}{counted}"))
    answers.items.append(_lens_range(setting, devices))


def _lens_range(setting: Setting, devices: CellDevices) -> CheckItem:
    """Whether the lens can go wherever the lens table has been measured."""
    limits = devices.lens.limits()
    table = setting.cell.calibrations.lens_table
    steps = {
        "zoom": table.zoom_f_mm.steps,
        "focus": table.focus_extension_mm.steps,
        "iris": table.iris_a_mm.steps,
    }
    beyond = [
        f"{axis} {steps[axis][0]} to {steps[axis][-1]} (the device: {low} to {high})"
        for axis, (low, high) in limits.items()
        if steps[axis][0] < low or steps[axis][-1] > high
    ]
    if beyond:
        return doubtful(
            "lens range",
            f"the lens table goes further than the device: {', '.join(beyond)}",
            "views beyond are refused before anything moves; correct [lens] or the table",
        )
    said = ", ".join(f"{axis} {limits[axis][0]} to {limits[axis][1]}" for axis in AXES)
    try:
        tube_mm = setting.cell.config.optics.mounted_tube_mm
        lens = LensTable.from_calibration(table, tube_mm=tube_mm)
        reach = achievable_words(lens.within(table.validity))
    except CalibrationError as error:
        return failure("lens range", error)
    return good("lens range", f"{said}; where its table holds: {reach}")


def _camera(setting: Setting, devices: CellDevices, answers: Answers) -> None:
    camera = devices.camera
    low, high = camera.exposure_range_s()
    answers.items.append(good("camera state", f"exposure {low:g} to {high:g} s"))
    asked = setting.task.config.exposure
    exposure_s = min(max(asked.exposure_s or _EXPOSURE_S, low), high)
    began = time.perf_counter()
    camera.configure(exposure_s=exposure_s, gain=asked.gain)
    frame = camera.capture(
        not_before_s=devices.clock.now_s(), timeout_s=exposure_s + _FRAME_S
    )
    seen = _seen(frame, _ms(time.perf_counter() - began))
    answers.measured["frame"] = seen.model_dump()
    known = setting.cell.calibrations.camera
    answers.items.append(picture_item(seen, (known.width_px, known.height_px)))


def _seen(frame: Frame, round_trip_ms: float) -> CheckedFrame:
    return CheckedFrame(
        width_px=frame.pixels.shape[1],
        height_px=frame.pixels.shape[0],
        exposure_s=frame.exposure_s,
        round_trip_ms=round_trip_ms,
        mean_grey=float(np.mean(frame.pixels)) / frame.full_scale,
        saturated_fraction=float(np.mean(frame.pixels >= frame.full_scale)),
    )


def picture_item(seen: CheckedFrame, known_px: tuple[int, int]) -> CheckItem:
    """Judge a test picture.

    Args:
        seen: what was measured of it.
        known_px: (width, height) of the camera calibration.
    """
    if (seen.width_px, seen.height_px) != known_px:
        return failed(
            "camera frame",
            f"pictures have {seen.width_px} x {seen.height_px} px, but the camera "
            f"calibration is for {known_px[0]} x {known_px[1]} px",
            "set the size in [camera], or calibrate the camera at this size",
        )
    return good(
        "camera frame",
        f"{seen.width_px} x {seen.height_px} px in {seen.round_trip_ms:.0f} ms at "
        f"{seen.exposure_s:.3g} s; grey {seen.mean_grey:.0%} on average, "
        f"{seen.saturated_fraction:.1%} saturated",
    )


def _ms(seconds: float) -> float:
    return round(1000 * seconds, 3)
