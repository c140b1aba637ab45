"""A long run over real wires while things break: nothing grows, no picture is lost.

python -m tools.soak [--views 1000] [--seed 1] [--faults 0.1] [--keep DIR]

The far ends are those of the bundled ``simulated_gantry``, in a process of their own,
with motors that run faster than life and a small picture; protocols keep their times.
A fault is brought about in some views, taken away once the run has ended with it, and
the run is resumed. One line of JSON per batch of views says what the process holds.
"""

from __future__ import annotations

import argparse
import contextlib
import gc
import hashlib
import json
import logging
import os
import select
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from drivers.simulators.control import ControlClient, ControlRefused
from mvp.cell.loading import load_cell, load_task
from mvp.cell.places import bundled_root
from mvp.cell.plan_job import make_plan, prepare
from mvp.cell.records import Captured, read_records
from mvp.cell.resume_job import resume_run
from mvp.cell.run_job import RunOptions, start_run
from mvp.cell.session import Watcher
from mvp.cell.states import RunState
from mvp.errors import DeviceError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from mvp.cell.loading import LoadedCell
    from mvp.cell.session import RunResult
    from mvp.cell.states import RunStatus
    from mvp.planning.plan import Plan

_LOG = logging.getLogger(__name__)
_START_S = 120.0
_BATCH = 25
_TRIES = 12  # of one batch, with a fault in each
_SHRINK = 4  # of the picture, each way
_WARM_UP = 0.3  # share of the batches before growth counts
_GROWTH_MB = 40.0
SOAK_TASK = """
schema_version = 1
name = "soak"
[part]
file = "../parts/paper_object.stl"
units = "mm"
[resolution]
detail_mm = 4.0
[lens]
f_mm = 12.5
a_mm = 0.78125
[exposure]
exposure_s = 0.02
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
"""
_EDITS = (
    ("speed_scale = 4 ", "speed_scale = 10 "),
    ("speed_scale = 3\n", "speed_scale = 10\n"),
    ("fps = 3\n", "fps = 15\n"),
    ("latency_s = 1.5 ", "latency_s = 0.6 "),
    ("width_px = 640\n", f"width_px = {640 // _SHRINK}\n"),
    ("height_px = 512\n", f"height_px = {512 // _SHRINK}\n"),
)


@dataclass(frozen=True)
class Fault:
    """What is done to a device, and what takes it away again."""

    role: str
    do: dict[str, object]
    undo: dict[str, object] = field(default_factory=dict)


FAULTS = (
    Fault("arm", {"do": "unplug"}, {"do": "replug"}),
    Fault("arm", {"do": "power_cycle"}),
    Fault("arm", {"do": "noise", "silence": True}, {"do": "noise"}),
    Fault("arm", {"do": "drop_next", "count": 5}),
    Fault("lens", {"do": "unplug"}, {"do": "replug"}),
    Fault("lens", {"do": "power_cycle"}),
    Fault("lens", {"do": "noise", "flip": 0.2}, {"do": "noise"}),
    Fault("lens", {"do": "hold_next", "seconds": 1.5}),
    Fault("camera", {"do": "restart"}),
    Fault("camera", {"do": "kill"}, {"do": "restart"}),
    Fault("camera", {"do": "stall", "on": True}, {"do": "stall", "on": False}),
    Fault("camera", {"do": "half", "count": 1}),
    Fault("camera", {"do": "garbage", "count": 2}),
)


@dataclass(frozen=True)
class Sample:
    """What a process holds, with every device closed."""

    views: int
    threads: int
    descriptors: int
    memory_mb: float
    far_threads: int
    far_descriptors: int
    far_memory_mb: float


class FarEnds:
    """``mvp-cell simulate`` in a process of its own, and its fault channels."""

    def __init__(self, cell: Path) -> None:
        words = ["simulate", str(cell), "--task", "soak"]
        self._process = subprocess.Popen(
            [sys.executable, "-m", "mvp", *words],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
        )
        out = self._process.stdout
        if out is None or not select.select([out], [], [], _START_S)[0]:
            raise RuntimeError("the simulation does not start")
        devices = json.loads(out.readline().removeprefix(b"READY "))["devices"]
        self._ports = {role: one["control_port"] for role, one in devices.items()}

    @property
    def pid(self) -> int:
        return self._process.pid

    def tell(self, role: str, line: dict[str, object]) -> dict[str, object]:
        """One line to the fault channel of a device; its answer."""
        keys = {key: value for key, value in line.items() if key != "do"}
        with ControlClient(self._ports[role], timeout_s=20) as faults:
            return faults.do(str(line["do"]), **keys)

    def end(self) -> None:
        """Tell it to end, and wait."""
        self._process.terminate()
        self._process.wait(60)
        if self._process.stdout is not None:
            self._process.stdout.close()


