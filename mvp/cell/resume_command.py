"""The command that goes on with a run, ready to be pasted."""

from __future__ import annotations

import shlex
from pathlib import Path

from mvp.cell.places import CELL_FILE, bundled_names, bundled_root


def resume_command(run: Path, cell_file: Path, *, accept_calibration: str = "") -> str:
    """Quoted for a shell in the current folder.

    Args:
        run: the run's folder.
        cell_file: the ``cell.toml`` it runs on.
        accept_calibration: the reason given for using a poor calibration.
    """
    words = ["mvp-cell", "run", cell_word(cell_file), "--out", _near(run.parent)]
    words += ["--resume", run.name]
    if accept_calibration:
        words += ["--accept-calibration", accept_calibration]
    return shlex.join(words)


def cell_word(cell_file: Path) -> str:
    """What to call a cell on the command line: a bundled name, or its folder."""
    folder = cell_file.parent
    name = folder.name
    if name in bundled_names() and folder == bundled_root().resolve() / name:
        return _near(folder) if Path(name).exists() else name
    return _near(folder if cell_file.name == CELL_FILE else cell_file)


def _near(path: Path) -> str:
    """Relative to the current folder when it lies below it."""
    path, here = path.resolve(), Path.cwd()
    return str(path.relative_to(here) if path.is_relative_to(here) else path)
