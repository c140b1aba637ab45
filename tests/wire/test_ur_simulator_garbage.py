"""Nothing that a client sends can stop the simulated controller."""

from __future__ import annotations

import struct

from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.simulators.control import answer
from drivers.simulators.ur.dashboard import Dashboard
from drivers.simulators.ur.faults import verbs
from drivers.simulators.ur.robot import Robot, RobotSettings, RuntimeState
from drivers.simulators.ur.script import ScriptReader
from drivers.simulators.ur.server import Controller
from drivers.simulators.ur.sessions import Disturbance, Line, RtdeSession, Session
from drivers.simulators.ur.telemetry import Telemetry
from drivers.simulators.ur.variables import INPUTS, OUTPUTS

NAMES = st.lists(st.sampled_from([*INPUTS, *OUTPUTS, "nonsense", ""]), max_size=8)
WORDS = st.sampled_from(
    """movej movel movep stopj stopl sleep write_output_integer_register def end [ ] (
    ) p[ = a= v= r= 0.5 -1 nan inf 1e400 , : # rtde_control() \n popup play pause load
    x.urp power on off unlock protective stop restart safety""".split(" ")
)


class Wire:
    """Takes what the controller sends."""

    def __init__(self) -> None:
        self.sent = b""
        self.closed = False

    def write(self, data: bytes) -> None:
        self.sent += data

    def close(self) -> None:
        self.closed = True

    def get_write_buffer_size(self) -> int:
        return 0


def _session(robot: Robot) -> tuple[RtdeSession, Wire]:
    wire, sessions = Wire(), set[Session]()
    line = Line(30004, Disturbance(), wire)  # type: ignore[arg-type]
    return RtdeSession(robot, line, sessions, Telemetry(robot)), wire


@st.composite
def packages(draw: st.DrawFn) -> bytes:
    """Something between a good package and noise."""
    kind = draw(st.sampled_from(b"VvOISPUM\x00\xff"))
    names = ",".join(draw(NAMES)).encode()
    body = draw(
        st.one_of(
            st.binary(max_size=60),
            st.just(names),
            st.floats().map(lambda f: struct.pack(">d", f) + names),
            st.binary(max_size=40).map(lambda b: b"\x01" + b),
            st.just(struct.pack(">H", 2)),
        )
    )
    return struct.pack(">HB", len(body) + 3, kind) + body


def _running() -> Robot:
    """A robot with the control program, as a client has left it."""
    robot = Robot(RobotSettings())
    for program in ScriptReader().feed(b"def rtde_control():\nend\n"):
        robot.upload(program)
    return robot


def _as_new(robot: Robot) -> bool:
    """Powered, safe, and a program that is sent now runs."""
    assert robot.safety.may_run
    for program in ScriptReader().feed(b"def rtde_control():\nend\n"):
        robot.upload(program)
    for _ in range(60):
        robot.tick()
    return robot.state == RuntimeState.PLAYING


def _talk(data: list[bytes]) -> Robot:
    robot = _running()
    before = robot.arm.joints.tolist()
    session, wire = _session(robot)
    for chunk in data:
        if not wire.closed:
            session.data_received(chunk)
        for _ in range(30):
            robot.tick()
            session.each_cycle()
    fresh, answers = _session(robot)
    fresh.data_received(b"\x00\x03v")
    assert answers.sent[:3] == b"\x00\x13v"
    if not any(chunk[2:3] == b"U" for chunk in data):  # only those carry commands
        assert robot.arm.joints.tolist() == before
        assert robot.arm.begun == 0
    return robot


@given(st.lists(packages(), max_size=8))
@settings(max_examples=60, deadline=None)
def test_rtde_clients_cannot_break_it(data: list[bytes]) -> None:
    assert _as_new(_talk(data))


@given(
    st.integers(0, 80),
    st.lists(st.floats() | st.floats(-3, 3), min_size=18, max_size=18)
    | st.lists(st.floats(-3, 3), min_size=18, max_size=18),
    st.integers(-2, 3),
)
@settings(max_examples=100, deadline=None)
def test_commands_with_any_numbers_end_the_program_at_most(
    command: int, values: list[float], flag: int
) -> None:
    robot = _running()
    for _ in range(30):
        robot.tick()
    robot.registers.in_double[:18] = values
    robot.registers.in_int[:2] = [command, flag]
    for _ in range(10):
        robot.tick()
    assert abs(robot.arm.joints).max() < 10


@given(st.lists(WORDS, max_size=30), st.sampled_from(["", "def own():\n"]))
@settings(max_examples=200, deadline=None)
def test_scripts_of_any_words_end_by_themselves(words: list[str], head: str) -> None:
    robot = Robot(RobotSettings())
    text = head + "".join(words) + "\nend\n"
    for program in ScriptReader().feed(text.encode()):
        robot.upload(program)
    for _ in range(40):
        robot.tick()
    assert abs(robot.arm.joints).max() < 10


@given(st.lists(WORDS, max_size=6))
@settings(deadline=None)
def test_the_dashboard_answers_anything_with_one_line(words: list[str]) -> None:
    robot = Robot(RobotSettings())
    board = Dashboard(robot)
    said = board.reply(" ".join(words).replace("\n", ""))
    assert said
    assert "\n" not in said
    assert board.reply("robotmode").startswith("Robotmode: ")
    assert robot.arm.begun == 0


def test_muted_types_are_not_sent_and_the_rest_is() -> None:
    robot = Robot(RobotSettings())
    session, wire = _session(robot)
    session.line.disturbance.muted = frozenset(b"OU")
    session.data_received(struct.pack(">HBH", 5, ord("V"), 2))
    session.data_received(struct.pack(">HBd", 20, ord("O"), 500.0) + b"timestamp")
    session.data_received(struct.pack(">HB", 3, ord("S")))
    for _ in range(5):
        robot.tick()
        session.each_cycle()
    assert wire.sent == b"\x00\x04V\x01" + b"\x00\x04S\x01"
    session.line.disturbance.muted = frozenset()
    robot.tick()
    session.each_cycle()
    assert wire.sent[8:12] == b"\x00\x0cU\x01"


def test_a_frequency_next_to_nothing_has_no_turn() -> None:
    robot = Robot(RobotSettings())
    session, wire = _session(robot)
    session.data_received(struct.pack(">HBH", 5, ord("V"), 2))
    session.data_received(struct.pack(">HBd", 20, ord("O"), 5e-324) + b"timestamp")
    assert wire.sent[-10:] == b"\x00\x0aO\x01DOUBLE"
    assert not wire.closed


def test_every_verb_refuses_what_it_does_not_understand() -> None:
    controller = Controller(Robot(RobotSettings()), "127.0.0.1")
    table = verbs(controller)
    for line in (
        b'{"do": "slider", "fraction": NaN}',
        b'{"do": "slider"}',
        b'{"do": "protective_stop", "program": "dance"}',
        b'{"do": "robot_mode", "mode": "DANCING"}',
        b'{"do": "release"}',
        b'{"do": "drop", "what": "everything"}',
        b'{"do": "inject", "hex": "xyz"}',
        b'{"do": "in", "seconds": 1}',
        b'{"do": "in_use", "names": 3}',
    ):
        assert answer(line, table).startswith(b'{"ok": false'), line
