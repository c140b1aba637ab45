"""``mvp-cell check``: every device reached, calibrated, inside its limits."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING

from mvp.cell.calibration_items import UNJUDGED, file_items
from mvp.cell.check_devices import check_devices
from mvp.cell.check_host import check_host
from mvp.cell.check_items import CheckDocument
from mvp.cell.device_locks import devices_held
from mvp.cell.in_use import using_devices
from mvp.cell.loading import load_cell
from mvp.cell.plan_job import prepare
from mvp.cell.progress import Tell, unheard
from mvp.cell.session import devices_for

if TYPE_CHECKING:
    from mvp.cell.loading import LoadedCell, LoadedTask


def load_unjudged(cell: str, *, accept_calibration: str = "") -> LoadedCell:
    """Load a cell even when its calibrations are too poor; ``check_cell`` tells that.

    Raises:
        UsageError, ConfigError: as for ``load_cell``.
        CalibrationError: a calibration is missing, unreadable or foreign.
    """
    return load_cell(cell, accept_calibration=accept_calibration or UNJUDGED)


def check_cell(
    cell: LoadedCell, task: LoadedTask, tell: Tell = unheard
) -> CheckDocument:
    """Open every device at once and ask it where it stands; nothing moves.

    Raises:
        GeometryError, FeatureError, ConfigError, PluginError: the files themselves.
        RecordError: a run uses the devices of this cell.
        ConnectError: another process drives one of them, or the simulators of the cell
            do not start.
    """
    with ExitStack() as stack:
        # A test picture in the middle of a run would change its exposure.
        stack.enter_context(using_devices(cell, who="check"))
        tell(f"loading {task.part_file.name}")
        setting = prepare(cell, task)
        cell = setting.cell
        items = file_items(cell)
        items += check_host(cell)
        devices = stack.enter_context(devices_for(setting, tell))
        stack.enter_context(devices_held(devices.by_role))
        tell("asking arm, lens and camera; taking a test picture")
        asked, found = check_devices(setting, devices)
    items += asked
    return CheckDocument(
        cell=cell.config.name,
        passed=all(item.passed for item in items),
        items=items,
        devices=found,
    )
