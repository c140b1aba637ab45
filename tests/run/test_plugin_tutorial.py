"""The plug-in of the tutorial, looked at more closely than the page itself does.

That the page's commands run is shown with those of all other pages.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[2] / "docs" / "tutorial" / "a-driver-of-your-own.md"
HEREDOC = re.compile(r"^cat >>? (\S+) <<'END'\n(.*?)^END$", re.MULTILINE | re.DOTALL)
LOOK = """
import json
from mvp.devices import list_drivers
from mvp.kinematics import arm_model, arm_model_names
import numpy as np

entry = next(e for e in list_drivers() if e.key == "acme-polar")
model = arm_model("acme_polar")
rng = np.random.default_rng(3)
low, high = model.joint_low, model.joint_high
q = rng.uniform(low, high, (400, 5))
step = rng.uniform(-1, 1, q.shape) * 1e-4 * (high - low)
before, after = model.links_batch(q), model.links_batch(q + step)
moved = np.maximum(
    np.linalg.norm(after.start_mm - before.start_mm, axis=-1),
    np.linalg.norm(after.end_mm - before.end_mm, axis=-1),
)
allowed = np.abs(step) @ model.levers_mm[:-1].T
print(json.dumps({
    "distribution": entry.distribution, "version": entry.version, "error": entry.error,
    "named": "acme_polar" in arm_model_names(),
    "within_levers": bool((moved <= allowed * (1 + 1e-3) + 1e-9).all()),
}))
"""


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files of the page."""
    folder = tmp_path_factory.mktemp("plugin")
    for name, body in HEREDOC.findall(PAGE.read_text(encoding="utf-8")):
        file = folder / name
        file.parent.mkdir(exist_ok=True)
        with file.open("a", encoding="utf-8") as out:
            out.write(body)
    return folder / "acme-polar"


def test_the_page_makes_one_file_one_test_and_two_entry_points(project: Path) -> None:
    assert sorted(p.name for p in project.iterdir()) == [
        "acme_polar.py",
        "pyproject.toml",
        "test_acme_polar.py",
    ]
    groups = tomllib.loads((project / "pyproject.toml").read_text())["project"]
    assert set(groups["entry-points"]) == {"mvp_cell.drivers", "mvp_cell.arm_models"}


def test_its_code_passes_the_linter(project: Path) -> None:
    command = [sys.executable, "-m", "ruff", "check", "--isolated", str(project)]
    command += ["--select", "E,F,B,UP,N", "--line-length", "88"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def test_installed_beside_us_it_is_found_and_its_levers_hold(project: Path) -> None:
    target = project.parent / "plugins"
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps"]
    pip += ["--no-build-isolation", "--no-index", "--target", str(target), str(project)]
    subprocess.run(pip, check=True, capture_output=True)
    done = subprocess.run(
        [sys.executable, "-c", LOOK],
        env=os.environ | {"PYTHONPATH": str(target)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert '"distribution": "acme-polar", "version": "1.0", "error": ""' in done.stdout
    assert '"named": true, "within_levers": true' in done.stdout
