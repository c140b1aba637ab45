"""``mvp-cell check``: every device reached, calibrated, inside its limits."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING

from mvp.cell.check_devices import check_devices
from mvp.cell.check_host import check_host
from mvp.cell.check_items import CheckDocument, CheckItem, doubtful, failed, good
from mvp.cell.loading import load_cell
from mvp.cell.lock import cell_lock
from mvp.cell.places import as_stored
from mvp.cell.plan_job import prepare
from mvp.cell.run_job import lock_of
from mvp.cell.session import devices_for

if TYPE_CHECKING:
    from mvp.cell.loading import LoadedCell, LoadedTask

_UNJUDGED = "only being checked"


def load_unjudged(cell: str, *, accept_calibration: str = "") -> LoadedCell:
    """Load a cell even when its calibrations are too poor; ``check_cell`` tells that.

    Raises:
        UsageError, ConfigError: as for ``load_cell``.
        CalibrationError: a calibration is missing, unreadable or foreign.
    """
    return load_cell(cell, accept_calibration=accept_calibration or _UNJUDGED)


def check_cell(cell: LoadedCell, task: LoadedTask) -> CheckDocument:
    """Open every device at once and ask it where it stands; nothing moves.

    Raises:
        GeometryError, FeatureError, ConfigError, PluginError: the files themselves.
        RecordError: a run uses the devices of this cell.
        ConnectError: the simulators of the cell do not start.
    """
    setting = prepare(cell, task)
    cell = setting.cell
    items = [_calibration(cell, name) for name in cell.calibrations.sha256]
    items += check_host(cell)
    with ExitStack() as stack:
        if not cell.config.simulated:
            # A test picture in the middle of a run would change its exposure.
            stack.enter_context(
                cell_lock(lock_of(setting, cell.folder), run_id="check")
            )
        devices = stack.enter_context(devices_for(setting))
        asked, found = check_devices(setting, devices)
    items += asked
    return CheckDocument(
        cell=cell.config.name,
        passed=all(item.passed for item in items),
        items=items,
        devices=found,
    )


def _calibration(cell: LoadedCell, name: str) -> CheckItem:
    model = getattr(cell.calibrations, name)
    reason = cell.calibrations.accepted.get(name)
    said = f"{model.quality.verdict} of {model.provenance.date}"
    if reason is None:
        return good(f"calibration {name}", said)
    why = "; ".join(model.quality.reasons) or "no reason given"
    if reason == _UNJUDGED:
        return failed(
            f"calibration {name}",
            f"{as_stored(cell.calibrations.files[name], cell.folder)}: {said}: {why}",
            "name a better one in [calibration] of the cell file, or take the "
            "responsibility with --accept-calibration REASON",
        )
    return doubtful(
        f"calibration {name}", f"{said}: {why}; accepted: {reason}", "calibrate again"
    )
