"""A whole camera session on an uncalibrated virtual cell, with everything in its way."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calibration.wizard.session_store import SessionStore
from mvp.calibrated import CameraCalibration, LensTableCalibration
from mvp.cell.init_job import copy_cell
from mvp.cli.main import invoke
from mvp.optics import LensTable, principal_distance_mm

_DEAD = "\n[world.faults.camera]\ndead_after_frames = 3\n"


def quick_cell(folder: Path) -> Path:
    """An uncalibrated cell whose clock runs faster."""
    copy_cell("virtual_uncalibrated", folder)
    file = folder / "cell.toml"
    text = file.read_text().replace("clock_speed = 10.0", "clock_speed = 100.0")
    assert "clock_speed = 100.0" in text
    file.write_text(text)
    return file


def said(capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    document = json.loads(capsys.readouterr().out)
    assert isinstance(document, dict)
    return document


def calibrate(*words: str) -> int:
    return invoke(["calibrate", "camera", *words, "--auto", "--yes", "--json"])


def samples_in(folder: Path) -> int:
    file = folder / "samples.jsonl"
    return file.read_text().count("\n") if file.exists() else 0


def killed_after(cell: Path, session: Path, more: int) -> None:
    """Resume in a process of its own, and kill it without warning."""
    wanted = samples_in(session) + more
    words = ["calibrate", "camera", str(cell), "--resume", "--auto", "--yes"]
    process = subprocess.Popen(
        [sys.executable, "-m", "mvp", *words],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )
    try:
        until = time.monotonic() + 120
        while samples_in(session) < wanted and time.monotonic() < until:
            if process.poll() is not None:
                raise AssertionError(process.communicate()[1].decode())
            time.sleep(0.02)
    finally:
        process.send_signal(signal.SIGKILL)
        process.communicate()


def true_camera(cell: Path) -> CameraCalibration:
    """What is true, with the principal distance at the session's lens setting."""
    truth = cell.parent / "truth"
    camera = CameraCalibration.model_validate_json((truth / "camera.json").read_bytes())
    table = LensTableCalibration.model_validate_json(
        (truth / "lens_table.json").read_bytes()
    )
    (session,) = (cell.parent / "calibration" / "sessions").iterdir()
    steps = SessionStore.open(session).samples[0].lens_steps
    lens = LensTable.from_calibration(table).setting(**steps)
    f_cal = float(principal_distance_mm(lens.d_mm, lens.f_mm, lens.e_mm))
    focal_px = f_cal * 1000 / camera.pitch_x_um
    return camera.model_copy(update={"reference_fx_px": focal_px})


def test_a_session_survives_a_dead_camera_and_a_kill_and_tells_the_truth(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cell = quick_cell(tmp_path / "cell")
    placed = cell.parent / "calibration" / "camera.json"
    nominal = placed.read_bytes()
    healthy = cell.read_text()

    # The camera dies: exit 4, and the way on is told.
    cell.write_text(healthy + _DEAD)
    assert calibrate(str(cell)) == 4
    error = said(capsys)
    assert "--resume" in error["hint"]
    assert placed.read_bytes() == nominal
    cell.write_text(healthy)
    (session,) = (cell.parent / "calibration" / "sessions").iterdir()
    assert samples_in(session) >= 1

    # The power goes: what was taken stays; half a line and half a picture do not count.
    killed_after(cell, session, more=2)
    kept = samples_in(session)
    with (session / "samples.jsonl").open("a") as file:
        file.write('{"schema": "mvp-cell/cal')
    (session / "images" / f"{kept + 1:03d}.png").write_bytes(b"half a picture")

    # To its end.
    assert calibrate(str(cell), "--resume") == 0
    result = said(capsys)
    assert result["verdict"] == "go"
    assert Path(result["session"]) == session
    assert Path(result["kept"]).read_bytes() == nominal
    store = SessionStore.open(session)
    assert [s.number for s in store.samples] == list(range(1, store.count + 1))
    assert len({s.sha256 for s in store.samples}) == store.count
    assert len(store.usable("verification")) >= 3
    assert (session / "report.html").stat().st_size > 10_000

    # The truth is inside the stated interval: all free numbers together, 99.9 %.
    found = CameraCalibration.model_validate_json(placed.read_bytes())
    assert found.provenance.origin == "measured"
    _inside(found, true_camera(cell))

    # Once more without a device, to the last digit; nothing is put in place.
    assert (
        invoke(["calibrate", "camera", str(cell), "--session", str(session), "--json"])
        == 0
    )
    again = said(capsys)
    assert again["document"] == result["document"]
    assert again["same_numbers"] is True
    assert again["placed"] is None


@pytest.mark.full
@pytest.mark.parametrize("kind", ["chessboard", "circle-grid"])
def test_a_target_that_looks_the_same_from_its_other_end_is_read_in_order(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cell = quick_cell(tmp_path / "cell")
    text = cell.read_text().replace('kind = "charuco"', f'kind = "{kind}"')
    text = re.sub(r"(?m)^(marker_mm|dictionary) .*\n", "", text)
    text = re.sub(r"(?m)^columns = 12", "columns = 10", text)
    cell.write_text(re.sub(r"(?m)^rows = 9", "rows = 7", text))
    assert calibrate(str(cell)) == 0
    assert said(capsys)["verdict"] == "go"
    placed = (cell.parent / "calibration" / "camera.json").read_bytes()
    _inside(CameraCalibration.model_validate_json(placed), true_camera(cell))


@pytest.mark.full
@pytest.mark.timeout(1800)
def test_the_truth_is_inside_the_interval_whatever_views_are_taken(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    distances = []
    for seed in range(1, 9):
        cell = quick_cell(tmp_path / f"cell {seed}")
        assert calibrate(str(cell), "--seed", str(seed)) == 0
        found = CameraCalibration.model_validate(said(capsys)["document"])
        distances.append(_inside(found, true_camera(cell)))
    # Eight times seven numbers: 99.9 % of sums of chi squares lie between.
    assert 27.5 < sum(distances) < 97.5


def _inside(found: CameraCalibration, true: CameraCalibration) -> float:
    """Mahalanobis distance of all free numbers, below the 99.9 % point."""
    assert found.covariance is not None
    names = {
        "fx_px": "reference_fx_px",
        "cx_px": "centre_x_px",
        "cy_px": "centre_y_px",
    }
    wanted = [*names, "k1", "k2", "p1", "p2"]
    rows = [found.covariance.parameters.index(name) for name in wanted]
    spread = np.array(found.covariance.matrix)[np.ix_(rows, rows)]
    error = np.array(
        [
            getattr(found, names.get(n, n)) - getattr(true, names.get(n, n))
            for n in wanted
        ]
    )
    distance = float(error @ np.linalg.solve(spread, error))
    assert distance < 24.3
    assert abs(true.centre_x_px - 319.5) > 3  # the data sheet would not do
    return distance
