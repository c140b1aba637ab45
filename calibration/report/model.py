"""What a calibration report shows, as plain data; nothing here draws or writes.

The pictures are in ``calibration.report.plots``.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from calibration.report.plots import Plot
    from calibration.verdict import Verdict
    from calibration.wizard.comparison import Comparison
    from mvp.geometry import FloatArray

ReportKind: TypeAlias = Literal["camera", "lens", "hand-eye", "part"]

TITLES: dict[ReportKind, str] = {
    "camera": "Camera calibration",
    "lens": "Lens table",
    "hand-eye": "Hand-eye calibration",
    "part": "Pose of the part",
}


@dataclass(frozen=True)
class Quantity:
    """One line of the result.

    Attributes:
        name: in words.
        value: in ``unit``.
        sigma: one standard deviation; None: held fixed or not known.
        unit: of both.
        note: what the reader should know about it.
    """

    name: str
    value: float
    sigma: float | None
    unit: str
    note: str = ""


@dataclass(frozen=True, eq=False)
class Photo:
    """A picture that took part.

    Attributes:
        name: as in the bars.
        grey: (rows, columns) of 8 bits; None: only named.
        points_px: (k, 2), where points were found.
        link: path of the full picture, relative to the report; empty: none.
    """

    name: str
    grey: NDArray[np.uint8] | None = None
    points_px: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    link: str = ""


@dataclass(frozen=True)
class LeftOut:
    """A picture that was not used, and why."""

    name: str
    reason: str
    action: str = ""


@dataclass(frozen=True, eq=False)
class About:
    """What the estimators do not know: device, day, pictures.

    Attributes:
        subject: what was calibrated, such as "camera CAM-1 of cell virtual".
        simulated: not a real device.
        facts: name and value: date, lens setting, temperature, target.
        photos: of the views that were used.
        left_out: pictures that were not used.
        comparison: with the result before; None: there is none.
        provenance: name and value: hashes, versions, folder.
    """

    subject: str
    simulated: bool = False
    facts: tuple[tuple[str, str], ...] = ()
    photos: tuple[Photo, ...] = ()
    left_out: tuple[LeftOut, ...] = ()
    comparison: Comparison | None = None
    provenance: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, eq=False)
class ReportData:
    """One report.

    Attributes:
        kind: of calibration.
        about: device, day, pictures.
        headline: how good it is, in one sentence and in mm.
        verdict: with causes and actions.
        quantities: the result.
        tables: title, heads and rows of further numbers.
        plots: in the order shown.
        notes: sentences below the result.
    """

    kind: ReportKind
    about: About
    headline: str
    verdict: Verdict
    quantities: tuple[Quantity, ...]
    plots: tuple[Plot, ...]
    tables: tuple[tuple[str, tuple[str, ...], tuple[tuple[str, ...], ...]], ...] = ()
    notes: tuple[str, ...] = ()
