"""The truth of a simulated cell, where it differs from what the cell believes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mvp.cell.calibrations import read_calibrations
from mvp.cell.places import inside
from mvp.errors import CalibrationError, ConfigError

if TYPE_CHECKING:
    from pathlib import Path

    from mvp.cell.calibrations import CalibrationModels
    from mvp.cell.loading import LoadedCell


def truth_of(cell: LoadedCell) -> CalibrationModels:
    """What is true in the world of a cell: its truth folder, else its calibrations.

    A task with a part pose of its own may have a file of the same name there.

    Raises:
        ConfigError: a file of the folder is missing, or outside of the cell.
        CalibrationError: one cannot be read.
    """
    world = cell.config.world
    if world is None or world.truth is None:
        return cell.calibrations
    folder = world.truth
    return read_calibrations(lambda key: _true_file(cell, folder, key))


def _true_file(cell: LoadedCell, folder: str, key: str) -> Path:
    """The file of one calibration that says what is true."""
    believed = cell.calibrations.files[key]
    if (cell.folder / folder / believed.name).is_file():
        return _file(cell, f"{folder}/{believed.name}")
    named = (cell.folder / getattr(cell.config.calibration, key)).resolve()
    # A task may bring a part pose of its own: that is true unless the folder has it.
    return _file(cell, f"{folder}/{key}.json") if believed == named else believed


def _file(cell: LoadedCell, name: str) -> Path:
    where = f"{cell.source.where(('world', 'truth'))}: world.truth"
    try:
        return inside(cell.folder, cell.folder, name, where)
    except ConfigError as error:
        raise CalibrationError(
            error.message,
            hint="put the file there, or leave out truth: then the cell's own "
            "calibrations are true",
            where=error.where,
        ) from error
