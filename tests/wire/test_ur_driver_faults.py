"""Every fault the client library was seen to have, met by the product's own process.

Each ends in a typed error before its deadline, without a new motion, and the arm can be
used again once the cause is gone.
"""

import socket
import subprocess
import sys
import threading
import time
from contextlib import contextmanager, suppress

import pytest

from drivers.simulators.control import ControlRefused
from mvp.errors import (
    ConnectError,
    DeviceError,
    DeviceFault,
    DeviceTimeout,
    LinkLost,
    WireError,
)

HOME = [0.0, -1.57, 1.57, -1.57, -1.57, 0.0]
FAR = [1.2, -1.3, 1.4, -1.57, -1.4, 0.5]
PATIENCE_S = 40.0
LOST = (LinkLost, DeviceTimeout)
FULL = pytest.mark.full


def wait_listening(host: str) -> None:
    """Closed ports open again a moment after they were told to."""
    end = time.monotonic() + PATIENCE_S
    for port in (29999, 30003, 30004):
        while time.monotonic() < end:
            with suppress(OSError), socket.create_connection((host, port), 1):
                break
            time.sleep(0.05)


def heal(bench) -> None:
    """Take every disturbance away and bring the robot back by the driver's own way."""
    bench.do("clear")
    wait_listening(bench.simulator.host)
    bench.do("slider", fraction=1.0)
    bench.do("remote", on=True)
    bench.do("identity", serial="20225500123", model="UR5")
    with suppress(ControlRefused):
        bench.do("release")
    if bench.do("state")["robot_mode"] in ("BOOTING", "BACKDRIVE"):
        bench.do("robot_mode", mode="POWER_OFF")
    arm = bench.arm()
    for step in arm.recovery():
        step.act()
    arm.close()


@pytest.fixture(scope="module")
def bench(ur_shared):
    return ur_shared


@pytest.fixture
def healed(bench):
    """The shared controller, healed after the test."""
    yield bench
    heal(bench)


def refused(arm) -> DeviceError:
    with pytest.raises(DeviceError) as caught, arm:
        pass
    assert caught.value.hint
    return caught.value


REFUSALS = [
    ("refuse", {"ports": [30004]}, ConnectError, ""),
    ("refuse", {"ports": [29999]}, ConnectError, ""),
    ("refuse", {"ports": [30003]}, ConnectError, ""),
    ("mute", {"types": "V"}, DeviceTimeout, ""),
    ("mute", {"types": "O"}, DeviceTimeout, ""),
    pytest.param("mute", {"types": "v"}, DeviceTimeout, "", marks=FULL),
    pytest.param("mute", {"types": "I"}, DeviceTimeout, "", marks=FULL),
    pytest.param("mute", {"types": "S"}, DeviceTimeout, "", marks=FULL),
    ("mute", {"dashboard": True}, DeviceTimeout, ""),
    ("silence", {}, DeviceTimeout, ""),
    pytest.param("reject_scripts", {}, DeviceFault, "script-rejected", marks=FULL),
    ("robot_mode", {"mode": "POWER_OFF"}, DeviceFault, "not-powered"),
    pytest.param("robot_mode", {"mode": "IDLE"}, DeviceFault, "brakes-on", marks=FULL),
    ("robot_mode", {"mode": "BOOTING"}, DeviceFault, "booting"),
    pytest.param(
        "robot_mode", {"mode": "BACKDRIVE"}, DeviceFault, "wrong-mode", marks=FULL
    ),
    ("protective_stop", {}, DeviceFault, "protective-stop"),
    pytest.param("safeguard_stop", {}, DeviceFault, "safeguard-stop", marks=FULL),
    ("emergency_stop", {}, DeviceFault, "emergency-stop"),
    pytest.param(
        "emergency_stop", {"system": True}, DeviceFault, "emergency-stop", marks=FULL
    ),
    pytest.param("safety_fault", {}, DeviceFault, "safety-fault", marks=FULL),
    ("remote", {"on": False}, DeviceFault, "local-mode"),
    ("foreign_program", {"name": "welding.urp"}, DeviceFault, "foreign-program"),
    ("in_use", {"names": ["input_int_register_0"]}, DeviceFault, "registers-in-use"),
    (
        "in_use",
        {"names": ["external_force_torque"]},
        DeviceFault,
        "registers-in-use",
    ),
    ("identity", {"serial": "99"}, DeviceFault, "wrong-robot"),
    ("identity", {"model": "UR10"}, DeviceFault, "wrong-robot"),
]


