"""Whether the devices of a cell are in use, whatever command uses them.

A real cell has one set of devices, and so has a simulation that ``mvp-cell simulate``
keeps running. Every other simulated cell gets a world of its own from each command,
which nobody can disturb.
"""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

from mvp.cell.lock import cell_lock, held_by, lock_file, private_file, refuse_held
from mvp.cell.simulation import simulation_lock

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from mvp.cell.loading import LoadedCell


def devices_lock(cell: LoadedCell) -> Path | None:
    """The lock of the devices that a command would use now; None for a new world.

    Raises:
        OutputError: the user's private folder cannot be used.
    """
    place = cell.source.path
    if not cell.config.simulated:
        return lock_file(place)
    if not cell.config.simulators.by_role or held_by(simulation_lock(place)) is None:
        return None
    return private_file(place, ".devices.lock")


@contextmanager
def using_devices(cell: LoadedCell, *, who: str) -> Iterator[None]:
    """Keep others off the devices meanwhile.

    Args:
        cell: whose devices.
        who: run or command, for the others' message.

    Raises:
        RecordError: another process uses them; names process, host and run.
        OutputError: the lock cannot be made.
    """
    lock = devices_lock(cell)
    if lock is None:
        yield
        return
    with cell_lock(lock, run_id=who):
        yield


def refuse_in_use(cell: LoadedCell) -> None:
    """Before work that would be in vain.

    Raises:
        RecordError, OutputError: as for ``using_devices``.
    """
    lock = devices_lock(cell)
    if lock is not None:
        refuse_held(lock)
