import os
import pty
import socket
import threading
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest

from mvp.devices import (
    LineFramer,
    RealClock,
    RecordingTransport,
    ReplayTransport,
    SerialTransport,
    Session,
    TcpTransport,
    Traffic,
    TransportConfig,
    recorded_link,
)
from mvp.errors import ConnectError, DeviceTimeout, LinkLost, RecordError, WireError


@pytest.fixture
def port() -> Iterator[tuple[int, str]]:
    """The far end of a raw pseudo-terminal and its path."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    path = os.ttyname(slave)
    os.close(slave)
    yield master, path
    try:
        os.close(master)
    except OSError:
        pass


def test_bytes_go_both_ways_unchanged(port) -> None:
    master, path = port
    line = SerialTransport("lens", path)
    line.open()
    every = bytes(range(256))
    line.write(every)
    assert os.read(master, 1000) == every
    os.write(master, every)
    assert line.read(timeout_s=5) == every
    assert line.read(timeout_s=0) == b""
    line.close()
    line.close()


def test_a_second_program_is_told_who_has_the_port(port) -> None:
    _, path = port
    first, second = SerialTransport("arm", path), SerialTransport("lens", path)
    first.open()
    with pytest.raises(ConnectError, match=f"another program holds {path}") as caught:
        second.open()
    assert str(os.getpid()) in caught.value.message
    first.close()
    second.open()
    second.close()


def test_an_unplugged_port_is_a_lost_link(port) -> None:
    master, path = port
    line = SerialTransport("lens", path)
    line.open()
    os.close(master)
    with pytest.raises(LinkLost):
        line.read(timeout_s=5)
    with pytest.raises(LinkLost):
        line.write(b"?")
    line.close()


def test_a_port_that_takes_nothing_times_out(port) -> None:
    _, path = port
    line = SerialTransport("lens", path)
    line.open()
    with pytest.raises(DeviceTimeout, match="takes no bytes"):
        line.write(b"x" * 400_000)
    line.close()


def test_a_closed_port_neither_reads_nor_writes(port) -> None:
    line = SerialTransport("lens", port[1])
    with pytest.raises(LinkLost):
        line.read(timeout_s=0)
    with pytest.raises(LinkLost):
        line.write(b"?")


def test_a_missing_port_names_what_there_is() -> None:
    with pytest.raises(ConnectError, match="there is no port") as caught:
        SerialTransport("lens", "/dev/ttyUSB99").open()
    assert "port" in caught.value.hint


def test_a_usb_identity_that_is_not_there_is_refused() -> None:
    with pytest.raises(ConnectError, match="1a86:7523:ABC"):
        SerialTransport("lens", "1a86:7523:ABC").open()


def test_a_file_is_not_a_serial_port(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_text("")
    with pytest.raises(ConnectError, match="cannot be opened"):
        SerialTransport("lens", str(path)).open()


@pytest.mark.skipif(os.geteuid() == 0, reason="root may open every port")
def test_a_port_without_permission_names_the_group(port) -> None:
    os.chmod(port[1], 0)
    with pytest.raises(ConnectError, match="permission") as caught:
        SerialTransport("lens", port[1]).open()
    assert "dialout" in caught.value.hint


@pytest.fixture
def server() -> Iterator[socket.socket]:
    listener = socket.create_server(("127.0.0.1", 0))
    yield listener
    listener.close()


def test_a_socket_address_carries_bytes(server) -> None:
    config = TransportConfig(port=f"socket://127.0.0.1:{server.getsockname()[1]}")
    line = recorded_link(config, "lens")
    line.open()
    far, _ = server.accept()
    line.write(b"\x76\x0d")
    assert far.recv(10) == b"\x76\x0d"
    far.sendall(b"\x74\x00\x0d")
    assert line.read(timeout_s=5) == b"\x74\x00\x0d"
    far.close()
    with pytest.raises(LinkLost, match="far end"):
        line.read(timeout_s=5)
    line.close()


def test_closing_wakes_a_reader(server) -> None:
    line = TcpTransport("lens", f"127.0.0.1:{server.getsockname()[1]}")
    line.open()
    seen: list[object] = []

    def read() -> None:
        try:
            line.read(timeout_s=30)
        except LinkLost as error:
            seen.append(error)

    reader = threading.Thread(target=read)
    reader.start()
    line.close()
    reader.join(10)
    assert len(seen) == 1


@pytest.mark.parametrize("end", ["nohost", ":1", "host:", "127.0.0.1:99999"])
def test_a_bad_network_address_is_refused(end: str) -> None:
    with pytest.raises(ConnectError, match="no network address"):
        TcpTransport("lens", end).open()


def test_nobody_listening_is_refused(server) -> None:
    number = server.getsockname()[1]
    server.close()
    with pytest.raises(ConnectError, match="nobody answers"):
        TcpTransport("lens", f"127.0.0.1:{number}").open()


class Loop:
    """Gives back what is written."""

    name = "lens"
    address = "loop"

    def __init__(self) -> None:
        self.held = b""

    def open(self) -> None: ...

    def close(self) -> None: ...

    def write(self, data: bytes) -> None:
        self.held += data

    def read(self, *, timeout_s: float) -> bytes:
        data, self.held = self.held, b""
        return data


def test_a_recording_plays_back(tmp_path: Path) -> None:
    line = RecordingTransport(Loop())
    line.open()
    for sent in (b"one", b"two"):
        line.write(sent)
        assert line.read(timeout_s=0) == sent
    replay = ReplayTransport.load(line.dump_into(tmp_path))
    replay.open()
    replay.write(b"on")
    assert replay.read(timeout_s=0.01) == b""
    replay.write(b"etwo")
    assert replay.read(timeout_s=0) == b"one"
    assert replay.read(timeout_s=0) == b"two"
    assert replay.finished
    assert replay.read(timeout_s=0) == b""


def test_a_replay_names_the_byte_that_differs() -> None:
    replay = ReplayTransport.of_exchanges("lens", [(b"$S\n", b"me\n"), (b"$I\n", b"")])
    replay.open()
    replay.write(b"$S\n")
    with pytest.raises(WireError, match="byte 4 sent is 58, recorded was 49"):
        replay.write(b"$X\n")


def test_a_replay_refuses_what_comes_after_its_end() -> None:
    replay = ReplayTransport("lens", [Traffic(0.0, "out", b"a")])
    replay.open()
    with pytest.raises(WireError, match="ends before"):
        replay.write(b"ab")


def test_a_recorded_loss_is_lost_again() -> None:
    replay = ReplayTransport("lens", [Traffic(0.0, "out", b"a"), Traffic(1.0, "lost")])
    replay.open()
    replay.write(b"a")
    with pytest.raises(LinkLost):
        replay.read(timeout_s=0)


def test_a_recording_is_bounded_and_says_what_it_forgot(tmp_path: Path) -> None:
    line = RecordingTransport(Loop(), capacity_bytes=2000)
    for _ in range(1000):
        line.write(b"0123456789")
    assert sum(len(t.data) for t in line.traffic()) < 2000
    path = line.dump_into(tmp_path)
    with pytest.raises(RecordError, match="has lost its first"):
        ReplayTransport.load(path)
    assert line.dump_into(tmp_path).name == "lens-2.wire.jsonl"


@pytest.mark.parametrize("content", ["", "x", "{}", '{"schema": "other"}', "[1]\n[2]"])
def test_what_is_no_recording_is_refused(tmp_path: Path, content: str) -> None:
    path = tmp_path / "x.wire.jsonl"
    path.write_text(content)
    with pytest.raises(RecordError):
        ReplayTransport.load(path)


def test_opening_and_closing_leaves_nothing_behind(port) -> None:
    before = len(os.listdir("/proc/self/fd"))
    line = SerialTransport("lens", port[1])
    for _ in range(50):
        line.open()
        line.write(b"x")
        line.close()
    assert len(os.listdir("/proc/self/fd")) == before


def test_a_session_that_opens_again_and_again_leaves_nothing_behind(server) -> None:
    config = TransportConfig(port=f"socket://127.0.0.1:{server.getsockname()[1]}")
    session = Session(recorded_link(config, "lens"), LineFramer(), clock=RealClock())
    counts = []
    for _ in range(20):
        session.open()
        far, _ = server.accept()
        far.close()
        session.close()
        counts.append((len(os.listdir("/proc/self/fd")), threading.active_count()))
    assert counts[0] == counts[-1]
