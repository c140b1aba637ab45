"""What a cell needs of this computer: libraries, ports, rights. Opens nothing."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING

from mvp.cell.check_items import (
    CheckItem,
    doubtful,
    failed,
    failure,
    from_findings,
    good,
)
from mvp.cell.hardware import configured
from mvp.devices import TransportConfig, host_findings, libraries_of, port_findings
from mvp.errors import MvpCellError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from mvp.cell.loading import LoadedCell
    from mvp.devices import Role

_OPENCV = (
    "opencv-python",
    "opencv-python-headless",
    "opencv-contrib-python",
    "opencv-contrib-python-headless",
)
_ROLES: tuple[Role, ...] = ("arm", "lens", "camera")


def check_host(cell: LoadedCell) -> list[CheckItem]:
    """Everything that can be said without asking a device.

    Raises:
        ConfigError, PluginError: a table or a driver that cannot be used.
    """
    items = [_program(), _opencv()]
    for role in _ROLES:
        items += _of_role(cell, role)
    return items


def _program() -> CheckItem:
    system = f"Python {platform.python_version()}, {platform.system()}"
    return good("program", f"mvp-cell {_version('mvp-cell')}, {system}")


def _opencv() -> CheckItem:
    """All of its distributions install the same files: the last one wins."""
    found = [f"{name} {_version(name)}" for name in _OPENCV if _version(name)]
    if len(found) == 1:
        return good("OpenCV", found[0])
    if not found:
        return failed("OpenCV", "not installed", f"`pip install {_OPENCV[-1]}`")
    return doubtful(
        "OpenCV",
        f"installed {len(found)} times: {', '.join(found)} overwrite each other",
        f"uninstall all of them, then `pip install '{_OPENCV[-1]}<5'`",
    )


def _of_role(cell: LoadedCell, role: Role) -> Iterator[CheckItem]:
    driver, config = configured(cell, role)
    wired = isinstance(config, TransportConfig)
    names = libraries_of(driver) or (("pyserial",) if wired else ())
    for name in names:
        yield _library(role, name)
    if isinstance(config, TransportConfig) and "port" in config.model_fields_set:
        yield from from_findings(role, port_findings(config))
    try:
        yield from from_findings(role, host_findings(driver, config))
    except MvpCellError as error:
        yield failure(f"{role} host", error)


def _library(role: Role, name: str) -> CheckItem:
    found = _version(name)
    if found:
        return good(f"{role} library", f"{name} {found}")
    return failed(
        f"{role} library", f"{name} is not installed", f"`pip install {name}`"
    )


def _version(name: str) -> str:
    """Of an installed distribution; empty when there is none."""
    try:
        return version(name)
    except PackageNotFoundError:
        return ""
