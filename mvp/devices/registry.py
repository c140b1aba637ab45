"""Drivers, worlds and simulators by key, found through entry points and loaded one by one.

A driver is a class with ``role``, ``Config`` and ``from_config``; a distribution
announces it in the entry-point group ``mvp_cell.drivers``. Loading is lazy: a driver
with a missing library is broken alone.
"""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint, distributions, entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Protocol, cast

from mvp.errors import MvpCellError, PluginError

if TYPE_CHECKING:
    from mvp.devices.context import DeviceContext
    from mvp.devices.protocols import Device, Role
    from mvp.devices.simulator import SimulatorClass
    from mvp.devices.world import WorldClass
    from mvp.fileedge import FileModel

DRIVERS = "mvp_cell.drivers"
WORLDS = "mvp_cell.worlds"
SIMULATORS = "mvp_cell.simulators"
_OURS = "mvp-cell"
_PACKAGE = "drivers"


class DriverClass(Protocol):
    """A driver as the registry hands it out: the class, not an instance.

    What else it may have, for ``check`` and ``devices``, is told in ``findings``.
    """

    role: ClassVar[Role]
    Config: ClassVar[type[FileModel]]

    def from_config(
        self, config: FileModel, context: DeviceContext, *, name: str
    ) -> Device:
        """Build the device; no I/O.

        Args:
            config: an instance of the driver's ``Config``.
            context: clock, randomness, folder, world.
            name: what messages and records call the device.
        """
        ...


@dataclass(frozen=True)
class DriverEntry:
    """One installed driver, as ``mvp-cell drivers`` shows it.

    Attributes:
        key: as written in a cell file.
        role: arm, lens or camera; empty when it does not load.
        distribution: who ships it.
        version: of that distribution.
        target: module and class.
        error: why it does not load; empty when it does.
    """

    key: str
    role: str
    distribution: str
    version: str
    target: str
    error: str = ""


def list_drivers() -> tuple[DriverEntry, ...]:
    """Every installed driver, loaded to know its role; errors are reported, not raised."""
    return tuple(_described(entry) for entry in _entries(DRIVERS))


def load_driver(key: str, role: Role) -> DriverClass:
    """The driver class called ``key``.

    Raises:
        PluginError: unknown, foreign, broken, or for another role.
    """
    driver = cast("DriverClass", _load(_find(DRIVERS, key, "driver")))
    _check_shape(driver, key)
    if driver.role != role:
        raise PluginError(
            f"driver {key!r} is for the {driver.role}, not for the {role}",
            hint="`mvp-cell drivers` lists drivers with their roles",
        )
    return driver


def load_world(kind: str) -> WorldClass:
    """The world class called ``kind``.

    Raises:
        PluginError: unknown, foreign or broken.
    """
    return cast("WorldClass", _configurable(WORLDS, kind, "world"))


def load_simulator(kind: str) -> SimulatorClass:
    """The simulator class called ``kind``.

    Raises:
        PluginError: unknown, foreign or broken.
    """
    return cast("SimulatorClass", _configurable(SIMULATORS, kind, "simulator"))


def _entries(group: str) -> list[EntryPoint]:
    return sorted(entry_points(group=group), key=lambda entry: entry.name)


def _find(group: str, key: str, what: str) -> EntryPoint:
    """The one entry point with this name."""
    entries = _entries(group)
    found = [entry for entry in entries if entry.name == key]
    if len(found) == 1:
        return found[0]
    if found:
        owners = ", ".join(sorted(_distribution(entry)[0] for entry in found))
        raise PluginError(
            f"{what} {key!r} is installed more than once, by {owners}",
            hint="uninstall all but one of them",
        )
    names = [entry.name for entry in entries]
    close = difflib.get_close_matches(key, names, n=1)
    hint = f"did you mean {close[0]!r}? " if close else ""
    raise PluginError(
        f"unknown {what} {key!r}",
        hint=f"{hint}installed: {', '.join(names) or 'none'}",
    )


def _configurable(group: str, kind: str, what: str) -> object:
    """Something that is built from a table of the cell file."""
    found = _load(_find(group, kind, what))
    if not hasattr(found, "Config") or not hasattr(found, "from_config"):
        raise PluginError(f"{what} {kind!r} has no Config or no from_config")
    return found


def _load(entry: EntryPoint) -> object:
    """Import the target of an entry point.

    Raises:
        PluginError: foreign package, or the import fails.
    """
    if entry.module.split(".")[0] == _PACKAGE:
        check_own_package()
    try:
        return entry.load()
    except MvpCellError:
        raise
    except ImportError as error:
        raise PluginError(
            f"driver {entry.name!r} needs something that is not installed: {error}",
            hint="install the extra that the driver's documentation names",
        ) from error
    except Exception as error:
        raise PluginError(
            f"driver {entry.name!r} does not load: {type(error).__name__}: {error}",
            hint=f"report it to the makers of {_distribution(entry)[0]}",
        ) from error


def check_own_package() -> None:
    """Make sure that ``drivers`` is ours: other distributions use that name too.

    Raises:
        PluginError: another package shadows or has overwritten ours.
    """
    here = Path(__file__).resolve().parents[2]
    spec = find_spec(_PACKAGE)
    origin = Path(spec.origin).resolve() if spec and spec.origin else None
    if origin is None or here not in origin.parents:
        raise PluginError(
            f"the package {_PACKAGE!r} of another project is in the way: {origin}",
            hint=f"install {_OURS} into an environment of its own, and do not start it "
            f"with a folder called {_PACKAGE!r} first on the path",
        )
    others = _owners() - {_OURS}
    if others:
        raise PluginError(
            f"the package {_PACKAGE!r} was also installed by "
            f"{', '.join(sorted(others))}, which overwrites ours",
            hint=f"install {_OURS} again into an environment of its own",
        )


@cache
def _owners() -> frozenset[str]:
    """Distributions that installed files into ``drivers``; read once, it takes long."""
    return frozenset(
        _plain(owner.name)
        for owner in distributions()
        if f"\n{_PACKAGE}/" in "\n" + (owner.read_text("RECORD") or "")
    )


def _plain(name: str) -> str:
    return name.lower().replace("_", "-")


def _check_shape(driver: object, key: str) -> None:
    missing = [n for n in ("role", "Config", "from_config") if not hasattr(driver, n)]
    if missing:
        raise PluginError(
            f"driver {key!r} has no {', '.join(missing)}",
            hint="a driver class needs role, Config and from_config",
        )


def _distribution(entry: EntryPoint) -> tuple[str, str]:
    """Name and version of who ships an entry point."""
    owner = entry.dist
    return (owner.name, owner.version) if owner is not None else ("unknown", "")


def _described(entry: EntryPoint) -> DriverEntry:
    role, problem = "", ""
    try:
        driver = cast("DriverClass", _load(entry))
        _check_shape(driver, entry.name)
        role = driver.role
    except PluginError as error:
        problem = error.message
    return DriverEntry(entry.name, role, *_distribution(entry), entry.value, problem)
