"""Hints name the very cell that was given; jobs and drivers only say ``CELL``."""

from __future__ import annotations

import re
import shlex
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mvp.errors import MvpCellError

_PLACE = re.compile(r"(mvp-cell (?:[a-z-]+ )+)CELL\b")


def named(text: str, cell: str) -> str:
    """The text with every command in it ready to be pasted.

    Args:
        text: may hold commands such as ``mvp-cell check CELL``.
        cell: as it was given on the command line.
    """
    return _PLACE.sub(lambda found: found[1] + shlex.quote(cell), text)


def name_cell(error: MvpCellError, cell: str) -> None:
    """The same for what an error says."""
    error.message = named(error.message, cell)
    error.hint = named(error.hint, cell)