@pytest.mark.parametrize(("verb", "arguments", "kind", "code"), REFUSALS)
def test_a_robot_that_is_not_ready_is_refused_and_why(
    healed, verb, arguments, kind, code
):
    before = healed.do("state")["moves_begun"]
    healed.do(verb, **arguments)
    arm = healed.arm(
        serial="20225500123",
        # A rejected program is found out by the library itself, after 5 s.
        handshake_timeout_s=10 if verb == "reject_scripts" else 2,
    )
    error = refused(arm)
    assert isinstance(error, kind), repr(error)
    assert getattr(error, "code", "") == code, repr(error)
    assert healed.do("state")["moves_begun"] == before


def test_registers_that_a_field_bus_took_can_be_gone_round(healed):
    healed.do("in_use", names=["external_force_torque"])
    with healed.arm(no_ext_ft=True) as arm:
        assert arm.state().standing
    healed.do("in_use", names=["input_int_register_0", "input_double_register_3"])
    with healed.arm(upper_registers=True) as arm:
        assert arm.move_joints(HOME, timeout_s=30).standing


def test_a_slider_at_zero_is_named_before_anything_is_sent(healed):
    since = healed.now_s()
    with healed.arm() as arm:
        healed.do("slider", fraction=0.0)
        time.sleep(0.1)
        with pytest.raises(DeviceFault, match="slider") as caught:
            arm.move_joints(FAR, timeout_s=30)
        assert caught.value.code == "speed-slider-zero"
    assert not healed.moves_since(since)


@pytest.mark.parametrize(
    ("change", "what"),
    [({"tcp": [0, 0, 0.101, 0, 0, 0]}, "tool point"), ({"payload_kg": 1.7}, "payload")],
)
def test_a_tool_that_somebody_changed_is_seen_before_the_next_motion(
    healed, change, what
):
    with healed.arm() as arm:
        assert arm.move_joints(HOME, timeout_s=30).standing
        since = healed.now_s()
        healed.do("retool", **change)
        time.sleep(0.1)
        with pytest.raises(DeviceFault, match=what) as caught:
            arm.move_joints(FAR, timeout_s=30)
        assert caught.value.code == "tool-changed"
        assert not healed.moves_since(since)
    with healed.arm() as arm:  # connecting sets it again
        assert arm.move_joints(HOME, timeout_s=30).standing


@contextmanager
def moving(bench, **settings):
    """An open arm on its way, and where the outcome of the motion will be."""
    outcome: list[object] = []

    def go() -> None:
        try:
            outcome.append(arm.move_joints(FAR, timeout_s=60))
        except Exception as error:
            outcome.append(error)

    arm = bench.arm(joint_speed_deg_s=15, **settings)
    with arm:
        arm.move_joints(HOME, timeout_s=30)
        mover = threading.Thread(target=go)
        mover.start()
        while arm.state().standing and mover.is_alive():
            time.sleep(0.005)
        yield arm, mover, outcome


IN_MOTION = [
    ("protective_stop", {"program": "pause"}, DeviceFault, "protective-stop"),
    pytest.param(
        "protective_stop",
        {"program": "stop"},
        DeviceFault,
        "protective-stop",
        marks=FULL,
    ),
    ("safeguard_stop", {}, DeviceFault, "safeguard-stop"),
    ("emergency_stop", {}, DeviceFault, "emergency-stop"),
    ("safety_fault", {}, DeviceFault, "safety-fault"),
    ("program_stop", {}, DeviceFault, "program-stopped"),
    ("drop", {"how": "fin"}, LOST, ""),
    ("drop", {"how": "rst"}, LOST, ""),
    pytest.param("drop", {"how": "fin", "what": "rtde"}, LOST, "", marks=FULL),
    ("silence", {}, LOST, ""),
    pytest.param("freeze", {}, LOST, "", marks=FULL),
    ("inject", {"hex": "0000"}, LOST, ""),
    pytest.param("inject", {"hex": "000155"}, LOST, "", marks=FULL),
    pytest.param("inject", {"hex": "000255"}, LOST, "", marks=FULL),
    pytest.param("inject", {"hex": "9c3b7f01e2a4" * 20}, LOST, "", marks=FULL),
    ("inject", {"hex": "000355"}, LOST, ""),
    pytest.param("inject", {"hex": "ffff55" + "00" * 40}, LOST, "", marks=FULL),
]


@pytest.mark.parametrize(("verb", "arguments", "kinds", "code"), IN_MOTION)
def test_a_fault_in_motion_ends_it_for_good(healed, verb, arguments, kinds, code):
    with moving(healed, data_timeout_s=0.5) as (arm, mover, outcome):
        since = healed.now_s()
        healed.do(verb, **arguments)
        mover.join(PATIENCE_S)
        assert not mover.is_alive()
        (error,) = outcome
        assert isinstance(error, kinds), repr(error)
        assert error.hint
        assert getattr(error, "code", "") == code, repr(error)
        with pytest.raises(DeviceError):
            arm.move_joints(HOME, timeout_s=30)
    healed.do("clear")
    time.sleep(0.2)
    after = healed.do("state")
    assert not healed.moves_since(since)
    assert after["program"] is None, "nothing may be left that can go on moving"


