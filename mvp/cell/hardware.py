"""Build the devices of a cell from their configuration, open and check them."""

from __future__ import annotations

import logging
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar, cast

import numpy as np
from pydantic import ValidationError

from mvp.cell.engine import CellDevices
from mvp.cell.interrupts import uninterrupted
from mvp.cell.toml_file import config_error
from mvp.devices import (
    Arm,
    Camera,
    Clock,
    DeviceContext,
    DeviceInfo,
    Lens,
    RealClock,
    ScaledClock,
    WorldBelief,
    load_driver,
    load_world,
)
from mvp.errors import CalibrationError, ConnectError, DeviceError, PluginError
from mvp.fileedge import FileModel

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from mvp.cell.loading import LoadedCell
    from mvp.devices import Device, Role
    from mvp.geometry import TriangleMesh

_LOG = logging.getLogger(__name__)
_Model = TypeVar("_Model", bound=FileModel)
_CALIBRATED_ON = {
    "camera": "camera",
    "lens_table": "lens",
    "hand_eye": "arm",
    "part_pose": "arm",
}


@dataclass(frozen=True, eq=False)
class WorldBodies:
    """What a simulated world is filled with: part (part frame), fixtures (base)."""

    part: TriangleMesh
    fixtures: tuple[TriangleMesh, ...]


def build_devices(cell: LoadedCell, bodies: WorldBodies | None) -> CellDevices:
    """Every device of a cell, not yet opened; no I/O.

    Args:
        cell: the configuration.
        bodies: needed when the cell has a world.

    Raises:
        ConfigError: a key that the driver refuses, with file and line.
        PluginError: a driver that is unknown or does not load (file and line).
    """
    clock = _clock(cell)
    context = DeviceContext(
        clock=clock,
        rng=np.random.default_rng(0),
        folder=cell.folder,
        world=_world(cell, bodies, clock),
    )
    return CellDevices(
        cast("Arm", _device(cell, "arm", context)),
        cast("Lens", _device(cell, "lens", context)),
        cast("Camera", _device(cell, "camera", context)),
        clock,
    )


def check_driver_configs(cell: LoadedCell) -> None:
    """Let every driver check its own keys, without building anything.

    Raises:
        ConfigError, PluginError: as for ``build_devices``.
    """
    roles: tuple[Role, ...] = ("arm", "lens", "camera")
    for role in roles:
        _driver_config(cell, role)
    if cell.config.world is not None:
        _world_config(cell)


def _clock(cell: LoadedCell) -> Clock:
    world = cell.config.world
    if world is None or world.clock_speed == 1.0:
        return RealClock()
    return ScaledClock(world.clock_speed)


def _device(cell: LoadedCell, role: Role, context: DeviceContext) -> Device:
    config = _driver_config(cell, role)
    driver = load_driver(getattr(cell.config, role).driver, role)
    return driver.from_config(config, context, name=role)


def _driver_config(cell: LoadedCell, role: Role) -> FileModel:
    reference = getattr(cell.config, role)
    try:
        driver = load_driver(reference.driver, role)
    except PluginError as error:
        where = cell.source.where((role, "driver"))
        raise PluginError(
            f"{where}: {role}.driver: {error.message}", hint=error.hint, where=where
        ) from error
    return _options(cell, role, reference.options, driver.Config)


def _options(
    cell: LoadedCell, table: str, options: dict[str, object], model: type[_Model]
) -> _Model:
    try:
        return model.model_validate(options)
    except ValidationError as error:
        raise config_error(cell.source, model, error, (table,)) from error


def _world_config(cell: LoadedCell) -> FileModel:
    world = cell.config.world
    if world is None:
        raise ValueError("this cell has no world")
    try:
        kind = load_world(world.kind)
    except PluginError as error:
        where = cell.source.where(("world", "kind"))
        raise PluginError(
            f"{where}: world.kind: {error.message}", hint=error.hint, where=where
        ) from error
    return _options(cell, "world", world.options, kind.Config)