class Mishaps:
    """Brings faults about in some views, and takes them away.

    Args:
        far: the far ends.
        share: of the views that are met by one.
        rng: which, when, and what.
    """

    def __init__(self, far: FarEnds, share: float, rng: np.random.Generator) -> None:
        self._far, self._share, self._rng = far, share, rng
        self._view: str | None = None
        self._acting: threading.Thread | None = None
        self._ending = threading.Event()
        self.done: list[Fault] = []
        self._open: list[Fault] = []

    def on_status(self, status: RunStatus) -> None:
        """Decide once per view, when its motion begins."""
        if status.state is not RunState.MOVING or status.view == self._view:
            return
        self._view = status.view
        if self._rng.random() >= self._share or self._acting is not None:
            return
        fault = FAULTS[int(self._rng.integers(len(FAULTS)))]
        delay_s = float(self._rng.uniform(0.0, 2.5))
        self._acting = threading.Thread(target=self._act, args=(fault, delay_s))
        self._acting.start()

    def clear(self) -> None:
        """Wait for what is about to happen, and make everything good again."""
        acting, self._acting = self._acting, None
        if acting is not None:
            self._ending.set()
            acting.join()
            self._ending.clear()
        while self._open:
            fault = self._open.pop()
            if fault.undo:
                self._far.tell(fault.role, fault.undo)
        self._view = None

    def _act(self, fault: Fault, delay_s: float) -> None:
        if self._ending.wait(delay_s):
            return
        _LOG.warning("soak: %s: %s", fault.role, fault.do)
        self._open.append(fault)
        self.done.append(fault)
        with contextlib.suppress(ControlRefused):
            self._far.tell(fault.role, fault.do)


def cell_in(folder: Path) -> Path:
    """The cell with fast motors and a small picture."""
    cell = folder / "cell"
    shutil.copytree(
        bundled_root() / "simulated_gantry", cell, copy_function=shutil.copyfile
    )
    text = (cell / "cell.toml").read_text(encoding="utf-8")
    for old, new in _EDITS:
        if old not in text:
            raise SystemExit(f"cell.toml has no {old!r} any more")
        text = text.replace(old, new)
    (cell / "cell.toml").write_text(text, encoding="utf-8")
    (cell / "tasks" / "soak.toml").write_text(SOAK_TASK, encoding="utf-8")
    place = cell / "calibration" / "camera.json"
    camera = json.loads(place.read_text(encoding="utf-8"))
    for key in ("width_px", "height_px"):
        camera[key] //= _SHRINK
    for key in ("pitch_x_um", "pitch_y_um"):
        camera[key] *= _SHRINK
    for key in ("centre_x_px", "centre_y_px"):
        camera[key] = (camera[key] + 0.5) / _SHRINK - 0.5
    place.write_text(json.dumps(camera), encoding="utf-8")
    return cell


def batch_of(plan: Plan, first: int, count: int) -> Plan:
    """So many visits of the plan's views, in turn."""
    views = [
        plan.views[k % len(plan.views)].model_copy(update={"id": f"s{k:05d}"})
        for k in range(first, first + count)
    ]
    return plan.model_copy(update={"views": views})


def take(cell: LoadedCell, plan: Plan, out: Path, mishaps: Mishaps) -> Path:
    """Every view of a batch, resumed after every fault; the run's folder."""
    watcher = Watcher(lambda motion: True, lambda runner: None, mishaps.on_status)
    options = RunOptions(out, partial=True)
    folder: Path | None = None
    for _ in range(_TRIES):
        try:
            result = _go_on(cell, plan, folder, options, watcher)
        except DeviceError as error:
            _LOG.warning("soak: not begun: %s", error)
            mishaps.clear()
            continue
        folder = result.folder.path
        mishaps.clear()
        if result.outcome.reason == "completed":
            return folder
        if result.outcome.reason != "fault":
            raise SystemExit(f"{folder}: {result.outcome}")
    raise SystemExit(f"{folder}: not done after {_TRIES} tries")


