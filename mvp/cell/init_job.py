"""Copy a bundled cell or a template into a folder of the user's own."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

from mvp.cell.durable import output_error
from mvp.cell.places import CELL_FILE, source_folder
from mvp.errors import OutputError

if TYPE_CHECKING:
    from pathlib import Path

_MARK = "# EDIT"


def copy_cell(name: str, folder: Path) -> list[str]:
    """Copy a bundled cell or a template; returns the names of its files.

    The copy is made beside the target and renamed, so that nothing half-written stays.

    Raises:
        UsageError: no bundled cell or template of that name.
        OutputError: the folder is not empty or cannot be written.
    """
    source = source_folder(name)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise OutputError(
            f"{folder} already exists and is not an empty folder",
            hint="name a new folder",
            where=str(folder),
        )
    partial = folder.with_name(f".{folder.name}.part")
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        shutil.copytree(source, partial, copy_function=shutil.copyfile)
        if folder.exists():
            folder.rmdir()
        partial.rename(folder)
    except OSError as error:
        raise output_error(folder, error) from error
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    files = (p for p in folder.rglob("*") if p.is_file())
    return sorted(p.relative_to(folder).as_posix() for p in files)


def lines_to_edit(folder: Path) -> list[tuple[int, str]]:
    """Lines of a copied cell file that its author must look at, with their numbers."""
    text = (folder / CELL_FILE).read_text(encoding="utf-8")
    numbered = enumerate(text.splitlines(), 1)
    return [(number, line) for number, line in numbered if _MARK in line]
