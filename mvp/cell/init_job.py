"""Copy a bundled cell into a folder of the user's own."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

from mvp.cell.durable import output_error
from mvp.cell.places import bundled_names, bundled_root
from mvp.errors import OutputError, UsageError

if TYPE_CHECKING:
    from pathlib import Path


def copy_cell(name: str, folder: Path) -> list[str]:
    """Copy a bundled cell; returns the names of its files.

    The copy is made beside the target and renamed, so that nothing half-written stays.

    Raises:
        UsageError: no bundled cell of that name.
        OutputError: the folder is not empty or cannot be written.
    """
    if name not in bundled_names():
        raise UsageError(
            f"no bundled cell is called {name!r}",
            hint=f"bundled cells: {', '.join(bundled_names()) or 'none'}",
            where=name,
        )
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise OutputError(
            f"{folder} already exists and is not an empty folder",
            hint="name a new folder",
            where=str(folder),
        )
    partial = folder.with_name(f".{folder.name}.part")
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        shutil.copytree(bundled_root() / name, partial, copy_function=shutil.copyfile)
        if folder.exists():
            folder.rmdir()
        partial.rename(folder)
    except OSError as error:
        raise output_error(folder, error) from error
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    files = (p for p in folder.rglob("*") if p.is_file())
    return sorted(p.relative_to(folder).as_posix() for p in files)
