"""Camera files of other programs and the cells that they are for, for tests."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, TypeAlias

from mvp.calibrated import CameraCalibration
from mvp.cli.main import invoke

if TYPE_CHECKING:
    from pathlib import Path

    import pytest

Capture: TypeAlias = "pytest.CaptureFixture[str]"

FORMATS = ("opencv", "ros", "kalibr")
STEPS = "1300,3000,120"
# Nodes of the virtual cell's lens table: f and d - f there, and e.
F_MM, X_MM, E_MM = 12.709334, 0.5125, 2.4
FX_PX = (F_MM + X_MM - E_MM * X_MM / F_MM) / 0.005
TERMS = {"k1": -0.1, "k2": 0.02, "p1": 1e-05, "p2": -2.5e-05, "k3": -3e-05}


def changed(cell: Path, name: str, **values: object) -> Path:
    path = cell / "calibration" / f"{name}.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | values))
    return path


def camera_of(cell: Path) -> CameraCalibration:
    text = (cell / "calibration" / "camera.json").read_text()
    return CameraCalibration.model_validate_json(text)


def told(capsys: Capture, *line: object, code: int = 0) -> dict[str, Any]:
    capsys.readouterr()
    assert invoke([*map(str, line), "--json"]) == code
    found = json.loads(capsys.readouterr().out)
    assert isinstance(found, dict)
    return found


def exported(cell: Path, form: str, *more: str) -> Path:
    out = cell.parent / f"{form}.yaml"
    line = ["export-camera", str(cell), "--to", form, "--out", str(out)]
    assert invoke([*line, *(more or ("--at", STEPS))]) == 0
    return out
