"""Something that listens where a robot should: whatever it says, an error of ours."""

from __future__ import annotations

import json
import socket
import sys
import threading
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers._ur.dashboard import PORT as DASHBOARD_PORT
from drivers._ur.dashboard import Dashboard
from drivers._ur.process import WorkerProcess
from drivers._ur.version import PORT as RTDE_PORT
from drivers._ur.version import ask_version
from mvp.devices import RealClock
from mvp.errors import DeviceError
from tests.fuzzing import Mutants, at_length, fuzz

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

HOST = "127.0.78.78"
CLOCK = RealClock()
QUICK_S = 0.02
PATIENT_S = 10.0
GOOD_VERSION = bytes.fromhex("00045601" + "001376" + "000000050000000c0000000000000007")


class Talker:
    """Says what it is told to whoever connects, and hangs up, unless it is patient."""

    def __init__(self, port: int) -> None:
        self.words = b""
        self.patient = False
        self._server = socket.create_server((HOST, port))
        self._server.settimeout(0.1)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self) -> None:
        while not self._ended.is_set():
            with suppress(OSError):
                peer, _ = self._server.accept()
                with peer:
                    peer.sendall(self.words)
                    peer.settimeout(PATIENT_S)
                    while self.patient and peer.recv(4096):
                        pass

    @contextmanager
    def saying(self, words: bytes) -> Iterator[None]:
        """As a sound far end: it says this, and the other one hangs up."""
        self.words, self.patient = words, True
        yield
        self.patient = False

    def end(self) -> None:
        self._ended.set()
        self._thread.join()
        self._server.close()


@pytest.fixture(scope="module")
def dashboard() -> Iterator[Talker]:
    talker = Talker(DASHBOARD_PORT)
    yield talker
    talker.end()


@pytest.fixture(scope="module")
def controller() -> Iterator[Talker]:
    talker = Talker(RTDE_PORT)
    yield talker
    talker.end()


GREETING = b"Connected: Universal Robots Dashboard Server\n"
replies = st.lists(
    st.sampled_from([GREETING, b"Robotmode: RUNNING\n", b"\n", b":", b"\xff\xfe"])
    | st.binary(max_size=40)
    | st.just(b"x" * 2000),
    max_size=6,
).map(b"".join)
packages = st.lists(
    st.sampled_from([bytes.fromhex("00045601"), bytes.fromhex("001376" + "00" * 16)])
    | st.binary(max_size=20),
    max_size=4,
).map(b"".join)


def asked(talker: Talker, words: bytes) -> str:
    """What a sound dashboard is heard to say after one that said anything."""
    talker.words = words
    board = Dashboard(HOST, name="arm", clock=CLOCK, timeout_s=QUICK_S)
    with suppress(DeviceError), board:
        assert isinstance(board.value("robotmode"), str)
    with suppress(DeviceError):
        assert board.end_program() in (True, False)
    with (
        talker.saying(GREETING + b"Robotmode: RUNNING\n"),
        Dashboard(HOST, name="arm", clock=CLOCK, timeout_s=PATIENT_S) as board,
    ):
        return board.value("robotmode")


def version_asked(talker: Talker, words: bytes) -> tuple[int, ...]:
    """The version of a sound controller after one that said anything."""
    talker.words = words
    with suppress(DeviceError):
        found = ask_version(HOST, name="arm", clock=CLOCK, timeout_s=QUICK_S)
        assert len(found) == 4
    with talker.saying(GOOD_VERSION):
        found = ask_version(HOST, name="arm", clock=CLOCK, timeout_s=PATIENT_S)
    return found


@settings(max_examples=40, deadline=None)
@given(words=replies)
def test_any_dashboard_ends_in_text_or_a_device_error(
    dashboard: Talker, words: bytes
) -> None:
    assert asked(dashboard, words) == "RUNNING"


@settings(max_examples=40, deadline=None)
@given(words=packages)
def test_any_controller_has_a_version_or_is_a_device_error(
    controller: Talker, words: bytes
) -> None:
    assert version_asked(controller, words) == (5, 12, 0, 7)


ANSWERS = [
    GREETING + b"Robotmode: RUNNING\n",
    GREETING + b"Stopped\n",
    GREETING + b"could not understand: 'x'\n",
    GREETING + b"Safetystatus: PROTECTIVE_STOP\nLoaded program: /programs/a.urp\n",
]
PIECES = [b"\n", b"\r", b":", b"\xff\xfe", b"\0", b"x" * 600, *GREETING.split()]
ONE_IN = 100


@at_length
def test_any_dashboard_ends_in_text_or_a_device_error_at_length(
    dashboard: Talker,
) -> None:
    mutants = Mutants(ANSWERS, PIECES)

    def check(words: bytes) -> None:
        dashboard.words = words
        board = Dashboard(HOST, name="arm", clock=CLOCK, timeout_s=QUICK_S)
        with suppress(DeviceError), board:
            assert isinstance(board.value("robotmode"), str)
            assert isinstance(board.value("safetystatus"), str)
        if mutants.given % ONE_IN == 0:
            assert asked(dashboard, words) == "RUNNING"

    fuzz(check, mutants)


@at_length
def test_any_controller_has_a_version_or_is_a_device_error_at_length(
    controller: Talker,
) -> None:
    mutants = Mutants([GOOD_VERSION], [b"\0", b"\x04V\x01", b"\x13v", b"\xff\xff"])

    def check(words: bytes) -> None:
        controller.words = words
        with suppress(DeviceError):
            found = ask_version(HOST, name="arm", clock=CLOCK, timeout_s=QUICK_S)
            assert len(found) == 4
        if mutants.given % ONE_IN == 0:
            assert version_asked(controller, words) == (5, 12, 0, 7)

    fuzz(check, mutants)


MESSAGES = [
    {"hello": 1},
    {"id": "seven", "ok": True},
    {"id": 1, "ok": True, "status": 3},
    {"id": None},
    {"id": 1e400},
    {"status": {}},
    {"status": []},
    {"lost": {"why": 1}},
    {"id": [1], "ok": False, "message": None},
]


@pytest.fixture
def worker_saying() -> Iterator[Callable[[bytes], WorkerProcess]]:
    """Makes a worker whose words are given; it has ended when the test has."""
    made: list[WorkerProcess] = []

    def make(words: bytes) -> WorkerProcess:
        code = f"import sys\nsys.stdout.buffer.write({words!r})"
        command = [sys.executable, "-S", "-c", code]
        made.append(WorkerProcess("arm", CLOCK, command=command))
        return made[-1]

    yield make
    for worker in made:
        worker.kill("the test has ended")


@pytest.mark.parametrize("message", MESSAGES, ids=lambda m: json.dumps(m)[:20])
def test_a_worker_that_talks_nonsense_is_a_lost_link(
    worker_saying: Callable[[bytes], WorkerProcess], message: dict[str, object]
) -> None:
    worker = worker_saying(json.dumps(message).encode() + b"\n")
    with suppress(DeviceError):
        worker.request("version", timeout_s=10)
    with pytest.raises(DeviceError):
        worker.request("version", timeout_s=10)
    assert not worker.alive
