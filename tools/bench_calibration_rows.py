"""Lines of the calibration bench: ours, a rival's, the bar, the time."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence


@dataclass(frozen=True)
class Row:
    """One line: root mean square errors over all trials.

    Attributes:
        what: quantity and data.
        unit: of the errors.
        ours: of this package.
        rival: OpenCV's, or of what ``against`` says; None where there is none.
        against: whose figure that is.
        bar: ours must not exceed it.
        honest: share of our errors within the sigma that we stated.
        ours_s: seconds per trial.
        rival_s: seconds per trial.
    """

    what: str
    unit: str
    ours: float
    rival: float | None
    against: str
    bar: float | None
    honest: float | None
    ours_s: float
    rival_s: float | None

    @property
    def kept(self) -> bool:
        return self.bar is None or self.ours <= self.bar


class Clock:
    """Seconds of processor per call, by name: a busy machine does not count."""

    def __init__(self) -> None:
        self.spent: dict[str, list[float]] = {}

    def run(self, name: str, work: Callable[[], object]) -> object:
        begin = time.process_time()
        found = work()
        self.spent.setdefault(name, []).append(time.process_time() - begin)
        return found

    def mean_s(self, name: str) -> float:
        return float(np.mean(self.spent[name]))


def rms(errors: list[float] | np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(errors))))


def shown(row: Row) -> str:
    """A line of the table."""
    rival = f"{row.rival:9.3f}" if row.rival is not None else "        -"
    bar = f"{row.bar:7.2f}" if row.bar is not None else "      -"
    honest = f"{100 * row.honest:4.0f} %" if row.honest is not None else "     -"
    kept = "kept" if row.kept else "MISSED"
    return (
        f"{row.what:46} {row.ours:9.3f} {rival} {row.unit:>4} {bar} {kept:>6} "
        f"{honest} {1e3 * row.ours_s:7.0f} ms  {row.against}"
    )


def table(rows: Sequence[Row]) -> str:
    """All lines as a Markdown table."""
    head = (
        "| RMS error of | ours | rival | unit | bar | kept | within 1 sigma | whose |"
    )
    lines = [head, "| --- | --- | --- | --- | --- | --- | --- | --- |"]
    for row in rows:
        rival = "" if row.rival is None else f"{row.rival:.3g}"
        bar = "" if row.bar is None else f"{row.bar:.3g}"
        kept = "" if row.bar is None else ("yes" if row.kept else "**no**")
        honest = "" if row.honest is None else f"{100 * row.honest:.0f} %"
        cells = [row.what, f"{row.ours:.3g}", rival, row.unit, bar, kept, honest]
        lines.append("| " + " | ".join([*cells, row.against]) + " |")
    return "\n".join(lines)
