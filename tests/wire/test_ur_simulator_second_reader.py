"""Another RTDE client, written here from the protocol alone, reads the controller."""

from __future__ import annotations

import itertools
import os
import signal
import socket
import struct
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from drivers.simulators.control import ControlClient
from drivers.simulators.ur import UrSimulator, UrSimulatorConfig
from mvp.devices import DeviceContext
from mvp.errors import ConfigError, ConnectError

if TYPE_CHECKING:
    from collections.abc import Iterator

HOME = (0.0, -1.57, 1.57, -1.57, -1.57, 0.0)


class Reader:
    """A few lines of RTDE."""

    def __init__(self, host: str, protocol: int = 2) -> None:
        self.socket = socket.create_connection((host, 30004), 10)
        self.protocol = protocol
        assert self.ask("V", struct.pack(">H", protocol)) == b"\x01"

    def send(self, kind: str, payload: bytes = b"") -> None:
        self.socket.sendall(struct.pack(">HB", len(payload) + 3, ord(kind)) + payload)

    def ask(self, kind: str, payload: bytes = b"") -> bytes:
        self.send(kind, payload)
        while True:
            said, body = self.receive()
            if said == kind:
                return body

    def receive(self) -> tuple[str, bytes]:
        size, kind = struct.unpack(">HB", self._exactly(3))
        return chr(kind), self._exactly(size - 3)

    def _exactly(self, count: int) -> bytes:
        data = b""
        while len(data) < count:
            more = self.socket.recv(count - len(data))
            if not more:
                raise EOFError
            data += more
        return data

    def data(self) -> bytes:
        while True:
            kind, body = self.receive()
            if kind == "U":
                return body

    def close(self) -> None:
        self.socket.close()

    def __enter__(self) -> Reader:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


def _outputs(hz: float, names: str) -> bytes:
    return struct.pack(">d", hz) + names.encode()


@pytest.fixture(scope="module")
def simulator() -> Iterator[UrSimulator]:
    with UrSimulator(UrSimulatorConfig(), "arm") as one:
        yield one


def test_two_recipes_come_at_their_own_rates(simulator: UrSimulator) -> None:
    with Reader(simulator.host) as reader:
        assert struct.unpack(">4I", reader.ask("v"))[:2] == (5, 12)
        slow = reader.ask("O", _outputs(125, "timestamp,actual_q"))
        fast = reader.ask("O", _outputs(500, "timestamp,robot_mode,runtime_state,"))
        assert slow == b"\x01DOUBLE,VECTOR6D"
        assert fast == b"\x02DOUBLE,INT32,UINT32"
        assert reader.ask("S") == b"\x01"
        stamps: dict[int, list[float]] = {1: [], 2: []}
        while len(stamps[1]) < 30:
            body = reader.data()
            stamps[body[0]].append(struct.unpack_from(">d", body, 1)[0])
            if body[0] == 1:
                assert struct.unpack(">7d", body[1:])[1:] == HOME
            else:
                assert struct.unpack(">iI", body[9:]) == (7, 1)
        assert reader.ask("P") == b"\x01"
    for recipe, period in ((1, 0.008), (2, 0.002)):
        times = stamps[recipe]
        steps = [b - a for a, b in itertools.pairwise(times)]
        assert steps == pytest.approx([period] * len(steps), abs=1e-6)


def test_the_first_protocol_has_no_recipe_numbers(simulator: UrSimulator) -> None:
    with Reader(simulator.host, protocol=1) as reader:
        assert reader.ask("O", b"actual_q") == b"VECTOR6D"
        assert reader.ask("S") == b"\x01"
        assert struct.unpack(">6d", reader.data()) == HOME


def test_unknown_variables_are_named(simulator: UrSimulator) -> None:
    with Reader(simulator.host) as reader:
        said = reader.ask("O", _outputs(125, "timestamp,nonsense"))
        assert said == b"\x00DOUBLE,NOT_FOUND"
        assert reader.ask("I", b"nonsense") == b"\x00NOT_FOUND"