def ends_in_an_error_or_at_its_goal(bench, mover, outcome) -> None:
    """By its own name, or where the simulated robot truly is."""
    mover.join(PATIENCE_S)
    assert not mover.is_alive()
    (end,) = outcome
    truth = bench.do("state")
    if isinstance(end, Exception):
        assert isinstance(end, (*LOST, DeviceFault)), repr(end)
        assert end.hint
    else:
        assert truth["standing"]
        assert truth["joints"] == pytest.approx(FAR, abs=1e-3)
        assert end.joints == pytest.approx(FAR, abs=1e-3)
        assert end.standing


@FULL
@pytest.mark.parametrize("hex_", ["00047a01", "03e85501" + "40" * 996])
def test_frames_that_the_client_passes_over_change_nothing(healed, hex_):
    """A package of an unknown type; a data package longer than was agreed on."""
    with moving(healed, data_timeout_s=2.0) as (_, mover, outcome):
        healed.do("inject", hex=hex_)
        ends_in_an_error_or_at_its_goal(healed, mover, outcome)
        assert healed.do("state")["standing"]


@FULL
def test_a_slider_that_is_pulled_to_zero_in_motion_is_a_time_out_by_name(healed):
    with moving(healed) as (_, mover, outcome):
        healed.do("slider", fraction=0.0)
        mover.join(3 * PATIENCE_S)
        assert not mover.is_alive()
        (error,) = outcome
        assert isinstance(error, DeviceError), repr(error)
        assert "slider" in f"{error} {error.hint}"
    assert healed.do("state")["program"] is None


@pytest.mark.parametrize("hex_", ["00045501", "00145501" + "40" * 16])
def test_a_frame_cut_short_is_refused_or_leaves_the_motion_what_it_was(healed, hex_):
    """The client library fills a short frame from memory: garbage, or the frame before.

    Which of the two is not in our hands. Garbage ends in an error; values of the frame
    before cannot be told from good ones, and then the motion must end where it was to.
    """
    with moving(healed, data_timeout_s=0.5) as (_, mover, outcome):
        since = healed.now_s()
        healed.do("inject", hex=hex_)
        ends_in_an_error_or_at_its_goal(healed, mover, outcome)
    healed.do("clear")
    time.sleep(0.2)
    assert not healed.moves_since(since)
    assert healed.do("state")["program"] is None


def watch(arm) -> None:
    """Ask for the state until it fails."""
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        arm.state()
        time.sleep(0.01)


@pytest.mark.parametrize(
    ("verb", "arguments"),
    [
        ("drop", {"how": "fin"}),
        ("drop", {"how": "rst"}),
        ("silence", {}),
        pytest.param("freeze", {}, marks=FULL),
        pytest.param("inject", {"hex": "000355"}, marks=FULL),
    ],
)
def test_a_link_that_breaks_at_rest_is_noticed_and_can_be_made_again(
    healed, verb, arguments
):
    arm = healed.arm()
    with arm:
        scripts = healed.do("state")["scripts"]
        since = healed.now_s()
        healed.do(verb, **arguments)
        with pytest.raises(LOST):
            watch(arm)
        with pytest.raises(LOST):
            arm.move_joints(FAR, timeout_s=30)
        healed.do("clear")
        assert healed.do("state")["scripts"] <= scripts + 1, "no loop of restarts"
        arm.open()
        assert arm.state().standing
        assert not healed.moves_since(since)


def test_a_guard_that_was_open_while_the_arm_stood_is_forgotten(healed):
    with healed.arm() as arm:
        healed.do("safeguard_stop")
        time.sleep(0.5)
        with pytest.raises(DeviceFault, match="guard"):
            arm.move_joints(HOME, timeout_s=30)
        healed.do("release")
        while healed.do("state")["runtime_state"] != "PLAYING":
            time.sleep(0.01)
        time.sleep(0.2)
        assert arm.move_joints(HOME, timeout_s=30).standing


START_AND_MOVE = """
import sys
from drivers.arm_ur import UrArm
from mvp.devices import DeviceContext
config = UrArm.Config(
    host=sys.argv[1], payload_kg=1.0, joint_speed_deg_s=10, data_timeout_s=2
)
arm = UrArm.from_config(config, DeviceContext(), name="arm")
arm.open()
print("moving", flush=True)
arm.move_joints([2.5, -1.57, 1.57, -1.57, -1.57, 0.0], timeout_s=600)
"""


