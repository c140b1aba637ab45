"""A calibration target on paper, as whoever draws it hands it over."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias, cast

from mvp.wizard.registry import load_named

if TYPE_CHECKING:
    from collections.abc import Callable

    from mvp.calibrated import TargetPrint

TARGET_SHEETS = "mvp_cell.target_sheets"


@dataclass(frozen=True, eq=False)
class TargetSheet:
    """A sheet at true scale.

    Attributes:
        pdf: the file.
        title: what is on it, in words.
        paper: name of the paper.
        page_mm: its width and height, as printed.
        target_mm: width and height of the target.
        ruler_mm: between the end ticks of the ruler that is printed with it.
    """

    pdf: bytes
    title: str
    paper: str
    page_mm: tuple[float, float]
    target_mm: tuple[float, float]
    ruler_mm: float


DrawTarget: TypeAlias = "Callable[[TargetPrint, str], TargetSheet]"


def load_target_drawer() -> DrawTarget:
    """What draws a layout on a paper of some name; raises MvpCellError if it cannot.

    Raises:
        PluginError: not installed, installed twice, or it does not load.
    """
    return cast("DrawTarget", load_named(TARGET_SHEETS, "pdf", "sheet of a target"))
