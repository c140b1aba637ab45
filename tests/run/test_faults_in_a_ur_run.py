"""A robot, a Theia lens and a GigE camera break in the second view of a run."""

from __future__ import annotations

import os
import pty
import select
import shutil
import subprocess
import sys
import threading
import time
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import pytest

from drivers._genicam import installed_backends
from mvp.cell.loading import load_cell
from mvp.cell.places import bundled_root
from mvp.cell.records import Captured, read_records
from mvp.cli.main import invoke
from tests.run.test_faults_in_a_run import (
    JUDGED,
    Rig,
    break_in_second_view,
    check_kept,
    is_whole,
)
from tools.soak import SOAK_TASK, FarEnds

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

PERSON_S = 180
FAULTS = {
    "arm-protective-stop": ("arm", "protective_stop", None),
    "arm-drop": ("arm", "drop", "clear"),
    "lens-unplugged": ("lens", "unplug", "replug"),
    "camera-killed": ("camera", "kill", "restart"),
}
MOVES = (1, 2, 3, 4)  # moveJ, moveJ_IK, moveL, moveL_FK


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    missing = installed_backends()["aravis"]
    if missing:
        pytest.skip(f"the GigE camera is simulated by Aravis: {missing}")
    cell = tmp_path_factory.mktemp("ur") / "cell"
    bundled = bundled_root() / "simulated_ur"
    shutil.copytree(bundled, cell, copy_function=shutil.copyfile)
    (cell / "tasks" / "soak.toml").write_text(SOAK_TASK, encoding="utf-8")
    far = FarEnds(cell)
    yield Rig(cell, far)
    far.end()


def yes_to_all(words: list[str]) -> tuple[int, str]:
    """A command on a terminal whose person agrees to everything."""
    ours, its = pty.openpty()
    person = subprocess.Popen(
        [sys.executable, "-m", "mvp", *words], stdin=its, stdout=its, stderr=its
    )
    os.close(its)
    shown = b""
    end_s = time.monotonic() + PERSON_S
    while time.monotonic() < end_s:
        if select.select([ours], [], [], 0.2)[0]:
            try:
                said = os.read(ours, 4096)
            except OSError:  # the terminal's way to say that nobody has it open
                break
            shown += said
            if said.rstrip().endswith(b"[y/N]"):
                os.write(ours, b"y\n")
        elif person.poll() is not None:
            break
    with suppress(subprocess.TimeoutExpired):
        person.wait(20)
    person.kill()
    code = person.wait()
    os.close(ours)
    return code, shown.decode(errors="replace")


def make_good(rig: Rig, role: str, verb: str, remedy: str | None) -> None:
    """Take the fault away; after a stop of the robot a person leads it back."""
    if remedy is not None:
        rig.do(role, remedy)
    if role == "arm":
        code, shown = yes_to_all(["recover", str(rig.cell), "--task", "soak"])
        assert code == 0, shown


def speeds(rig: Rig) -> list[float]:
    """Of the motions that the robot was told since it was switched on."""
    commands: Any = rig.far.tell("arm", {"do": "state"})["commands"]
    return [c["values"][6] for c in commands if c["command"] in MOVES]


@pytest.mark.full
@pytest.mark.parametrize("fault", FAULTS)
def test_what_was_taken_is_kept_and_a_person_leads_the_cell_back(
    fault: str, rig: Rig, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    role, verb, remedy = FAULTS[fault]
    breaker = threading.Thread(
        target=break_in_second_view, args=(rig, tmp_path, role, verb)
    )
    breaker.start()
    words = ["run", str(rig.cell), "--task", "soak", "--partial", "--json", "--yes"]
    code = invoke([*words, "--out", str(tmp_path)])
    said = capsys.readouterr()
    breaker.join(PERSON_S)
    assert code == 4, said.err
    (folder,) = [path for path in tmp_path.iterdir() if path.is_dir()]
    check_kept(folder, role)
    make_good(rig, role, verb, remedy)
    code = invoke(["run", str(rig.cell), "--resume", str(folder), "--json", "--yes"])
    said = capsys.readouterr()
    assert code in JUDGED, said.err
    taken = [
        r for r in read_records(folder / "records.jsonl") if isinstance(r, Captured)
    ]
    assert [r.view for r in taken] == ["v1", "v2"]
    assert all(is_whole(folder, r) for r in taken)


@pytest.mark.full
def test_the_way_to_the_first_view_is_driven_slowly_and_the_rest_is_not(
    rig: Rig, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = len(speeds(rig))
    words = ["run", str(rig.cell), "--task", "soak", "--partial", "--json", "--yes"]
    code = invoke([*words, "--out", str(tmp_path)])
    said = capsys.readouterr()
    assert code in JUDGED, said.err
    driven = speeds(rig)[before:]
    (log,) = tmp_path.glob("*/log.jsonl")
    first = log.read_text().count("arm: towards v1, asked")
    full = max(driven)
    share = load_cell(str(rig.cell)).config.motion.start_speed_fraction
    assert 0 < first < len(driven)
    assert driven == pytest.approx(
        [share * full] * first + [full] * (len(driven) - first)
    )
