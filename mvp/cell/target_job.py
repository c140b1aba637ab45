"""Draw the target of a cell on paper."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mvp.cell.documents import TargetDocument
from mvp.cell.durable import check_file_writable, write_durably
from mvp.cell.loading import read_cell
from mvp.errors import ConfigError, UsageError
from mvp.wizard import load_target_drawer

if TYPE_CHECKING:
    from pathlib import Path


def draw_target(cell: str, path: Path, paper: str) -> TargetDocument:
    """The target of ``[target]``, as large as the cell file says.

    Args:
        cell: path or name.
        path: of the PDF; replaced if it is there.
        paper: its name, such as A4.

    Raises:
        UsageError: no such cell, or not the name of a PDF file.
        ConfigError: a fault in the cell file, or it has no target.
        CalibrationError: the target does not fit on the paper, or cannot be drawn.
        OutputError: the disk does not take it.
    """
    if path.suffix.lower() != ".pdf":
        file = path.name.strip(".")
        named = path.with_suffix(".pdf") if file else path / "target.pdf"
        raise UsageError(
            f"{path}: a target is printed from a PDF file",
            hint=f"name it {named}",
            where="--out",
        )
    source, config = read_cell(cell)
    if config.target is None:
        raise ConfigError(
            f"{source.path}: this cell has no [target]",
            hint="say there what is to be printed: kind, columns, rows, square_mm; and "
            "roughly where it will lie: position_mm, rotation_deg",
            where=str(source.path),
        )
    sheet = load_target_drawer()(config.target, paper)
    check_file_writable(path, needed_bytes=len(sheet.pdf))
    write_durably(path, sheet.pdf)
    return TargetDocument(
        file=str(path),
        title=sheet.title,
        paper=sheet.paper,
        page_mm=sheet.page_mm,
        target_mm=sheet.target_mm,
        ruler_mm=sheet.ruler_mm,
    )
