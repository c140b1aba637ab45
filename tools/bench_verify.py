"""Time of one verification, on the sensor of the fine camera (1280 x 1024)."""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from mvp.imaging import expose, verify_view
from tools.picture_trials import FINE, paper_stage, turned_at_flange


@dataclass(frozen=True)
class Row:
    """One line of the table: the target is in the same unit."""

    name: str
    seconds: float
    target: float


def run(quick: bool = False) -> list[Row]:
    """Median of several verifications, without and with a search for the picture."""
    stage = paper_stage(FINE)
    setting, expectation, exposure_s = stage.planned("V_f", 0.0)
    lost = turned_at_flange(setting, np.array([0.0, 1.0, 0.0]), 3.0)
    rows = []
    for name, true, target in (
        ("verify a fault-free view", setting, 0.5),
        ("verify with registration", lost, 2.0),
    ):
        rng = np.random.default_rng(0)
        image = expose(stage.picture(true), exposure_s, rng=rng)
        verify_view(image, 255.0, expectation)
        times = []
        for _ in range(3 if quick else 9):
            start = time.perf_counter()
            verify_view(image, 255.0, expectation)
            times.append(time.perf_counter() - start)
        rows.append(Row(name, float(np.median(times)), target))
    start = time.perf_counter()
    stage.expectation(setting)
    rows.append(Row("predict a view", time.perf_counter() - start, 0.5))
    return rows


def main() -> None:
    print("| what | seconds | target |\n|---|---|---|")
    for row in run(quick="--quick" in sys.argv):
        print(f"| {row.name} | {row.seconds:.2f} | {row.target:.1f} |")


if __name__ == "__main__":
    main()
