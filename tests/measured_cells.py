"""Cells as a calibration leaves them, for tests that need no calibration."""

from __future__ import annotations

import json
import shutil
from typing import TYPE_CHECKING

import numpy as np

from mvp.cell.places import bundled_root
from mvp.geometry import Pose

if TYPE_CHECKING:
    from pathlib import Path

SPREAD = np.array([0.1] * 3 + [np.radians(0.02)] * 3)


def measured_cell(folder: Path, **placement: float) -> Path:
    """The uncalibrated cell with camera, lens and hand-eye as a calibration leaves them, at 20 deg C.

    The part's pose is the nominal one: it is wrong by 4 mm and 1 deg.
    """
    source = bundled_root() / "virtual_uncalibrated"
    shutil.copytree(source, folder, copy_function=shutil.copyfile)
    named = {
        "camera": {"parameters": ["cx_px", "cy_px"], "matrix": [[0.04, 0], [0, 0.04]]},
        "lens_table": {"parameters": ["f_mm at zoom 0"], "matrix": [[1e-5]]},
        "hand_eye": np.diag(SPREAD**2).tolist(),
    }
    for name, covariance in named.items():
        found = json.loads((folder / "truth" / f"{name}.json").read_text())
        found["quality"] = {"verdict": "go"}
        found["provenance"] |= {"origin": "measured", "temperature_c": 20.0}
        found["covariance"] = covariance
        if name == "hand_eye":
            found["matrix"] = slightly_wrong(found["matrix"])
        if name == "lens_table":
            found["d_standard_deviation_mm"] = 0.003
            found["f_standard_deviation_mm"] = 0.003
        (folder / "calibration" / f"{name}.json").write_text(json.dumps(found))
    cell = folder / "cell.toml"
    text = cell.read_text().replace("clock_speed = 10.0", "clock_speed = 100.0")
    if placement:
        lines = [f"{key} = {value}" for key, value in placement.items()]
        text += "\n[part_placement]\n" + "\n".join(lines) + "\n"
    cell.write_text(text)
    return cell


def slightly_wrong(matrix: list[list[float]]) -> list[list[float]]:
    """By what the covariance says."""
    true = Pose.from_matrix("tool", "camera", np.array(matrix))
    step = np.random.default_rng(4).normal(size=6) * SPREAD
    turn = Pose.from_rotvec("tool", "tool", step[3:], [0, 0, 0]).rotation
    moved = Pose("tool", "camera", turn @ true.rotation, true.translation_mm + step[:3])
    return moved.matrix.tolist()