def _world(cell: LoadedCell, bodies: WorldBodies | None, clock: Clock) -> object | None:
    world = cell.config.world
    if world is None:
        return None
    if bodies is None:
        raise ValueError("a cell with a world needs the bodies to put into it")
    config = _world_config(cell)
    belief = _belief(cell, bodies)
    return load_world(world.kind).from_config(config, belief, clock=clock)


def _belief(cell: LoadedCell, bodies: WorldBodies) -> WorldBelief:
    found, light = cell.calibrations, cell.config.light
    reference = found.hand_eye.reference_d_mm
    return WorldBelief(
        part=bodies.part,
        fixtures=bodies.fixtures,
        arm_model=cell.config.kinematics.model,
        start_joints=tuple(float(j) for j in cell.home_joints),
        camera=found.camera,
        lens_table=found.lens_table,
        tool_from_camera=found.tool_from_camera,
        reference_d_mm=reference if reference is not None else 0.0,
        base_from_part=found.base_from_part,
        mounted_tube_mm=cell.config.optics.mounted_tube_mm,
        light=light.belief if light is not None else None,
    )


@contextmanager
def opened(devices: CellDevices) -> Iterator[dict[str, DeviceInfo]]:
    """Open all devices at once and close them in any case; yields who answered.

    Raises:
        ConnectError: somebody does not answer; every dead device is named.
    """
    everyone: dict[str, Device] = {
        "arm": devices.arm,
        "lens": devices.lens,
        "camera": devices.camera,
    }
    try:
        failures = try_open(everyone)
        if failures:
            raise _connect_error(failures)
        yield {role: device.info() for role, device in everyone.items()}
    except BaseException:
        # What went wrong first is what to tell; the log has the rest.
        close_all(everyone)
        raise
    for failure in close_all(everyone).values():
        raise failure


def try_open(devices: Mapping[str, Device]) -> dict[str, Exception]:
    """Open all devices in parallel; failures by role, nothing raised."""

    def attempt(device: Device) -> Exception | None:
        try:
            device.open()
        except Exception as error:
            return error
        return None

    with ThreadPoolExecutor(len(devices)) as pool:
        results = dict(zip(devices, pool.map(attempt, devices.values()), strict=True))
    return {role: error for role, error in results.items() if error is not None}


def close_all(devices: Mapping[str, Device]) -> dict[str, Exception]:
    """Close all devices; failures by role, nothing raised."""
    failures: dict[str, Exception] = {}
    with uninterrupted():
        for role, device in devices.items():
            try:
                device.close()
            except Exception as error:
                _LOG.error("%s: closing failed: %s", device.name, error)
                failures[role] = error
    return failures


def _connect_error(failures: dict[str, Exception]) -> DeviceError:
    texts = [str(error) for error in failures.values()]
    hints = [
        error.hint for error in failures.values() if isinstance(error, DeviceError)
    ]
    return ConnectError(
        "; ".join(texts),
        device=", ".join(failures),
        hint=" ".join(dict.fromkeys(h for h in hints if h))
        or "`mvp-cell check CELL` shows every device",
    )


def check_serials(cell: LoadedCell, infos: Mapping[str, DeviceInfo]) -> None:
    """Refuse calibrations that belong to other devices than those that answered.

    Raises:
        CalibrationError: serial numbers differ; every such file is named.
    """
    found = cell.calibrations
    wrong = []
    for name, role in _CALIBRATED_ON.items():
        expected = getattr(found, name).provenance.device_serial
        serial = infos[role].serial if role in infos else ""
        if expected and serial and serial != expected and name not in found.accepted:
            wrong.append(
                f"{found.files[name]}: this {name} calibration was made with {role} "
                f"{expected}, but {role} {serial} is connected"
            )
    if wrong:
        raise CalibrationError(
            "; ".join(wrong),
            hint="connect that device, or name the calibration of this one in "
            "[calibration] of the cell file",
            where=wrong[0].partition(": ")[0],
        )
