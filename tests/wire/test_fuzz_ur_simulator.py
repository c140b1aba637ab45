"""The simulated UR controller, told anything a hundred thousand times on each port."""

from __future__ import annotations

import struct

from drivers.simulators.ur.dashboard import Dashboard
from drivers.simulators.ur.robot import Robot, RobotSettings
from drivers.simulators.ur.script import ScriptReader
from drivers.simulators.ur.sessions import Disturbance, Line, RtdeSession, Session
from drivers.simulators.ur.telemetry import Telemetry
from tests.fuzzing import Mutants, at_length, fuzz

NAMES = (
    b"timestamp,actual_q,actual_qd,target_qd,robot_mode,safety_mode,runtime_state,"
    b"output_int_register_0,output_double_register_23,speed_scaling"
)
INPUTS = b"input_int_register_0,input_double_register_0,speed_slider_mask"
TINY = struct.pack(">d", 5e-324)  # a frequency without a period


def package(kind: bytes, body: bytes = b"") -> bytes:
    return struct.pack(">H", len(body) + 3) + kind + body


class Wire:
    """Takes what the controller sends."""

    def __init__(self) -> None:
        self.sent = b""
        self.closed = False

    def write(self, data: bytes) -> None:
        self.sent = data

    def close(self) -> None:
        self.closed = True

    def get_write_buffer_size(self) -> int:
        return 0


def connected(robot: Robot) -> tuple[RtdeSession, Wire]:
    wire, sessions = Wire(), set[Session]()
    line = Line(30004, Disturbance(), wire)  # type: ignore[arg-type]
    session = RtdeSession(robot, line, sessions, Telemetry(robot))
    session.data_received(package(b"V", b"\0\2"))
    return session, wire


PACKAGES = [
    package(b"V", b"\0\2"),
    package(b"v"),
    package(b"O", struct.pack(">d", 125.0) + NAMES),
    package(b"O", TINY + NAMES),
    package(b"I", INPUTS),
    package(b"S"),
    package(b"P"),
    package(b"U", b"\1" + struct.pack(">idI", 5, 0.25, 1)),
    package(b"M", b"\3hello"),
]
PIECES = [b"\0\3", b"\0\2", b",", b"actual_q", b"nonsense", b"\xff\xff", TINY]


@at_length
def test_rtde_packages() -> None:
    """Damaged in their bodies or as a whole; 20 on one connection, then a sound one."""
    mutants = Mutants(PACKAGES, PIECES)

    def framed(data: bytes) -> bytes:
        """Two thirds with a size that is right, or nothing behind the size is read."""
        return data if mutants.rng.random() < 0.34 else package(data[2:3], data[3:])

    def check(first: bytes) -> None:
        robot = Robot(RobotSettings())
        session, wire = connected(robot)
        for data in mutants.several(first, 20):
            if wire.closed:
                session.connection_lost(None)
                session, wire = connected(robot)
            session.data_received(framed(data))
            robot.tick()
            session.each_cycle()
        fresh, answers = connected(robot)
        fresh.data_received(b"\0\3v")
        assert answers.sent[:3] == b"\0\x13v"

    fuzz(check, mutants)


PROGRAMS = [
    b"def rtde_control():\n  # int register offset\n  0\nend\n",
    b"def own():\n  movej([0.1, -1.5, 1.5, -1.5, -1.5, 0.0], a=1.4, v=1.05, r=0)\nend\n",
    b"def p():\n# inject move path\nmovel(p[0.3,0.1,0.2,0,3,0], a=0.5, v=0.1)\nend\n",
    b"stopj(2.0)\n",
    b"sec q():\n  write_output_integer_register(0, 3)\n  sleep(0.1)\nend\n",
    b"set_tool_voltage(24)\n",
]
WORDS = [
    *b"movej( movel( p[ [ ] ) a= v= r= nan inf 1e400 def end : ( , # \n \r".split(b" "),
    b"def own():\n",
    b"\nend\n",
    b"# inject move path\n",
]


@at_length
def test_programs() -> None:
    """Twenty on one controller; what they move stays within reach of an arm."""
    mutants = Mutants(PROGRAMS, WORDS)

    def check(first: bytes) -> None:
        robot, reader = Robot(RobotSettings()), ScriptReader()
        for data in mutants.several(first, 20):
            for program in reader.feed(data):
                robot.upload(program)
            robot.tick()
        assert abs(robot.arm.joints).max() < 10
        whole = ScriptReader().feed(b"def rtde_control():\nend\n")
        assert [program.is_control for program in whole] == [True]

    fuzz(check, mutants)


COMMANDS = [
    *b"robotmode,safetystatus,programState,running,stop,pause,play,power on".split(
        b","
    ),
    *b"power off,brake release,unlock protective stop,restart safety,quit".split(b","),
    *b"load x.urp,popup hello,is in remote control,get serial number".split(b","),
]


@at_length
def test_dashboard_commands() -> None:
    """One line comes back to each, and nothing moves."""
    mutants = Mutants(COMMANDS, [b" ", b"load ", b".urp", b"\t", b"\xff"])

    def check(first: bytes) -> None:
        robot = Robot(RobotSettings())
        board = Dashboard(robot)
        for data in mutants.several(first, 20):
            said = board.reply(data.decode("utf-8", "replace").replace("\n", ""))
            assert said
            assert "\n" not in said
        assert board.reply("robotmode").startswith("Robotmode: ")
        assert robot.arm.begun == 0

    fuzz(check, mutants)