def _go_on(
    cell: LoadedCell,
    plan: Plan,
    folder: Path | None,
    options: RunOptions,
    watcher: Watcher,
) -> RunResult:
    if folder is not None:
        return resume_run(cell, str(folder), options, watcher)
    setting = prepare(cell, load_task(cell, "soak"))
    return start_run(setting, plan, options, watcher)


def require_pictures(folder: Path, plan: Plan) -> None:
    """Every view has one record, and its picture is what the record says."""
    taken = [
        r for r in read_records(folder / "records.jsonl") if isinstance(r, Captured)
    ]
    views = [view.id for view in plan.views]
    if sorted(r.view for r in taken) != views:
        raise SystemExit(f"{folder}: lost or doubled views")
    for record in taken:
        content = (folder / record.image).read_bytes()
        if hashlib.sha256(content).hexdigest() != record.sha256:
            raise SystemExit(f"{folder}: {record.image} is not what was taken")
    if len(list((folder / "images").iterdir())) != len(views):
        raise SystemExit(f"{folder}: pictures without a record")


def sample(views: int, far_pid: int) -> Sample:
    """What this process and the far ends hold now."""
    gc.collect()
    return Sample(views, *_holds(os.getpid()), *_holds(far_pid))


def _holds(pid: int) -> tuple[int, int, float]:
    """Threads, descriptors, and resident memory in MB."""
    place = Path(f"/proc/{pid}")
    pages = int((place / "statm").read_text().split()[1])
    return (
        len(list((place / "task").iterdir())),
        len(list((place / "fd").iterdir())),
        round(pages * os.sysconf("SC_PAGE_SIZE") / 1e6, 1),
    )


def growth(samples: list[Sample]) -> list[str]:
    """What has grown since it was warm; empty is good."""
    begin, end = samples[int(_WARM_UP * len(samples))], samples[-1]
    found = []
    for name, most in {
        "threads": 0,
        "descriptors": 0,
        "memory_mb": _GROWTH_MB,
        "far_threads": 0,
        "far_descriptors": 0,
        "far_memory_mb": _GROWTH_MB,
    }.items():
        before, after = getattr(begin, name), getattr(end, name)
        if after - before > most:
            found.append(f"{name} from {before} to {after}")
    return found


@contextlib.contextmanager
def place_for(keep: Path | None) -> Iterator[Path]:
    """Where cell and runs go; removed afterwards unless it was named."""
    if keep is not None:
        keep.mkdir(parents=True, exist_ok=True)
        yield keep
        return
    with tempfile.TemporaryDirectory(prefix="mvp-soak-") as folder:
        yield Path(folder)


def soak(views: int, share: float, seed: int, folder: Path) -> int:
    """All of it; 0 when nothing has grown."""
    cell = load_cell(str(cell_in(folder)))
    plan = make_plan(cell, load_task(cell, "soak")).plan
    far = FarEnds(cell.source.path.parent)
    mishaps = Mishaps(far, share, np.random.default_rng(seed))
    samples: list[Sample] = []
    began_s = time.monotonic()
    try:
        for first in range(0, views, _BATCH):
            batch = batch_of(plan, first, min(_BATCH, views - first))
            require_pictures(take(cell, batch, folder / "runs", mishaps), batch)
            samples.append(sample(first + len(batch.views), far.pid))
            print(json.dumps(asdict(samples[-1])), flush=True)
    finally:
        far.end()
    grown = growth(samples)
    report = {
        "views": views,
        "faults": len(mishaps.done),
        "seconds": round(time.monotonic() - began_s, 1),
        "grown": grown,
    }
    print(json.dumps(report))
    return 1 if grown else 0


def main(arguments: list[str] | None = None) -> int:
    """Run with the options of the command line."""
    parser = argparse.ArgumentParser(prog="python -m tools.soak")
    parser.add_argument("--views", type=int, default=1000)
    parser.add_argument("--faults", type=float, default=0.1, help="share of views")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="folder for cell and runs")
    options = parser.parse_args(arguments)
    logging.basicConfig(level=logging.WARNING, format="%(asctime)s %(message)s")
    with place_for(options.keep) as folder:
        return soak(options.views, options.faults, options.seed, folder)


if __name__ == "__main__":
    sys.exit(main())
