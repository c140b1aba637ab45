"""Write the calibration files of the bundled cells.

    python tools/make_cell_calibrations.py [FOLDER]

The numbers are a design, not a measurement: a 1280 x 1024 camera with 5 um pixels,
binned 2 x 2 where far ends are simulated, because that draws four times as fast; a
parfocal 8-25 mm zoom behind three different controllers; and the paper's object where
the arm of the cell sees it from all sides. The standard deviations are what the
project's own calibration reaches in simulation.

`virtual_uncalibrated` believes what data sheets and drawings say; its folder `truth` says
what is true in its world, as far off as parts as bought and mounted by hand are.
`simulated_ur` has the folder as well, so that calibrating it moves its belief alone.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

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

Models: TypeAlias = dict[
    str, CameraCalibration | LensTableCalibration | RigidCalibration
]
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
    has_truth: bool = False

    def provenance(self, device_serial: str) -> Provenance:
        return Provenance(
            date="2026-11-22",
            device_serial=device_serial,
            method=f"design values of the {self.name} cell",
            simulated=True,
            temperature_c=20.0,
        )


@dataclass(frozen=True)
class Values:
    """Where a cell's calibrations differ from the design."""

    centre_px: tuple[float, float]
    k1: float
    f_mm: tuple[float, float]
    extension_mm: tuple[float, float]
    a_mm: tuple[float, float]
    pupil_offset_mm: float
    hand_turn_deg: tuple[float, float, float]
    hand_mm: tuple[float, float, float]
    part_turn_deg: tuple[float, float, float]
    part_mm: tuple[float, float, float]


# Middle of the sensor, engraved focal lengths, the drawing of the bracket, a tape measure.
NOMINAL = Values(
    centre_px=(319.5, 255.5),
    k1=0.0,
    f_mm=(8.0, 25.0),
    extension_mm=(0.1, 1.2),
    a_mm=(0.7, 2.5),
    pupil_offset_mm=0.0,
    hand_turn_deg=(0.0, 0.0, 25.0),
    hand_mm=(0.0, 0.0, 104.0),
    part_turn_deg=(0.0, 0.0, 5.0),
    part_mm=(-520.0, -130.0, 60.0),
)
TRUE = Values(
    centre_px=(323.4, 252.2),
    k1=-0.1,
    f_mm=(8.11, 25.43),
    extension_mm=(0.128, 1.243),
    a_mm=(0.684, 2.43),
    pupil_offset_mm=2.4,
    hand_turn_deg=(0.5, -0.35, 25.4),
    hand_mm=(1.5, -1.6, 105.2),
    part_turn_deg=(0.45, -0.3, 5.8),
    part_mm=(-517.4, -132.7, 61.6),
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
        has_truth=True,
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


def uncalibrated(values: Values, provenance: Provenance, quality: Quality) -> Models:
    """The calibrations of `virtual_uncalibrated`: as believed, or as they are."""
    measured = provenance.origin == "measured"
    zoom = Motor(0, 3200, 33, 30, 1.0).table(*values.f_mm, even=False)
    focus = Motor(0, 8000, 17, 40, 2.0).table(*values.extension_mm, even=True)
    iris = Motor(0, 600, 25, 6, 0.5).table(*values.a_mm, even=True)
    hand = Pose.from_rotvec(
        "tool", "camera", np.radians(values.hand_turn_deg), values.hand_mm
    )
    part = Pose.from_rotvec(
        "base", "part", np.radians(values.part_turn_deg), values.part_mm
    )
    return {
        "camera": CameraCalibration(
            schema="mvp-cell/camera/1",
            provenance=made_with(provenance, "V-CAM-1"),
            quality=quality,
            width_px=640,
            height_px=512,
            pitch_x_um=10.0,
            pitch_y_um=10.0,
            centre_x_px=values.centre_px[0],
            centre_y_px=values.centre_px[1],
            k1=values.k1,
            standard_deviation={}
            if measured
            else {"centre_x_px": 5.0, "centre_y_px": 5.0, "k1": 0.15},
        ),
        "lens_table": LensTableCalibration(
            schema="mvp-cell/lens-table/1",
            provenance=made_with(provenance, "V-LENS-1"),
            quality=quality,
            zoom_f_mm=zoom,
            focus_extension_mm=focus,
            iris_a_mm=iris,
            pupil_offset_mm=values.pupil_offset_mm,
            d_standard_deviation_mm=0.0 if measured else 0.25,
            f_standard_deviation_mm=0.0 if measured else 0.25,
            a_standard_deviation_mm=0.0 if measured else 0.1,
            pupil_offset_standard_deviation_mm=0.0 if measured else 3.0,
        ),
        "hand_eye": rigid_of(
            "mvp-cell/hand-eye/1",
            made_with(provenance, "V-ARM-1"),
            quality,
            hand,
            None if measured else (2.0, 1.0),
            reference_d_mm=REFERENCE_D_MM,
            reference_f_mm=REFERENCE_F_MM,
        ),
        "part_pose": rigid_of(
            "mvp-cell/part-pose/1",
            made_with(provenance, "V-ARM-1"),
            quality,
            part,
            None if measured else (4.0, 1.0),
        ),
    }


def made_with(provenance: Provenance, serial: str) -> Provenance:
    return provenance.model_copy(update={"device_serial": serial})


def rigid_of(
    schema: str,
    provenance: Provenance,
    quality: Quality,
    pose: Pose,
    spread_mm_deg: tuple[float, float] | None,
    **reference: float,
) -> RigidCalibration:
    covariance = None
    if spread_mm_deg is not None:
        mm, deg = spread_mm_deg
        covariance = np.diag([mm**2] * 3 + [np.radians(deg) ** 2] * 3).tolist()
    return RigidCalibration(
        schema=schema,
        provenance=provenance,
        quality=quality,
        target=pose.target,
        source=pose.source,
        matrix=pose.matrix.tolist(),
        covariance=covariance,
        **reference,
    )


def designed(cell: Cell) -> Models:
    """A cell whose calibrations are its design values."""
    return {
        "camera": camera(cell),
        "lens_table": lens_table(cell),
        "hand_eye": hand_eye(cell),
        "part_pose": part_pose(cell),
    }


def write(folder: Path, models: Models) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name, model in models.items():
        text = model.model_dump_json(by_alias=True, indent=1, exclude_none=True)
        (folder / f"{name}.json").write_text(text + "\n", encoding="utf-8")
        print(folder / f"{name}.json")


def write_uncalibrated(root: Path) -> None:
    nominal = Provenance(
        date="2026-11-22",
        device_serial="",
        method="data sheets, drawings and a tape measure",
        simulated=True,
        origin="nominal",
    )
    reason = "nominal: from data sheets and drawings; nothing of this cell was measured"
    poor = Quality(
        verdict="marginal", reasons=[reason], next_action="calibrate this cell"
    )
    truth = Provenance(
        date="2026-11-22",
        device_serial="",
        method="what is true in the simulated world",
        simulated=True,
    )
    write(root / "calibration", uncalibrated(NOMINAL, nominal, poor))
    write(root / "truth", uncalibrated(TRUE, truth, Quality(verdict="go")))


def main() -> None:
    root = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    for cell in CELLS:
        write(root / cell.name / "calibration", designed(cell))
        if cell.has_truth:
            write(root / cell.name / "truth", designed(cell))
    write_uncalibrated(root / "virtual_uncalibrated")


if __name__ == "__main__":
    main()
