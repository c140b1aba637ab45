"""Where the bytes of a failed conversation are kept: privately, and with the run."""

from __future__ import annotations

import logging
import os
import shutil
import time
from contextlib import suppress
from typing import TYPE_CHECKING

from mvp.cell.lock import private_folder

if TYPE_CHECKING:
    from pathlib import Path

_LOG = logging.getLogger(__name__)
_KEPT = 20
_NAME = "wire"


def dump_folder() -> Path:
    """A folder for the dumps of this command, made when the first one is written.

    The last twenty such folders are kept.

    Raises:
        OutputError: the user's private folder cannot be used.
    """
    folder = private_folder() / _NAME
    with suppress(OSError):
        old = sorted(folder.iterdir(), key=lambda place: place.name)
        for place in old[: max(len(old) - _KEPT, 0)]:
            shutil.rmtree(place, ignore_errors=True)
    return folder / f"{time.strftime('%Y%m%dT%H%M%S', time.gmtime())}-{os.getpid()}"


def keep_with_run(dumps: Path | None, run_folder: Path) -> None:
    """Copy the dumps of a run into its folder; a full disk is only logged."""
    if dumps is None or not dumps.is_dir():
        return
    try:
        shutil.copytree(dumps, run_folder / _NAME, dirs_exist_ok=True)
    except (OSError, shutil.Error) as error:
        _LOG.error("run: the bytes of the wires could not be kept: %s", error)
