import threading
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.simulators.host import SerialHost
from drivers.simulators.noise import Noise, NoisyLine
from mvp.devices import Transport, TransportConfig, recorded_link
from mvp.errors import ConnectError, LinkLost


class Parrot:
    """Answers every byte string with itself in upper case; counts what it is told."""

    def __init__(self) -> None:
        self.said = b""
        self.openings = 0
        self.power_ups = 0
        self.last_s = 0.0
        self.broken = False

    def receive(self, data: bytes, now_s: float) -> None:
        if self.broken:
            raise RuntimeError("a bug in the machine")
        self.said += data.upper()

    def tick(self, now_s: float) -> None:
        assert now_s >= self.last_s
        self.last_s = now_s

    def take_output(self) -> bytes:
        said, self.said = self.said, b""
        return said

    def opened(self, now_s: float) -> None:
        self.openings += 1

    def power_up(self, now_s: float) -> None:
        self.power_ups += 1


Make = Callable[..., tuple[SerialHost, Transport, Parrot]]


@pytest.fixture(params=["pty", "127.0.0.1:0"])
def make(request: pytest.FixtureRequest) -> Iterator[Make]:
    hosts: list[SerialHost] = []
    lines: list[Transport] = []

    def start(**keys: object) -> tuple[SerialHost, Transport, Parrot]:
        parrot = Parrot()
        host = SerialHost(parrot, listen=request.param, name="lens", **keys)
        hosts.append(host)
        line = recorded_link(TransportConfig(port=host.start()), "lens")
        lines.append(line)
        line.open()
        soon(lambda: host.connected)
        soon(lambda: parrot.openings)
        return host, line, parrot

    yield start
    for line in lines:
        line.close()
    for host in hosts:
        host.stop()
    assert not [t for t in threading.enumerate() if t.name.startswith("simulator-")]


def soon(what: Callable[[], object]) -> None:
    end = time.monotonic() + 20
    while not what():
        assert time.monotonic() < end
        time.sleep(0.002)


def read(line: Transport, count: int) -> bytes:
    data = b""
    end = time.monotonic() + 20
    while len(data) < count and time.monotonic() < end:
        data += line.read(timeout_s=0.1)
    return data


def test_a_machine_hears_and_is_heard(make: Make) -> None:
    _, line, _ = make()
    line.write(b"hello")
    assert read(line, 5) == b"HELLO"


def test_an_echo_comes_before_the_answer(make: Make) -> None:
    _, line, _ = make(noise=Noise(echo=True))
    line.write(b"hello")
    assert read(line, 10) == b"helloHELLO"


def test_chunks_delays_and_pacing_keep_the_order(make: Make) -> None:
    _, line, _ = make(noise=Noise(max_chunk=3, delay_s=0.01), baud=9600)
    line.write(b"the quick brown fox")
    assert read(line, 19) == b"THE QUICK BROWN FOX"


def test_silence_is_silent_and_ends(make: Make) -> None:
    host, line, _ = make(noise=Noise(silence=True))
    line.write(b"a")
    assert line.read(timeout_s=0.1) == b""
    host.verbs()["noise"]({})
    line.write(b"b")
    assert read(line, 1) == b"B"


def test_garbage_comes_when_the_port_is_opened(make: Make) -> None:
    _, line, _ = make(noise=Noise(garbage_hex="41540d"))
    line.write(b"x")
    # A serial port forgets what came before it was set up; a socket does not.
    assert read(line, 1)[-1:] in (b"X", b"\r")


def test_a_pulled_cable_is_noticed_and_plugged_in_again(make: Make) -> None:
    host, line, parrot = make()
    host.verbs()["unplug"]({})
    with pytest.raises(LinkLost):
        line.read(timeout_s=20)
    line.close()
    with pytest.raises(ConnectError):
        line.open()
    host.verbs()["replug"]({})
    assert parrot.power_ups == 1
    line.open()
    soon(lambda: host.connected)
    line.write(b"again")
    assert read(line, 5) == b"AGAIN"


def test_a_reset_connection_is_a_lost_link(make: Make) -> None:
    host, line, _ = make()
    host.unplug(reset=True)
    with pytest.raises(LinkLost):
        line.read(timeout_s=20)


def test_a_machine_is_told_of_every_opening(make: Make) -> None:
    host, line, parrot = make()
    line.close()
    soon(lambda: not host.connected)
    line.open()
    soon(lambda: parrot.openings == 2)


def test_one_answer_can_be_late_and_bytes_can_be_lost(make: Make) -> None:
    host, line, _ = make()
    host.verbs()["hold_next"]({"seconds": 0.3})
    line.write(b"late")
    assert line.read(timeout_s=0.05) == b""
    assert read(line, 4) == b"LATE"
    host.verbs()["drop_next"]({"count": 2})
    line.write(b"lost")
    assert read(line, 2) == b"ST"


def test_bytes_can_be_put_on_the_line(make: Make) -> None:
    host, line, _ = make()
    host.verbs()["say"]({"hex": "9038ff"})
    assert read(line, 3) == b"\x90\x38\xff"


@pytest.mark.parametrize("listen", ["pty", "127.0.0.1:0"])
def test_a_bug_in_a_machine_is_said_at_once_and_never_looks_like_silence(
    listen: str, caplog: pytest.LogCaptureFixture
) -> None:
    parrot = Parrot()
    parrot.broken = True
    host = SerialHost(parrot, listen=listen)
    line = recorded_link(TransportConfig(port=host.start()), "lens")
    line.open()
    line.write(b"x")
    soon(lambda: not any(t.name == "simulator-device" for t in threading.enumerate()))
    assert "the simulated device broke down" in caplog.text
    with pytest.raises(LinkLost):
        line.read(timeout_s=5)
    line.close()
    host.unplug()
    with pytest.raises(RuntimeError, match="bug"):
        host.stop()
    host.stop()


def test_only_this_machine_can_connect() -> None:
    with pytest.raises(ValueError, match=r"127\.0\.0\.1"):
        SerialHost(Parrot(), listen="0.0.0.0:0").start()


@given(st.binary(max_size=200), st.integers(0, 2**32 - 1))
def test_a_perfect_line_changes_nothing(data: bytes, seed: int) -> None:
    line = NoisyLine(Noise(max_chunk=8, delay_s=0.1), np.random.default_rng(seed))
    due = line.to_host(data, 5.0)
    assert b"".join(d.data for d in due) == data
    assert [d.at_s for d in due] == sorted(d.at_s for d in due)
    assert all(len(d.data) <= 8 for d in due)


def test_noise_is_as_frequent_as_asked() -> None:
    line = NoisyLine(Noise(drop=0.1, flip=0.05), np.random.default_rng(1))
    data = bytes(100_000)
    got = b"".join(d.data for d in line.to_device(data, 0.0))
    assert 0.89 < len(got) / len(data) < 0.91
    assert 0.045 < sum(map(bool, got)) / len(got) < 0.055


def test_bytes_take_their_time_on_a_paced_line() -> None:
    """48 characters at 115200 baud take 4.2 ms."""
    line = NoisyLine(Noise(), np.random.default_rng(1), byte_s=10 / 115200)
    due = line.to_host(b"x" * 48, 1.0)
    assert due[-1].at_s - 1.0 == pytest.approx(0.00417, abs=1e-5)
    assert line.to_host(b"y", 1.0)[0].at_s > due[-1].at_s
