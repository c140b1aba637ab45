"""Write the files of the virtual cell: what its calibration would have found.

The belief files are those of a perfectly calibrated cell; the truth of the virtual
world (``[world]`` in cell.toml) may differ from them by configurable errors.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

from mvp.geometry import Pose
from mvp.scene import paper_object

ROOT = Path(__file__).resolve().parents[1]
DATE = "2026-01-05"
GO = {"verdict": "go", "rms_px": 0.05, "reasons": []}


def provenance(serial: str, method: str) -> dict[str, object]:
    return {
        "date": DATE,
        "device_serial": serial,
        "method": method,
        "simulated": True,
        "temperature_c": 21.0,
    }


def camera() -> dict[str, object]:
    return {
        "schema": "mvp-cell/camera/1",
        "provenance": provenance("VC-1", "nominal"),
        "quality": GO,
        "width_px": 1280,
        "height_px": 1024,
        "pitch_x_um": 5.0,
        "pitch_y_um": 5.0,
        "centre_x_px": 641.3,
        "centre_y_px": 509.8,
        "k1": -0.08,
        "k2": 0.02,
    }


def axis(low: float, high: float, steps: int, bend: float) -> dict[str, object]:
    """Seventeen nodes of a slightly bent, strictly rising curve."""
    nodes = np.linspace(0, steps, 17).round().astype(int)
    share = nodes / steps
    values = low + (high - low) * (share + bend * share * (1 - share))
    return {
        "steps": nodes.tolist(),
        "values_mm": values.round(6).tolist(),
        "approach": "from_below",
        "backlash_steps": 12,
        "repeatability_steps": 0.5,
    }


def lens_table() -> dict[str, object]:
    return {
        "schema": "mvp-cell/lens-table/1",
        "provenance": provenance("VL-1", "nominal"),
        "quality": GO,
        "zoom_f_mm": axis(8.0, 25.0, 8000, 0.2),
        "focus_extension_mm": axis(0.1, 1.2, 6000, 0.1),
        "iris_a_mm": axis(0.4, 4.0, 1800, 0.3),
        "pupil_offset_mm": 2.4,
        "d_standard_deviation_mm": 0.004,
        "f_standard_deviation_mm": 0.006,
        "a_standard_deviation_mm": 0.005,
    }


def rigid(kind: str, pose: Pose, method: str, **more: float) -> dict[str, object]:
    return {
        "schema": f"mvp-cell/{kind}/1",
        "provenance": provenance("VA-1", method),
        "quality": {"verdict": "go", "rms_mm": 0.05, "reasons": []},
        "target": pose.target,
        "source": pose.source,
        "matrix": pose.matrix.round(9).tolist(),
        **more,
    }


def hand_eye() -> dict[str, object]:
    turn = np.radians([0.4, -0.3, 25.0])
    pose = Pose.from_rotvec("tool", "camera", turn, [1.8, -2.2, 104.0])
    return rigid("hand-eye", pose, "nominal", reference_d_mm=13.0, reference_f_mm=12.5)


def part_pose() -> dict[str, object]:
    turn = np.radians([0.0, 0.0, 90.0])
    pose = Pose.from_rotvec("base", "part", turn, [430.0, 60.0, 60.0])
    return rigid("part-pose", pose, "nominal")


def write_stl(path: Path) -> None:
    mesh = paper_object()
    records = np.zeros(
        len(mesh.faces),
        dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("unused", "<u2")],
    )
    records["normal"] = mesh.normals
    records["corners"] = mesh.triangles_mm
    header = b"paper object, mm".ljust(80, b" ")
    count = np.array([len(records)], dtype="<u4").tobytes()
    path.write_bytes(header + count + records.tobytes())


def main(folder: Path) -> None:
    for part in ("calibration", "parts"):
        (folder / part).mkdir(parents=True, exist_ok=True)
    files = {
        "camera": camera(),
        "lens_table": lens_table(),
        "hand_eye": hand_eye(),
        "part_pose": part_pose(),
    }
    for name, content in files.items():
        text = json.dumps(content, indent=1) + "\n"
        (folder / "calibration" / f"{name}.json").write_text(text)
    write_stl(folder / "parts" / "paper_object.stl")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "cell_configs" / "virtual")
