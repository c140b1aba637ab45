"""Calibrations against the devices that answered and against what a plan asks of them."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, NamedTuple

from mvp.cell.calibration_gates import (
    of_approach,
    of_serials,
    of_temperature,
    of_views,
    require_accepted,
)
from mvp.devices import Approaching, Thermometer
from mvp.errors import DeviceFault

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from mvp.calibrated import CameraCalibration, TemperatureSource
    from mvp.cell.calibration_gates import Objection
    from mvp.cell.engine import CellDevices
    from mvp.cell.loading import LoadedCell
    from mvp.devices import DeviceInfo, Frame
    from mvp.planning.plan import PlannedView

_LOG = logging.getLogger(__name__)


def device_objections(
    cell: LoadedCell, devices: CellDevices, infos: Mapping[str, DeviceInfo]
) -> list[Objection]:
    """Other devices, another side of approach, another temperature. Moves nothing.

    Args:
        cell: with its calibrations.
        devices: of which those in ``infos`` are open.
        infos: who answered, by role.
    """
    found = cell.calibrations
    serials = {role: info.serial for role, info in infos.items()}
    lens = devices.lens if "lens" in infos else None
    approach = lens.approach() if isinstance(lens, Approaching) else None
    return [
        *of_serials(found, serials),
        *of_approach(found, approach),
        *of_temperature(found, temperature_of(cell, devices, infos).value_c),
    ]


class Temperature(NamedTuple):
    """How warm it is; ``value_c`` None: nobody knows."""

    value_c: float | None
    source: TemperatureSource


def temperature_of(
    cell: LoadedCell, devices: CellDevices, infos: Mapping[str, DeviceInfo]
) -> Temperature:
    """As the cell file states it, else as a device tells, the lens first."""
    stated = cell.config.conditions.temperature_c
    if stated is not None:
        return Temperature(stated, "cell-file")
    for role, device in (("lens", devices.lens), ("camera", devices.camera)):
        if role in infos and isinstance(device, Thermometer):
            told = device.temperature_c()
            if told is not None:
                return Temperature(told, "device")
    return Temperature(None, "unknown")


def accepted_on_devices(
    cell: LoadedCell,
    devices: CellDevices,
    infos: Mapping[str, DeviceInfo],
    views: Sequence[PlannedView],
) -> dict[str, str]:
    """Names of calibrations that a person accepts for this run, with the reason.

    Raises:
        CalibrationError: one must not be used with these devices, or for these views.
    """
    objections = [
        *device_objections(cell, devices, infos),
        *of_views(cell.calibrations, views),
    ]
    accepted = require_accepted(objections, cell.accept_calibration)
    return cell.calibrations.accepted | accepted


def warn_of_devices(
    cell: LoadedCell, devices: CellDevices, infos: Mapping[str, DeviceInfo]
) -> None:
    """Log what does not refuse, but should be looked at."""
    for one in device_objections(cell, devices, infos):
        _LOG.warning("%s; %s", one.text, one.fix)


def require_size(frame: Frame, known: CameraCalibration, camera: str) -> None:
    """Refuse a picture of another size than the camera was calibrated at.

    Raises:
        DeviceFault: the camera is in another mode.
    """
    rows, columns = frame.pixels.shape
    if (columns, rows) != (known.width_px, known.height_px):
        raise DeviceFault(
            f"pictures have {columns} x {rows} px, but the camera calibration is for "
            f"{known.width_px} x {known.height_px} px",
            device=camera,
            hint="set the size in [camera], or calibrate the camera at this size",
        )
