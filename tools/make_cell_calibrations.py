"""Write the calibration files of the bundled cells.

    python tools/make_cell_calibrations.py [FOLDER]

The numbers are a design, not a measurement: a 1280 x 1024 camera with 5 um pixels,
binned 2 x 2 where far ends are simulated, because that draws four times as fast; a
parfocal 8-25 mm zoom behind three different controllers; and the paper's object where
the arm of the cell sees it from all sides. The standard deviations are what the
project's own calibration reaches in simulation.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from mvp.calibrated import (
    AxisTable,
    CameraCalibration,
    LensTableCalibration,
    Provenance,
    Quality,
    RigidCalibration,
)
from mvp.geometry import Pose

FOLDER = Path(__file__).parents[1] / "cell_configs"
REFERENCE_D_MM = 12.9
REFERENCE_F_MM = 12.5


@dataclass(frozen=True)
class Motor:
    """Steps of one axis, and how it is approached."""

    low: int
    high: int
    nodes: int
    backlash_steps: int
    repeatability_steps: float
    approach: Literal["from_below", "from_above"] = "from_below"

    def table(self, first_mm: float, last_mm: float, *, even: bool) -> AxisTable:
        """Values that grow evenly, or by an even ratio."""
        share = np.linspace(0, 1, self.nodes)
        steps = np.round(self.low + share * (self.high - self.low))
        share = (steps - self.low) / (self.high - self.low)
        ratio = first_mm * (last_mm / first_mm) ** share
        values = first_mm + (last_mm - first_mm) * share if even else ratio
        return AxisTable(
            steps=steps.astype(int).tolist(),
            values_mm=np.round(values, 6).tolist(),
            backlash_steps=self.backlash_steps,
            repeatability_steps=self.repeatability_steps,
            approach=self.approach,
        )


@dataclass(frozen=True)
class Cell:
    """What differs from cell to cell."""

    name: str
    arm_serial: str
    lens_serial: str
    camera_serial: str
    zoom: Motor
    focus: Motor
    iris: Motor
    part_mm: tuple[float, float, float]
    part_turn_deg: float
    camera_turn_deg: float
    binning: int = 1

    def provenance(self, device_serial: str) -> Provenance:
        return Provenance(
            date="2026-11-22",
            device_serial=device_serial,
            method=f"design values of the {self.name} cell",
            simulated=True,
            temperature_c=20.0,
        )


CELLS = (
    Cell(
        name="virtual",
        arm_serial="V-ARM-1",
        lens_serial="V-LENS-1",
        camera_serial="V-CAM-1",
        zoom=Motor(0, 3200, 33, 30, 1.0),
        focus=Motor(0, 8000, 17, 40, 2.0),
        iris=Motor(0, 600, 25, 6, 0.5),
        part_mm=(-520.0, -130.0, 60.0),
        part_turn_deg=5.0,
        camera_turn_deg=25.0,
    ),
    Cell(
        name="simulated_ur",
        arm_serial="20225500123",
        lens_serial="055-001234",
        camera_serial="SIM-GIGE-1",
        zoom=Motor(100, 3000, 30, 60, 1.0, "from_above"),
        focus=Motor(200, 7800, 20, 60, 2.0, "from_above"),
        iris=Motor(2, 72, 71, 0, 0.3, "from_above"),
        part_mm=(-520.0, -130.0, 60.0),
        part_turn_deg=5.0,
        camera_turn_deg=25.0,
        binning=2,
    ),
    Cell(
        name="simulated_gantry",
        arm_serial="",
        lens_serial="5DDFF39-3739584E-00000001",
        camera_serial="",
        zoom=Motor(17_850, 38_650, 33, 120, 4.0),
        focus=Motor(28_500, 38_000, 20, 80, 4.0),
        iris=Motor(100, 2300, 45, 12, 1.0),
        part_mm=(-20.0, 30.0, 60.0),
        part_turn_deg=5.0,
        camera_turn_deg=0.0,
        binning=2,
    ),
)


def camera(cell: Cell) -> CameraCalibration:
    return CameraCalibration(
        schema="mvp-cell/camera/1",
        provenance=cell.provenance(cell.camera_serial),
        quality=Quality(verdict="go", rms_px=0.05),
        width_px=1280 // cell.binning,
        height_px=1024 // cell.binning,
        pitch_x_um=5.0 * cell.binning,
        pitch_y_um=5.0 * cell.binning,
        centre_x_px=643.2 / cell.binning,
        centre_y_px=508.7 / cell.binning,
        k1=-0.1,
        standard_deviation={"centre_x_px": 0.4, "centre_y_px": 0.4, "k1": 0.0005},
    )


def lens_table(cell: Cell) -> LensTableCalibration:
    return LensTableCalibration(
        schema="mvp-cell/lens-table/1",
        provenance=cell.provenance(cell.lens_serial),
        quality=Quality(verdict="go"),
        zoom_f_mm=cell.zoom.table(8.0, 25.0, even=False),
        focus_extension_mm=cell.focus.table(0.1, 1.2, even=True),
        iris_a_mm=cell.iris.table(0.4, 4.0, even=False),
        pupil_offset_mm=2.4,
        d_standard_deviation_mm=0.003,
        f_standard_deviation_mm=0.005,
        a_standard_deviation_mm=0.008,
    )


def rigid(
    cell: Cell,
    schema: str,
    pose: Pose,
    sd_mm: float,
    sd_deg: float,
    **reference: float,
) -> RigidCalibration:
    spread = [sd_mm**2] * 3 + [np.radians(sd_deg) ** 2] * 3
    return RigidCalibration(
        schema=schema,
        provenance=cell.provenance(cell.arm_serial),
        quality=Quality(verdict="go", error_95_mm=round(2 * sd_mm, 3)),
        target=pose.target,
        source=pose.source,
        matrix=pose.matrix.tolist(),
        covariance=np.diag(spread).tolist(),
        **reference,
    )


def hand_eye(cell: Cell) -> RigidCalibration:
    turn = np.radians([0.4, -0.3, cell.camera_turn_deg])
    pose = Pose.from_rotvec("tool", "camera", turn, [1.8, -2.2, 104.0])
    return rigid(
        cell,
        "mvp-cell/hand-eye/1",
        pose,
        0.15,
        0.03,
        reference_d_mm=REFERENCE_D_MM,
        reference_f_mm=REFERENCE_F_MM,
    )


def part_pose(cell: Cell) -> RigidCalibration:
    """Where the arm at home sees the part, and reaches all three published views."""
    turn = np.radians([0.0, 0.0, cell.part_turn_deg])
    pose = Pose.from_rotvec("base", "part", turn, cell.part_mm)
    return rigid(cell, "mvp-cell/part-pose/1", pose, 0.15, 0.05)


def main() -> None:
    root = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    for cell in CELLS:
        models = {
            "camera": camera(cell),
            "lens_table": lens_table(cell),
            "hand_eye": hand_eye(cell),
            "part_pose": part_pose(cell),
        }
        folder = root / cell.name / "calibration"
        folder.mkdir(parents=True, exist_ok=True)
        for name, model in models.items():
            text = model.model_dump_json(by_alias=True, indent=1, exclude_none=True)
            (folder / f"{name}.json").write_text(text + "\n", encoding="utf-8")
            print(folder / f"{name}.json")


if __name__ == "__main__":
    main()
