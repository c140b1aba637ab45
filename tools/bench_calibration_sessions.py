"""Whole sessions on cells whose truth is drawn: do the stated intervals hold?

    python tools/bench_calibration_sessions.py lens --seeds 20 --first 0
    python tools/bench_calibration_sessions.py camera --seeds 20

Every seed is a cell of its own: its lens, camera, hand-eye, target and arm are not what
the session is told. Every error is divided by the standard deviation stated with it.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from calibration.wizard.camera import CameraWizard
from calibration.wizard.lens import LensWizard
from calibration.wizard.lens_plan import Grid
from calibration.wizard.session_store import SessionStore
from tools.bench_calibration_cell import DrawnCell, driven

if TYPE_CHECKING:
    from collections.abc import Iterator

    from mvp.wizard import Outcome

NORMAL_95 = 1.96
GRID = Grid(zooms=3, focuses=4, irises=2)


def lens_session(cell: DrawnCell, folder: Path) -> Outcome:
    """The lens wizard with fewer settings than usual."""
    store = SessionStore.create(folder, cell.told("lens"))
    return driven(LensWizard(GRID), cell, store)


def lens_errors(cell: DrawnCell, outcome: Outcome) -> Iterator[tuple[str, float]]:
    """Of f at every zoom, x at every focus, d at every node, e, and a at every iris."""
    tables = outcome.details["tables"]
    fit, iris = tables.fit, tables.curves["iris"].nodes
    true = cell.lens
    zoom_f = true.zoom.value_mm(fit.seen.zoom_steps.astype(float))
    focus_x = true.focus.value_mm(fit.seen.focus_steps.astype(float))
    d = zoom_f[fit.seen.zoom_of] + focus_x[fit.seen.focus_of]
    a = true.iris.value_mm(iris.steps.astype(float))
    rows = {
        "lens f": (fit.f_mm - zoom_f) / fit.f_sigma_mm,
        "lens x": (fit.x_mm - focus_x) / fit.x_sigma_mm,
        "lens d": (fit.d_mm - d) / fit.d_sigma_mm,
        "lens e": [(fit.e_mm - true.pupil_offset_mm) / fit.e_sigma_mm],
        "lens a": (iris.values_mm - a) / iris.sigma_mm,
    }
    for name, values in rows.items():
        yield from ((name, float(value)) for value in values)


def camera_session(cell: DrawnCell, folder: Path) -> Outcome:
    """The camera wizard."""
    store = SessionStore.create(folder, cell.told("camera"))
    return driven(CameraWizard(), cell, store)


def camera_errors(cell: DrawnCell, outcome: Outcome) -> Iterator[tuple[str, float]]:
    """Of principal point and distortion; the focal length is the lens wizard's."""
    found = outcome.document
    for name in ("centre_x_px", "centre_y_px", "k1", "k2", "p1", "p2"):
        error = getattr(found, name) - getattr(cell.camera, name)
        yield f"camera {name}", error / found.standard_deviation[name]


SESSIONS = {
    "lens": (lens_session, lens_errors),
    "camera": (camera_session, camera_errors),
}


def errors_of(kind: str, seed: int) -> list[tuple[str, float]]:
    """Errors by their stated sigma of a whole session on one cell."""
    session, errors = SESSIONS[kind]
    cell = DrawnCell(seed)
    try:
        with tempfile.TemporaryDirectory() as folder:
            outcome = session(cell, Path(folder) / kind)
            return list(errors(cell, outcome))
    finally:
        cell.close()


def coverage(rows: list[tuple[str, float]]) -> Iterator[str]:
    """One line for each quantity, and one for all of a wizard."""
    yield "| what | errors | within 1 sigma | within 95 % | RMS by sigma |"
    yield "| --- | --- | --- | --- | --- |"
    names = dict.fromkeys(name for name, _ in rows)
    kinds = dict.fromkeys(name.split()[0] for name in names)
    for what in [*names, *kinds]:
        mine = np.abs([v for n, v in rows if n == what or n.split()[0] == what])
        yield (
            f"| {what} | {len(mine)} | {100 * np.mean(mine < 1):.0f} % | "
            f"{100 * np.mean(mine < NORMAL_95):.0f} % | "
            f"{np.sqrt(np.mean(mine**2)):.2f} |"
        )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kind", choices=sorted(SESSIONS))
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    asked = parser.parse_args()
    rows: list[tuple[str, float]] = []
    for seed in range(asked.first, asked.first + asked.seeds):
        mine = errors_of(asked.kind, seed)
        rows += mine
        words = " ".join(f"{value:+.2f}" for _, value in mine)
        print(f"seed {seed}: {words}", file=sys.stderr, flush=True)
    print("\n".join(coverage(rows)))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
