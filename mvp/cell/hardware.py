"""Build the devices of a cell from their configuration, open and check them."""

from __future__ import annotations

import logging
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, TypeAlias, cast

import numpy as np

from mvp.cell.calibration_gates import of_serials, require_accepted
from mvp.cell.device_locks import devices_held
from mvp.cell.engine import CellDevices
from mvp.cell.interrupts import uninterrupted
from mvp.cell.own_keys import naming_place, own_keys
from mvp.cell.wire_dumps import dump_folder
from mvp.cell.world_building import build_world, simulator_config, world_config
from mvp.devices import (
    Arm,
    Camera,
    Clock,
    DeviceContext,
    DeviceInfo,
    Lens,
    RealClock,
    ScaledClock,
    load_driver,
)
from mvp.errors import ConnectError, DeviceError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from mvp.cell.loading import LoadedCell
    from mvp.cell.world_building import WorldBodies
    from mvp.devices import Device, DriverClass, Role
    from mvp.fileedge import FileModel

    Announced: TypeAlias = Mapping[Role, Mapping[str, object]]

_LOG = logging.getLogger(__name__)
_MOVING = ("arm", "lens")


def build_devices(
    cell: LoadedCell, bodies: WorldBodies | None, announced: Announced
) -> CellDevices:
    """Every device of a cell, not yet opened; no I/O.

    Args:
        cell: the configuration.
        bodies: needed when the cell has a world.
        announced: where the simulators of the cell listen, by role.

    Raises:
        ConfigError: a key that the driver refuses, with file and line.
        PluginError: a driver that is unknown or does not load (file and line).
    """
    clock = _clock(cell)
    context = DeviceContext(
        clock=clock,
        rng=np.random.default_rng(0),
        folder=cell.folder,
        world=None if announced else build_world(cell, bodies, clock),
        dump_folder=dump_folder(),
    )
    return CellDevices(
        cast("Arm", _device(cell, "arm", context, announced)),
        cast("Lens", _device(cell, "lens", context, announced)),
        cast("Camera", _device(cell, "camera", context, announced)),
        clock,
        simulated_roles=frozenset(announced),
        dumps=context.dump_folder,
    )


def check_driver_configs(cell: LoadedCell) -> None:
    """Let every driver check its own keys, without building anything.

    Raises:
        ConfigError, PluginError: as for ``build_devices``.
    """
    roles: tuple[Role, ...] = ("arm", "lens", "camera")
    for role in roles:
        _driver_config(cell, role, None)
    for role, simulator in cell.config.simulators.by_role.items():
        simulator_config(cell, role, simulator)
    if cell.config.world is not None:
        world_config(cell)


def configured(cell: LoadedCell, role: Role) -> tuple[DriverClass, FileModel]:
    """The driver of a role, and its keys as far as the cell file says them.

    Raises:
        ConfigError, PluginError: as for ``build_devices``.
    """
    config = _driver_config(cell, role, None)
    return load_driver(getattr(cell.config, role).driver, role), config


def _clock(cell: LoadedCell) -> Clock:
    world = cell.config.world
    if world is None or world.clock_speed == 1.0:
        return RealClock()
    return ScaledClock(world.clock_speed)


def _device(
    cell: LoadedCell, role: Role, context: DeviceContext, announced: Announced
) -> Device:
    config = _driver_config(cell, role, announced)
    driver = load_driver(getattr(cell.config, role).driver, role)
    return driver.from_config(config, context, name=role)


def _driver_config(
    cell: LoadedCell, role: Role, announced: Announced | None
) -> FileModel:
    """The driver's own keys, with those that a simulator announced.

    Where ``announced`` is None the simulators have not been started yet, and keys that
    only they know may still be missing.
    """
    reference = getattr(cell.config, role)
    with naming_place(cell, (role, "driver")):
        driver = load_driver(reference.driver, role)
    given = dict(reference.options)
    for key, value in (announced or {}).get(role, {}).items():
        if key in given:
            raise cell.source.error(
                (role, key),
                f"the simulator of the {role} says itself what {key} is",
                hint=f"leave {key} out of [{role}], or leave out [simulators.{role}]",
            )
        given[key] = value
    awaited = announced is None and role in cell.config.simulators.by_role
    return own_keys(cell, (role,), given, driver.Config, may_miss=awaited)


@contextmanager
def opened(devices: CellDevices) -> Iterator[dict[str, DeviceInfo]]:
    """Open all devices at once and close them in any case; yields who answered.

    Raises:
        ConnectError: somebody does not answer; every dead device is named. Or another
            process of this machine drives one of them.
    """
    with devices_held(devices.by_role):
        yield from _opened(devices)


def _opened(devices: CellDevices) -> Iterator[dict[str, DeviceInfo]]:
    everyone = devices.by_role
    try:
        failures = try_open(everyone)
        if failures:
            raise _connect_error(failures)
        yield {role: info_of(devices, role) for role in everyone}
    except BaseException:
        # What went wrong first is what to tell; the log has the rest.
        close_all(everyone)
        raise
    for failure in close_all(everyone).values():
        raise failure


def info_of(devices: CellDevices, role: str) -> DeviceInfo:
    """Who answered; a real driver cannot know that the far end is simulated."""
    info: DeviceInfo = getattr(devices, role).info()
    simulated = info.simulated or role in devices.simulated_roles
    return replace(info, simulated=simulated)


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
    if len(failures) == 1:
        ((role, error),) = failures.items()
        text = error.detail if isinstance(error, DeviceError) else str(error)
    else:
        role = ", ".join(failures)
        told = "; ".join(str(error) for error in failures.values())
        text = f"{len(failures)} devices cannot be used: {told}"
    hints = [
        error.hint for error in failures.values() if isinstance(error, DeviceError)
    ]
    return ConnectError(
        text,
        device=role,
        hint=" ".join(dict.fromkeys(h for h in hints if h))
        or "`mvp-cell check CELL` shows every device",
    )


def check_simulated(cell: LoadedCell, infos: Mapping[str, DeviceInfo]) -> None:
    """Refuse to move real motors in a cell that calls itself simulated.

    Such a cell has no lock of its own, takes any calibration, and everything that it
    leaves behind is stamped as simulated.

    Raises:
        ConfigError: arm or lens are real.
    """
    real = [role for role in _MOVING if role in infos and not infos[role].simulated]
    if cell.config.simulated and real:
        names = " and ".join(f"{role} ({infos[role].model})" for role in real)
        raise cell.source.error(
            ("simulated",),
            f"simulated = true, but real motors answer: {names}",
            hint="set simulated = false and leave out [world], or let [simulators] "
            "play the far ends",
        )


def check_serials(cell: LoadedCell, infos: Mapping[str, DeviceInfo]) -> None:
    """Refuse calibrations that belong to other devices than those that answered.

    Raises:
        CalibrationError: serial numbers differ, and it was not accepted; every such
            file is named.
    """
    found = cell.calibrations
    serials = {role: info.serial for role, info in infos.items()}
    wrong = of_serials(found, serials)
    require_accepted((one for one in wrong if one.name not in found.accepted), "")
