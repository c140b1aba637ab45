"""A device breaks in the second view of a run over real wires; the run goes on later."""

from __future__ import annotations

import hashlib
import json
import threading
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import pytest

from mvp.cell.records import Captured, Fault, RunFinished, ViewStarted, read_records
from mvp.cli.main import invoke
from tools.soak import FarEnds, cell_in

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

VIEW_S = 240
# The views are taken and judged; what the small pictures prove is not the subject.
JUDGED = (0, 5)


@dataclass(frozen=True)
class Rig:
    """A simulated cell whose far ends live in a process of their own."""

    cell: Path
    far: FarEnds

    def do(self, role: str, verb: str) -> None:
        self.far.tell(role, {"do": verb})


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    cell = cell_in(tmp_path_factory.mktemp("faults"))
    far = FarEnds(cell)
    yield Rig(cell, far)
    far.end()


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
    words = ["run", str(rig.cell), "--task", "soak", "--partial", "--json"]
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


def press_while_the_lens_moves(rig: Rig, out: Path, seen: list[str]) -> None:
    """Close a limit switch of the gantry while it stands in the second view."""
    end_s = time.monotonic() + VIEW_S
    while time.monotonic() < end_s:
        for log in out.glob("*/log.jsonl"):
            said = log.read_text()
            if "lens: towards v2" in said and "lens: stands at v2" not in said:
                rig.far.tell("arm", {"do": "press", "axis": "Y"})
                seen.append("stands" if "arm: stands at v2" in said else "moves")
                return
        time.sleep(0.005)


@pytest.mark.full
def test_a_gantry_alarm_while_only_the_lens_moves_is_named_before_the_next_motion(
    tmp_path_factory: pytest.TempPathFactory,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    cell = cell_in(tmp_path_factory.mktemp("alarm"))
    text = (cell / "cell.toml").read_text()
    text = text.replace(
        'profile = "grblhal"', 'profile = "grblhal"\nhard_limits = true'
    )
    text = text.replace(
        'kind = "scf4"\nspeed_scale = 10', 'kind = "scf4"\nspeed_scale = 2'
    )
    (cell / "cell.toml").write_text(text)
    rig, seen = Rig(cell, FarEnds(cell)), []
    breaker = threading.Thread(
        target=press_while_the_lens_moves, args=(rig, tmp_path, seen)
    )
    breaker.start()
    words = ["run", str(cell), "--task", "soak", "--partial", "--json"]
    code = invoke([*words, "--out", str(tmp_path)])
    said = capsys.readouterr()
    breaker.join(VIEW_S)
    rig.far.end()
    assert seen == ["stands"]
    assert code == 4, said.err
    (folder,) = [path for path in tmp_path.iterdir() if path.is_dir()]
    records = read_records(folder / "records.jsonl")
    (taken,) = [r for r in records if isinstance(r, Captured)]
    assert taken.view == "v1"
    (fault,) = [r for r in records if isinstance(r, Fault)]
    assert fault.where == "arm"
    assert "alarm 1" in fault.message
    asked = (folder / "log.jsonl").read_text().count("arm: towards")
    assert asked == 2, "nothing was asked of the arm after its alarm"


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
