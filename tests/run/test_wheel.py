"""The wheel carries everything that a user needs in an empty folder."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


def called(*words: object, **more: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(w) for w in words],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
        **more,  # type: ignore[call-overload]
    )


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the wheel installed in it, beside the environment's libraries."""
    work = tmp_path_factory.mktemp("wheel")
    built = called(
        sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", work, cwd=ROOT
    )
    assert built.returncode == 0, built.stderr
    (wheel,) = work.glob("mvp_cell-*.whl")
    target = work / "site"
    options = ("--no-deps", "--no-index", "--quiet", "--target", target)
    done = called(sys.executable, "-m", "pip", "install", *options, wheel)
    assert done.returncode == 0, done.stderr
    return target


def mvp_cell(site: Path, folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """The installed command in another folder; the checkout is out of the way."""
    folder.mkdir(exist_ok=True)
    environment = os.environ | {"PYTHONPATH": str(site), "PYTHONSAFEPATH": "1"}
    code = "from mvp.cli.main import main; main()"
    return called(sys.executable, "-c", code, *words, cwd=folder, env=environment)


def test_the_wheel_holds_packages_cells_and_nothing_else(site: Path) -> None:
    names = {p.name for p in site.iterdir() if not p.name.endswith(".dist-info")}
    assert names - {"bin"} == {"mvp", "drivers", "calibration"}
    cells = site / "mvp" / "_data" / "cell_configs"
    assert (cells / "virtual" / "cell.toml").is_file()
    assert (cells / "schema" / "plan.json").is_file()
    assert not list(site.rglob("test_*.py"))


def test_a_bundled_cell_is_found_from_the_wheel_in_an_empty_folder(
    site: Path, tmp_path: Path
) -> None:
    done = mvp_cell(site, tmp_path / "empty", "init", "mine", "--json")
    assert done.returncode == 0, done.stderr
    files = json.loads(done.stdout)["files"]
    assert "cell.toml" in files
    assert "calibration/hand_eye.json" in files
    listed = mvp_cell(site, tmp_path / "empty", "drivers", "--json")
    drivers = json.loads(listed.stdout)["drivers"]
    assert {d["key"] for d in drivers} >= {"virtual-arm", "virtual-camera"}
    assert not [d["error"] for d in drivers if d["error"]]


def test_a_wheel_without_its_bundled_cells_says_so(site: Path, tmp_path: Path) -> None:
    broken = tmp_path / "site"
    shutil.copytree(site, broken)
    shutil.rmtree(broken / "mvp" / "_data")
    done = mvp_cell(broken, tmp_path / "empty", "init", "mine", "--json")
    document = json.loads(done.stdout)
    assert done.returncode == document["code"] == 2
    assert "no bundled" in document["message"]
    assert "Traceback" not in done.stderr


@pytest.mark.full
def test_the_main_job_runs_from_the_wheel_in_an_empty_folder(
    site: Path, tmp_path: Path
) -> None:
    done = mvp_cell(site, tmp_path / "empty", "run", "virtual", "--json")
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert document["status"] == "verified"
    assert Path(document["folder"]).parent == tmp_path / "empty" / "runs"
