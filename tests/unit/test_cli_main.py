"""The command itself: what help costs, and how it answers to signals and people."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from typing import TYPE_CHECKING

import pytest

from mvp.cell.places import bundled_root
from mvp.cell.run_document import RunDocument, VerificationDocument, ViewDocument
from mvp.cell.session import Motion
from mvp.cli.ask import allow_motion
from mvp.cli.main import invoke
from mvp.cli.tables import print_plan, print_run
from mvp.devices import DeviceInfo
from mvp.errors import UsageError
from mvp.planning.plan import LensSteps, Margin, Plan, PlannedView, Tolerance

if TYPE_CHECKING:
    from pathlib import Path

HEAVY = ("cv2", "scipy", "trimesh", "igl", "matplotlib", "embreex", "manifold3d")


def test_help_imports_no_heavy_library() -> None:
    code = (
        "import sys; from mvp.cli.main import invoke; invoke(['--help']);"
        f"heavy = [m for m in {HEAVY!r} if m in sys.modules];"
        "sys.exit(f'imported {heavy}' if heavy else 0)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "run" in done.stdout


def test_every_command_of_the_contract_has_help(
    capsys: pytest.CaptureFixture[str],
) -> None:
    for name in "run plan features check home recover truth drivers devices init runs report export-camera import-camera".split():
        assert invoke([name, "--help"]) == 0
        told = capsys.readouterr().out
        assert "Usage: mvp-cell" in told
        assert "{" not in told


def test_help_says_where_tables_and_json_go(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert invoke(["--help"]) == 0
    assert "Tables and messages go to stderr" in capsys.readouterr().out
    assert invoke(["plan", "--help"]) == 0
    told = capsys.readouterr().out
    assert "--task TASK" in told
    assert "--seed N" in told
    assert "[OPTIONS] CELL" in told


def test_no_arguments_show_the_help_and_count_as_usage() -> None:
    assert invoke([]) == 2


def test_version_is_the_distributions(capsys: pytest.CaptureFixture[str]) -> None:
    from importlib.metadata import version

    assert invoke(["--version"]) == 0
    assert capsys.readouterr().out.split() == ["mvp-cell", version("mvp-cell")]


def test_no_table_shows_a_negative_zero(capsys: pytest.CaptureFixture[str]) -> None:
    tiny = -1e-9
    tolerance = Tolerance(position_mm=0.0, angle_deg=0.0, d_mm=0.0, method="m")
    planned = PlannedView.model_construct(
        id="v1",
        features=["e"],
        position_mm=(tiny, tiny, tiny),
        f_mm=1.0,
        d_mm=1.0,
        a_mm=1.0,
        lens_steps=LensSteps(zoom=0, focus=0, iris=0),
        margins={"lens_range": Margin(value=tiny, unit="steps", normalised=tiny)},
        binding="lens_range",
        tolerance=tolerance,
    )
    print_plan(Plan.model_construct(status="partial", views=[planned]))
    edge = {"feature": "e", "predicted_px": tiny, "measured_px": tiny}
    judged = VerificationDocument(edges=[edge], verdict="pass")
    view = ViewDocument(id="v1", features=[], status="verified", verification=judged)
    print_run(
        RunDocument.model_construct(
            status="verified", run_id="r", folder=None, views=[view]
        )
    )
    told = capsys.readouterr().err
    assert "0.00 steps" in told
    assert "e: 0.00 / 0.00" in told
    assert "-0.0" not in told


def test_debug_shows_the_traceback(capsys: pytest.CaptureFixture[str]) -> None:
    assert invoke(["--debug", "plan", "nowhere"]) == 2
    assert "Traceback" in capsys.readouterr().err


def motion(*, simulated: bool) -> Motion:
    info = DeviceInfo("arm", "arm-x", "X", "1", "1", simulated=simulated)
    return Motion("cell", 3, {"arm": info})


def test_real_motion_needs_a_person_or_yes() -> None:
    assert allow_motion(motion(simulated=True), yes=False)
    assert allow_motion(motion(simulated=False), yes=True)
    with pytest.raises(UsageError, match="nobody can be asked"):
        allow_motion(motion(simulated=False), yes=False)


@pytest.mark.parametrize(
    ("number", "presses"),
    [
        pytest.param(signal.SIGINT, 1, marks=pytest.mark.full),
        (signal.SIGINT, 5),
        pytest.param(signal.SIGTERM, 1, marks=pytest.mark.full),
    ],
)
def test_ctrl_c_during_a_run_exits_6_with_one_document(
    number: signal.Signals, presses: int, tmp_path: Path
) -> None:
    cell = tmp_path / "cell"
    shutil.copytree(bundled_root() / "virtual", cell, copy_function=shutil.copyfile)
    code = "from mvp.cli.main import main; main()"
    process = subprocess.Popen(
        [sys.executable, "-c", code, "run", str(cell), "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        cwd=tmp_path,
        text=True,
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
    )
    deadline = time.monotonic() + 120
    while time.monotonic() < deadline and process.poll() is None:
        records = list(tmp_path.glob("runs/*/records.jsonl"))
        if records and "view_started" in records[0].read_text():
            break
        time.sleep(0.05)
    for _ in range(presses):
        process.send_signal(number)
        time.sleep(0.1)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 6, err
    document = json.loads(out)
    assert document["code"] == 6
    assert "Traceback" not in err
    (folder,) = tmp_path.glob("runs/*/run.json")
    assert json.loads(folder.read_text())["status"] == "aborted"
    assert document["folder"] == str(folder.parent)
    assert err.count("error: stopped by the operator") == 1
    command = f"mvp-cell run cell --out runs --resume {folder.parent.name}"
    assert f"go on with: {command}\n" in err
    assert err.index("go on with") < err.index("kept in")


@pytest.mark.parametrize("presses", [1, 2])
def test_ctrl_c_during_another_command_exits_6_with_one_message(presses: int) -> None:
    code = (
        "import os, signal; import mvp.cell.loading as l; from mvp.cli import main;"
        "press = lambda: os.kill(os.getpid(), signal.SIGINT);"
        "l.load_cell = lambda *a, **k: press();"
        "tell = main.report_error;"
        f"main.report_error = lambda *a, **k: [{presses} > 1 and press(), tell(*a, **k)][1];"
        "main.main()"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, "plan", "virtual", "--json"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 6, done.stderr
    document = json.loads(done.stdout)
    assert document["code"] == 6
    assert document["message"] == "stopped by the operator"
    assert done.stderr.strip() == "error: stopped by the operator"


def test_check_names_every_device_that_is_away(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cell = tmp_path / "cell"
    shutil.copytree(bundled_root() / "virtual", cell, copy_function=shutil.copyfile)
    assert invoke(["check", str(cell), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["passed"]
    with (cell / "cell.toml").open("a") as file:
        file.write("\n[world.faults.arm]\nunreachable = true\n")
        file.write("[world.faults.camera]\nunreachable = true\n")
    assert invoke(["check", str(cell), "--json"]) == 4
    document = json.loads(capsys.readouterr().out)
    failed = [item["name"] for item in document["items"] if not item["passed"]]
    assert failed == ["arm", "camera"]


def test_check_compares_every_serial_a_calibration_names(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cell = tmp_path / "cell"
    shutil.copytree(bundled_root() / "virtual", cell, copy_function=shutil.copyfile)
    for name in ("camera", "lens_table", "hand_eye", "part_pose"):
        file = cell / "calibration" / f"{name}.json"
        content = json.loads(file.read_text())
        content["provenance"]["device_serial"] = f"of {name}"
        file.write_text(json.dumps(content))
    assert invoke(["check", str(cell), "--json"]) == 2
    document = json.loads(capsys.readouterr().out)
    (failed,) = [item for item in document["items"] if not item["passed"]]
    for name, serial in (
        ("camera", "V-CAM-1"),
        ("lens_table", "V-LENS-1"),
        ("hand_eye", "V-ARM-1"),
        ("part_pose", "V-ARM-1"),
    ):
        assert f"{name}.json" in failed["detail"]
        assert f"of {name}, but" in failed["detail"]
        assert serial in failed["detail"]


def test_true_errors_of_a_simulated_cell_are_shown_beside_their_intervals(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert invoke(["truth", "virtual_uncalibrated", "--json"]) == 0
    told = capsys.readouterr()
    document = json.loads(told.out)
    assert document["schema"] == "mvp-cell/truth/1"
    assert {one["file"] for one in document["values"]} == {
        "camera",
        "lens_table",
        "hand_eye",
        "part_pose",
    }
    stated = [one for one in document["values"] if one["stated"] is not None]
    inside = [one for one in stated if abs(one["error"]) <= one["stated"]]
    assert (document["stated"], document["inside"]) == (len(stated), len(inside))
    assert f"{len(inside)} of {len(stated)} lie inside of what is stated" in told.err


def test_nobody_knows_the_truth_of_a_real_cell(
    capsys: pytest.CaptureFixture[str],
) -> None:
    template = bundled_root() / "templates" / "ur_theia_genicam"
    assert invoke(["truth", str(template), "--json"]) == 2
    assert "nobody knows what is true" in json.loads(capsys.readouterr().out)["message"]


def test_home_moves_lens_and_arm(capsys: pytest.CaptureFixture[str]) -> None:
    assert invoke(["home", "virtual", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["schema"] == "mvp-cell/home/1"
    assert len(document["joints"]) == 6
