"""What every test shares: how inputs are drawn, order, what is run again, a camera.

The default suite draws the same inputs each time, so that a run which passed here
passes elsewhere; `make test-full` draws new ones. Tests in real time against processes
and wires are run a second time when they fail; the summary names each of them.
"""

from __future__ import annotations

import ctypes
import itertools
import os
import shutil
import signal
import socket
import subprocess
import time
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import HealthCheck, settings

if TYPE_CHECKING:
    from collections.abc import Iterator

    from mvp.cell.engine import CellDevices

settings.register_profile(
    "same-inputs",
    derandomize=True,
    database=None,
    deadline=None,
    print_blob=True,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.register_profile(
    "new-inputs", settings.get_profile("same-inputs"), derandomize=False
)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "same-inputs"))

# A suite that was started in the background would hand an ignored Ctrl-C on.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

_IN_REAL_TIME = ("wire", "run", "conformance")


# What takes longest is begun first: begun last, it would hold everybody up.
_LONGEST = (
    "test_calibrate_simulated.py",
    "test_uncalibrated_cell.py",
    "test_docs_run.py",
    "test_calibrate_camera.py",
)


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """A starved simulator is no defect; one that fails twice is."""
    home = Path(__file__).parent
    for item in items:
        if item.path.relative_to(home).parts[0] in _IN_REAL_TIME:
            item.add_marker(pytest.mark.flaky(reruns=1))
    workers = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
    if workers > 1:
        items[:] = _longest_first(items, workers)


def _longest_first(items: list[pytest.Item], workers: int) -> list[pytest.Item]:
    """Every worker is given a run of items of equal length; it begins with a long file."""
    files = [[i for i in items if i.path.name == name] for name in _LONGEST]
    rest = [i for i in items if i.path.name not in _LONGEST]
    first = [list(itertools.chain(*files[k::workers])) for k in range(workers)]
    ordered: list[pytest.Item] = []
    for k, own in enumerate(first):
        share = (len(items) - len(ordered)) // (workers - k)
        more = max(share - len(own), 0) if k < workers - 1 else len(rest)
        ordered += own + rest[:more]
        rest = rest[more:]
    return ordered


_PROGRAM = "arv-fake-gv-camera-0.8"
_HOST = "127.0.0.1"
_GVCP_PORT = 3956
_PR_SET_PDEATHSIG = 1
_START_S = 10.0
_SERIALS = itertools.count(1)
_LIBC = ctypes.CDLL(None)


def _die_with_parent() -> None:
    _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


def _in_use() -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind((_HOST, _GVCP_PORT))
        except OSError:
            return True
    return False


class GvCamera:
    """The camera on 127.0.0.1, with a serial number of its own."""

    host = _HOST

    def __init__(self) -> None:
        self.serial = f"T{os.getpid()}-{next(_SERIALS)}"
        self._process: subprocess.Popen[bytes] | None = None

    def start(self, *, lost_per_thousand: int = 0, serial: str = "") -> None:
        """Switch it on; anything else on its port is a mistake."""
        self.kill()
        if _in_use():
            raise RuntimeError("another camera answers on 127.0.0.1")
        command = [_PROGRAM, "-i", _HOST, "-s", serial or self.serial]
        if lost_per_thousand:
            command += ["-r", str(lost_per_thousand)]
        self._process = subprocess.Popen(
            command,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            preexec_fn=_die_with_parent,
        )
        deadline = time.monotonic() + _START_S
        while not _in_use():
            if time.monotonic() > deadline or self._process.poll() is not None:
                raise RuntimeError(f"{_PROGRAM} does not start")
            time.sleep(0.02)

    def kill(self) -> None:
        """Pull its plug; safe to repeat."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.wait()


@pytest.fixture
def gv_camera_program() -> Iterator[None]:
    """The address, held against other workers and simulated cameras."""
    from drivers.simulators.gige.address import AddressLock

    if shutil.which(_PROGRAM) is None:
        pytest.skip(f"{_PROGRAM} is missing: apt-get install aravis-tools")
    lock = AddressLock(_HOST, 300.0)
    lock.take()
    yield
    lock.release()


@pytest.fixture
def gv_camera(gv_camera_program: None) -> Iterator[GvCamera]:
    """A camera that is on; off when the test ends, whatever happens."""
    camera = GvCamera()
    camera.start()
    yield camera
    camera.kill()


@pytest.fixture
def virtual_copy(tmp_path: Path) -> Path:
    """The virtual cell in a folder of one's own, whose name has a space."""
    from mvp.cell.init_job import copy_cell

    folder = tmp_path / "my cell"
    copy_cell("virtual", folder)
    return folder


@pytest.fixture
def devices_at_home(monkeypatch: pytest.MonkeyPatch) -> list[CellDevices]:
    """The devices of each cell that is being brought home, in turn."""
    from mvp.cell import home_job

    found: list[CellDevices] = []
    make = home_job.devices_for

    @contextmanager
    def spied(*args: Any) -> Iterator[CellDevices]:
        with make(*args) as devices:
            found.append(devices)
            yield devices

    monkeypatch.setattr(home_job, "devices_for", spied)
    return found


@pytest.fixture(params=["telegenicam", "aravis"])
def genicam_backend(request: pytest.FixtureRequest) -> str:
    """Each library that the GenICam driver can use."""
    from drivers._genicam import installed_backends

    problem = installed_backends()[request.param]
    if problem:
        pytest.skip(problem)
    return str(request.param)
