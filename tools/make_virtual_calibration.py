"""Write the calibration files of the bundled virtual cell.

    python tools/make_virtual_calibration.py [FOLDER]

The numbers are a design, not a measurement: a 1280 x 1024 camera with 5 um pixels, a
parfocal 8-25 mm zoom, and the paper's object where a UR5e sees it from all sides. The
standard deviations are what the project's own calibration reaches in simulation.
"""

from __future__ import annotations

import sys
from pathlib import Path

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

FOLDER = Path(__file__).parents[1] / "cell_configs" / "virtual" / "calibration"
REFERENCE_D_MM = 12.9
REFERENCE_F_MM = 12.5


def provenance(device_serial: str) -> Provenance:
    return Provenance(
        date="2026-11-22",
        device_serial=device_serial,
        method="design values of the virtual cell",
        simulated=True,
        temperature_c=20.0,
    )


def camera() -> CameraCalibration:
    return CameraCalibration(
        schema="mvp-cell/camera/1",
        provenance=provenance("V-CAM-1"),
        quality=Quality(verdict="go", rms_px=0.05),
        width_px=1280,
        height_px=1024,
        pitch_x_um=5.0,
        pitch_y_um=5.0,
        centre_x_px=643.2,
        centre_y_px=508.7,
        k1=-0.1,
        standard_deviation={"centre_x_px": 0.4, "centre_y_px": 0.4, "k1": 0.0005},
    )


def lens_table() -> LensTableCalibration:
    zoom = np.linspace(0, 3200, 33)
    focus = np.linspace(0, 8000, 17)
    iris = np.linspace(0, 600, 25)
    return LensTableCalibration(
        schema="mvp-cell/lens-table/1",
        provenance=provenance("V-LENS-1"),
        quality=Quality(verdict="go"),
        zoom_f_mm=AxisTable(
            steps=zoom.astype(int).tolist(),
            values_mm=np.round(8.0 * (25.0 / 8.0) ** (zoom / 3200), 6).tolist(),
            backlash_steps=30,
            repeatability_steps=1.0,
        ),
        focus_extension_mm=AxisTable(
            steps=focus.astype(int).tolist(),
            values_mm=np.round(0.1 + 1.1 * focus / 8000, 6).tolist(),
            backlash_steps=40,
            repeatability_steps=2.0,
        ),
        iris_a_mm=AxisTable(
            steps=iris.astype(int).tolist(),
            values_mm=np.round(0.4 * 10.0 ** (iris / 600), 6).tolist(),
            backlash_steps=6,
            repeatability_steps=0.5,
        ),
        pupil_offset_mm=2.4,
        d_standard_deviation_mm=0.003,
        f_standard_deviation_mm=0.005,
        a_standard_deviation_mm=0.008,
    )


def rigid(
    schema: str, pose: Pose, sd_mm: float, sd_deg: float, **reference: float
) -> RigidCalibration:
    spread = [sd_mm**2] * 3 + [np.radians(sd_deg) ** 2] * 3
    return RigidCalibration(
        schema=schema,
        provenance=provenance("V-ARM-1"),
        quality=Quality(verdict="go", error_95_mm=round(2 * sd_mm, 3)),
        target=pose.target,
        source=pose.source,
        matrix=pose.matrix.tolist(),
        covariance=np.diag(spread).tolist(),
        **reference,
    )


def hand_eye() -> RigidCalibration:
    turn = np.radians([0.4, -0.3, 25.0])
    pose = Pose.from_rotvec("tool", "camera", turn, [1.8, -2.2, 104.0])
    return rigid(
        "mvp-cell/hand-eye/1",
        pose,
        0.15,
        0.03,
        reference_d_mm=REFERENCE_D_MM,
        reference_f_mm=REFERENCE_F_MM,
    )


def part_pose() -> RigidCalibration:
    """In front of a UR5e at home, which reaches all three published views."""
    turn = np.radians([0.0, 0.0, 5.0])
    pose = Pose.from_rotvec("base", "part", turn, [-520.0, -130.0, 60.0])
    return rigid("mvp-cell/part-pose/1", pose, 0.15, 0.05)


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    models = {
        "camera": camera(),
        "lens_table": lens_table(),
        "hand_eye": hand_eye(),
        "part_pose": part_pose(),
    }
    for name, model in models.items():
        text = model.model_dump_json(by_alias=True, indent=1, exclude_none=True)
        (folder / f"{name}.json").write_text(text + "\n", encoding="utf-8")
        print(folder / f"{name}.json")


if __name__ == "__main__":
    main()