def test_inputs_are_written_without_a_start_and_short_ones_ignored(
    simulator: UrSimulator,
) -> None:
    names = b"input_int_register_40,input_double_register_40"
    with Reader(simulator.host) as writer, Reader(simulator.host) as other:
        assert writer.ask("I", names) == b"\x01INT32,DOUBLE"
        assert writer.ask("I", b"input_bit_register_70,") == b"\x02BOOL"
        assert other.ask("I", names) == b"\x00IN_USE,IN_USE"
        writer.send("U", b"\x01" + struct.pack(">id", 12, 0.5))
        writer.send("U", b"\x01" + struct.pack(">i", 13))
        other.ask("O", _outputs(500, names.decode()))
        other.ask("S")
        deadline = time.monotonic() + 10
        while (said := struct.unpack(">id", other.data()[1:])) != (12, 0.5):
            assert time.monotonic() < deadline, said
    with Reader(simulator.host) as again:
        deadline = time.monotonic() + 10
        while again.ask("I", names)[0] == 0:
            assert time.monotonic() < deadline


def test_a_reader_with_a_broken_package_is_hung_up_on_alone(
    simulator: UrSimulator,
) -> None:
    with Reader(simulator.host) as good, Reader(simulator.host) as bad:
        bad.socket.sendall(b"\x00\x01V")
        with pytest.raises((EOFError, ConnectionError)):
            bad.receive()
        assert len(good.ask("v")) == 16


def test_an_address_is_not_shared_and_says_so(simulator: UrSimulator) -> None:
    second = UrSimulator(UrSimulatorConfig(host=simulator.host), "arm")
    with pytest.raises(ConnectError, match="does not start") as caught:
        second.start()
    assert "auto" in caught.value.hint
    assert second.control_port == 0


def test_two_controllers_live_side_by_side(simulator: UrSimulator) -> None:
    with ExitStack() as stack:
        other = stack.enter_context(UrSimulator(UrSimulatorConfig(), "arm"))
        assert other.host != simulator.host
        faults = stack.enter_context(ControlClient(other.control_port))
        assert faults.do("state")["host"] == other.host


def test_an_unknown_profile_is_a_configuration_error() -> None:
    config = UrSimulatorConfig(profile="e9")
    with pytest.raises(ConfigError, match="e9"):
        UrSimulator.from_config(config, DeviceContext(), name="arm")


def test_the_controller_dies_with_who_started_it() -> None:
    program = (
        "from drivers.simulators.ur import UrSimulator, UrSimulatorConfig\n"
        "import time\n"
        "one = UrSimulator(UrSimulatorConfig(), 'arm')\n"
        "one.start()\n"
        "print(one.pid, flush=True)\n"
        "time.sleep(60)\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE
    ) as parent:
        assert parent.stdout is not None
        child = int(parent.stdout.readline())
        os.kill(parent.pid, signal.SIGKILL)
        parent.wait()
    deadline = time.monotonic() + 20
    while _alive(child):
        assert time.monotonic() < deadline
        time.sleep(0.05)


def _alive(pid: int) -> bool:
    """Whether a process runs; one that nobody has buried yet does not."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    status = Path(f"/proc/{pid}/stat")
    return not status.exists() or status.read_text().rsplit(")", 1)[1].split()[0] != "Z"


class World:
    """Keeps what it is told."""

    def __init__(self) -> None:
        self.reports: list[tuple[float, list[float]]] = []

    def report_arm(self, t_s: float, joints: list[float]) -> None:
        self.reports.append((t_s, joints))


def test_the_world_hears_where_the_arm_begins_moves_and_stands() -> None:
    world = World()
    began = time.monotonic()
    with UrSimulator(UrSimulatorConfig(), "arm", world) as simulator:  # type: ignore[arg-type]
        with socket.create_connection((simulator.host, 30002), 10) as line:
            line.sendall(b"movej([0.3,-1.57,1.57,-1.57,-1.57,0.0],a=4.0,v=1.0)\n")
            deadline = time.monotonic() + 20
            while not world.reports or world.reports[-1][1][0] != 0.3:
                assert time.monotonic() < deadline
                time.sleep(0.01)
            ended = time.monotonic()
    times = [t for t, _ in world.reports]
    bases = [joints[0] for _, joints in world.reports]
    assert began < times[0]
    assert times[-1] < ended + 0.1
    assert times == sorted(times)
    assert bases == sorted(bases)
    moving = [t for t, base in world.reports if 0 < base[0] < 0.3]
    steps = [b - a for a, b in itertools.pairwise(moving)]
    assert max(steps) <= 0.0201
    # It is said to stand just before it leaves, so nothing creeps in between.
    last_home = max(t for t, base in world.reports if base[0] == 0)
    assert moving[0] - last_home < 0.0201
