"""A device breaks in the second view of a run over real wires; the run goes on later."""

from __future__ import annotations

import hashlib
import json
import select
import shutil
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import pytest

from drivers.simulators.control import ControlClient
from mvp.cell.places import bundled_root
from mvp.cell.records import Captured, Fault, RunFinished, ViewStarted, read_records
from mvp.cli.main import invoke

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

TASK = """
schema_version = 1
name = "two views"
[part]
file = "../parts/paper_object.stl"
units = "mm"
[resolution]
detail_mm = 0.5
[lens]
f_mm = 12.5
a_mm = 0.78125
[[features]]
id = "inside"
kind = "edge"
from_mm = [-12.7, 0.0, 12.7]
to_mm = [12.7, 0.0, 12.7]
[[features]]
id = "outside"
kind = "edge"
from_mm = [-101.6, -101.6, -19.05]
to_mm = [-101.6, 101.6, -19.05]
resolution = { detail_mm = 1.0 }
"""
# Slow enough to be met on its way, and patient with a computer that does more than this.
SPEEDS = (
    ("speed_scale = 4 ", "speed_scale = 2 "),
    ("latency_s = 1.5 ", "latency_s = 4.0 "),
)
START_S, VIEW_S = 120, 240
# Whether the second view, which looks along a face, can be measured is not the subject.
JUDGED = (0, 5)


@dataclass(frozen=True)
class Rig:
    """A simulated cell whose far ends live in a process of their own."""

    cell: Path
    ports: dict[str, int]

    def do(self, role: str, verb: str, **keys: object) -> None:
        with ControlClient(self.ports[role]) as faults:
            faults.do(verb, **keys)


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    folder = tmp_path_factory.mktemp("faults") / "cell"
    shutil.copytree(bundled_root() / "simulated_gantry", folder)
    text = (folder / "cell.toml").read_text(encoding="utf-8")
    for old, new in SPEEDS:
        assert old in text
        text = text.replace(old, new)
    (folder / "cell.toml").write_text(text, encoding="utf-8")
    (folder / "tasks" / "two.toml").write_text(TASK, encoding="utf-8")
    words = ["simulate", str(folder), "--task", "two"]
    process = subprocess.Popen(
        [sys.executable, "-m", "mvp", *words],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    assert process.stdout is not None
    try:
        assert select.select([process.stdout], [], [], START_S)[0]
        said = json.loads(process.stdout.readline().removeprefix(b"READY "))
        ports = {role: one["control_port"] for role, one in said["devices"].items()}
        yield Rig(folder, ports)
    finally:
        process.terminate()
        process.wait(60)
        process.stdout.close()


def break_in_second_view(rig: Rig, out: Path, role: str, verb: str) -> None:
    """Wait until the second view has begun, then bring the fault about."""
    end_s = time.monotonic() + VIEW_S
    while time.monotonic() < end_s:
        for records in out.glob("*/records.jsonl"):
            if '"view_started"' in records.read_text().rpartition('"captured"')[2]:
                started = [
                    r for r in read_records(records) if isinstance(r, ViewStarted)
                ]
                if started and started[-1].view == "v2":
                    rig.do(role, verb)
                    return
        time.sleep(0.01)


FAULTS = {
    "arm": ("unplug", "replug"),
    "lens": ("unplug", "replug"),
    "camera": ("kill", "restart"),
}


@pytest.mark.full
@pytest.mark.parametrize("role", FAULTS)
def test_a_fault_in_the_second_view_keeps_the_first_and_the_run_is_resumed(
    role: str, rig: Rig, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    verb, remedy = FAULTS[role]
    breaker = threading.Thread(
        target=break_in_second_view, args=(rig, tmp_path, role, verb)
    )
    breaker.start()
    words = ["run", str(rig.cell), "--task", "two", "--partial", "--json"]
    code = invoke([*words, "--out", str(tmp_path)])
    said = capsys.readouterr()
    breaker.join(VIEW_S)
    assert code == 4, said.err
    (folder,) = [path for path in tmp_path.iterdir() if path.is_dir()]
    check_kept(folder, role)
    rig.do(role, remedy)
    code = invoke(["run", str(rig.cell), "--resume", str(folder), "--json"])
    said = capsys.readouterr()
    assert code in JUDGED, said.err
    records = read_records(folder / "records.jsonl")
    taken = [r for r in records if isinstance(r, Captured)]
    assert [r.view for r in taken] == ["v1", "v2"]
    assert all(is_whole(folder, r) for r in taken)


def check_kept(folder: Path, role: str) -> None:
    """The first view is there, the fault is told, and what may still move."""
    records = read_records(folder / "records.jsonl")
    (taken,) = [r for r in records if isinstance(r, Captured)]
    assert taken.view == "v1"
    assert is_whole(folder, taken)
    assert [r.where for r in records if isinstance(r, Fault)] == [role]
    begun = [r.view for r in records if isinstance(r, ViewStarted)]
    assert begun == ["v1", "v2"]
    end = records[-1]
    assert isinstance(end, RunFinished)
    assert end.reason == "fault"
    document = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    assert document["status"] == "fault"
    if role == "arm":
        assert "the arm" in document["may_still_move"]


def is_whole(folder: Path, taken: Captured) -> bool:
    image = (folder / taken.image).read_bytes()
    return hashlib.sha256(image).hexdigest() == taken.sha256