def test_a_process_that_is_killed_leaves_an_arm_that_stands(healed):
    command = [sys.executable, "-c", START_AND_MOVE, healed.simulator.host]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"moving\n"
        while healed.do("state")["standing"]:
            time.sleep(0.01)
        process.kill()
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        truth = healed.do("state")
        if truth["standing"] and truth["program"] is None and not truth["connections"]:
            break
        time.sleep(0.05)
    assert truth["standing"]
    assert truth["program"] is None
    assert truth["joints"][0] < 2.4
    assert not truth["connections"]


def test_a_message_of_the_controller_is_ignored(healed):
    with healed.arm() as arm:
        healed.do("inject", hex="000b4d" + "02" + "6869" + "02" + "7573" + "0200"[:4])
        assert arm.move_joints(HOME, timeout_s=30).standing


def test_a_controller_that_dies_in_motion_is_lost_and_found_again(ur_bench):
    bench = ur_bench()
    with moving(bench) as (arm, mover, outcome):
        bench.do("restart", down_s=2.0)
        mover.join(PATIENCE_S)
        assert isinstance(outcome[0], LOST), repr(outcome)
        assert refused_while_down(bench)
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        error = refused(bench.arm())
        if isinstance(error, DeviceFault):
            break
    assert error.code == "not-powered"
    heal(bench)
    with bench.arm() as arm:
        assert arm.state().standing


def refused_while_down(bench) -> bool:
    return isinstance(refused(bench.arm()), ConnectError | LinkLost)


class Impostor:
    """Something that listens where a PolyScope X controller has RTDE.

    ``answers`` maps package types to whole answers; others get none.
    """

    def __init__(
        self, host: str, answers: dict[str, bytes], first: bytes = b""
    ) -> None:
        self._answers = {ord(kind): answer for kind, answer in answers.items()}
        self._first = first
        self._server = socket.create_server((host, 30004))
        self._server.settimeout(0.1)
        self._threads = [threading.Thread(target=self._serve)]
        self._ended = threading.Event()
        self._threads[0].start()

    def _serve(self) -> None:
        while not self._ended.is_set():
            with suppress(TimeoutError):
                peer, _ = self._server.accept()
                self._threads.append(threading.Thread(target=self._talk, args=(peer,)))
                self._threads[-1].start()

    def _talk(self, peer: socket.socket) -> None:
        peer.settimeout(0.1)
        data = b""
        with peer, suppress(OSError):
            peer.sendall(self._first)
            while not self._ended.is_set():
                with suppress(TimeoutError):
                    data += peer.recv(4096) or self._gone()
                while len(data) >= 3 and len(data) >= int.from_bytes(data[:2], "big"):
                    size, kind = int.from_bytes(data[:2], "big"), data[2]
                    data = data[size:]
                    peer.sendall(self._answers.get(kind, b""))

    def _gone(self) -> bytes:
        raise ConnectionResetError

    def __enter__(self) -> "Impostor":
        return self

    def __exit__(self, *exc: object) -> None:
        self._ended.set()
        for thread in self._threads:
            thread.join()
        self._server.close()


ACCEPTED = bytes.fromhex("00045601")
VERSION_10_11 = bytes.fromhex("001376" + "0000000a" + "0000000b" + "00" * 8)
TYPES = b"DOUBLE,VECTOR6D,VECTOR6D,VECTOR6D,VECTOR6D,INT32,INT32,UINT32,UINT32,UINT32,DOUBLE,DOUBLE,VECTOR3D"
OUTPUTS = (4 + len(TYPES)).to_bytes(2, "big") + b"O\x01" + TYPES
STARTED = bytes.fromhex("00045301")


@pytest.mark.parametrize(
    ("answers", "first", "kinds"),
    [
        ({"V": b"HTTP/1.1 400 Bad Request\r\n"}, b"", (WireError,)),
        (
            {"V": ACCEPTED, "v": VERSION_10_11},
            bytes.fromhex("00074d01410000"),
            (WireError,),
        ),
        (
            {"V": ACCEPTED, "v": VERSION_10_11, "O": OUTPUTS, "S": STARTED},
            b"",
            (ConnectError, DeviceTimeout),
        ),
    ],
    ids=["another protocol", "a message before the answer", "no data after the start"],
)
def test_something_else_than_a_robot_is_found_out(ur_shared, answers, first, kinds):
    host = "127.0.77.77"
    with Impostor(host, answers, first):
        error = refused(ur_shared.arm(host=host, handshake_timeout_s=5))
    assert isinstance(error, kinds), repr(error)


def test_a_robot_that_is_driven_already_is_left_alone(healed):
    with healed.arm() as first:
        error = refused(healed.arm())
        assert isinstance(error, DeviceFault)
        assert error.code == "foreign-program"
        assert first.move_joints(HOME, timeout_s=30).standing
