"""Robot programs: the one that obeys a control client, others, and foreign ones."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from drivers.simulators.ur.commands import COMMANDS, REALTIME
from drivers.simulators.ur.motion import Chain, ScriptError, path_move
from drivers.simulators.ur.script import Program, call_of, path_entry

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from drivers.simulators.ur.robot import Robot

READY, DONE = 1, 2
STOP_SCRIPT = 255
_RUNNING_BIT = 0x8000
_COUNTS = 128
_LARGEST = 1e6


class Runnable(Protocol):
    """A program on the controller."""

    name: str

    def step(self) -> bool:
        """One control cycle; False when the program is over.

        Raises:
            ScriptError: it died of a run-time error.
        """
        ...


class ForeignProgram:
    """A program from the teach pendant that goes on until it is stopped."""

    def __init__(self, name: str) -> None:
        self.name = name

    def step(self) -> bool:
        """It never ends by itself."""
        return True


class TextProgram:
    """An uploaded program of plain moves, stops, sleeps and register writes."""

    def __init__(self, robot: Robot, program: Program) -> None:
        self.name = program.name
        self._robot = robot
        self._steps = self._run(program)

    def step(self) -> bool:
        """One control cycle."""
        return next(self._steps, None) is not None

    def _run(self, program: Program) -> Iterator[bool]:
        for line in program.lines:
            yield from self._call(line.split("#")[0].strip())

    def _call(self, line: str) -> Iterator[bool]:
        robot, call = self._robot, call_of(line)
        if call is None:
            return
        name, arguments = call
        if name in ("movej", "movel", "movep"):
            start = robot.arm.will_stand_at()
            robot.arm.begin(path_move(robot.kin, start, [path_entry(line)], robot.tcp))
            yield from _until(lambda: robot.arm.idle)
        elif name in ("stopj", "stopl"):
            robot.stop_motion(float(arguments[0]), linear=name == "stopl")
            yield from _until(lambda: robot.arm.idle)
        elif name == "write_output_integer_register":
            number = sum(int(part) for part in arguments[0].split("+"))
            robot.registers.out_int[number] = _int32(int(arguments[1]))
            yield True
        elif name == "sleep":
            until = robot.now_s + float(arguments[0])
            yield from _until(lambda: robot.now_s >= until)


def _int32(value: int) -> int:
    """As a register keeps it."""
    return (value + 2**31) % 2**32 - 2**31


def _until(done: Callable[[], bool]) -> Iterator[bool]:
    yield True
    while not done():
        yield True


class ControlProgram:
    """What the uploaded control script does, cycle by cycle.

    ::

        input 0 == 0          -> READY
        a real-time command   -> obeyed every cycle, READY
        any other command     -> obeyed once, DONE until input 0 returns to 0
        255                   -> the program ends
    """

    def __init__(self, robot: Robot, program: Program) -> None:
        self.name = program.name
        self.robot = robot
        self.script = program
        self.path: Chain | None = None
        self.watchdog_hz = 0.0
        self._int_offset = program.offset("int")
        self._float_offset = program.offset("float")
        self._executing = False
        self._busy: Callable[[], bool] | None = None
        self._async_move = False
        self._async_stop = False
        self._stops_linear = False
        self._changes = self._operation = 0
        self._shown_progress = -1
        self.write_progress(-1)
        self.write_int(0, READY)
        self._kicks, self._last_kick_s = 0, robot.now_s

    def int_in(self, number: int) -> int:
        """An integer input, counted from the script's offset."""
        return self.robot.registers.in_int[number + self._int_offset]

    def floats_in(self, first: int, count: int) -> list[float]:
        """Double inputs, counted from the script's offset.

        Raises:
            ScriptError: one of them is no number, or absurdly large.
        """
        first += self._float_offset
        values = self.robot.registers.in_double[first : first + count]
        if not all(abs(value) < _LARGEST for value in values):
            raise ScriptError("a number that no controller takes")
        return values

    def write_int(self, number: int, value: int) -> None:
        """An integer output, counted from the script's offset."""
        self.robot.registers.out_int[number + self._int_offset] = value

    def write_floats(self, first: int, values: list[float]) -> None:
        """Double outputs, counted from the script's offset."""
        first += self._float_offset
        self.robot.registers.out_double[first : first + len(values)] = values

    def write_progress(self, value: int) -> None:
        """The asynchronous word: operation, change counter, running bit, progress."""
        self._changes = (self._changes + 1) % _COUNTS
        if value == 0:
            self._operation = (self._operation + 1) % _COUNTS
        word = self._changes << 16 | self._operation << 24
        if value >= 0:
            word |= _RUNNING_BIT | min(value, _RUNNING_BIT - 1)
        self.write_int(2, word)

    def step(self) -> bool:
        """One control cycle.

        Raises:
            ScriptError: a command that cannot be obeyed, or the watchdog.
        """
        self._watch_client()
        self._watch_motion()
        if self._busy is not None:
            if self._busy():
                return True
            self._finish()
            return True
        command = self.int_in(0)
        if command == STOP_SCRIPT:
            self.robot.log_command(command, [], 0)
            return False
        self._obey(command)
        return True

    def begin(self, move: Callable[[], None], *, asynchronous: bool) -> None:
        """Run a move: beside the loop, or before the command is done."""
        self._kill_move()
        if asynchronous:
            self._async_move = True
            self._shown_progress = -1
            self.write_progress(0)
            move()
        else:
            move()
            self.wait(lambda: not self.robot.arm.idle)

    def stop(self, deceleration: float, *, asynchronous: bool) -> None:
        """``stopL`` and ``stopJ`` of the client, as the shipped script has them.

        It never looks which of the two was asked for: it runs stopj until some
        asynchronous stop was asked for, and stopl ever after.
        """
        running, self._async_stop = self._async_stop, False
        if running:
            self.write_progress(-1)
        else:
            self._kill_move()
        if asynchronous:
            self._stops_linear = True
            self._async_stop = True
            self.write_progress(0)
        self.robot.stop_motion(deceleration, linear=self._stops_linear)
        if not asynchronous:
            self.wait(lambda: not self.robot.arm.idle)

    def wait(self, busy: Callable[[], bool]) -> None:
        """The present command is done when ``busy`` says no more."""
        self._busy = busy

    def _obey(self, command: int) -> None:
        if command in REALTIME:
            self._run(command)
            self.write_int(0, READY)
        elif command == 0:
            self._executing = False
            self.write_int(0, READY)
        elif not self._executing:
            self._executing = True
            self.robot.log_command(command, self.floats_in(0, 18), self.int_in(1))
            self._run(command)
            if self._busy is None:
                self._finish()

    def _run(self, command: int) -> None:
        if command not in COMMANDS:
            raise ScriptError(f"command {command} is not simulated")
        COMMANDS[command](self)

    def _finish(self) -> None:
        self._busy = None
        self.write_int(0, DONE)

    def _kill_move(self) -> None:
        """Forget the asynchronous move; the arm still has its speed."""
        if self._async_move:
            self._async_move = False
            self.write_progress(-1)
        self.path = None

    def _watch_motion(self) -> None:
        """Report path progress and the end of what runs beside the loop."""
        idle = self.robot.arm.idle
        if (self._async_move or self._async_stop) and idle:
            self._async_move = self._async_stop = False
            self.path = None
            self.write_progress(-1)
        elif self.path is not None and self.robot.arm.current is self.path:
            index = self.path.index(self.robot.arm.time_s)
            if index != self._shown_progress:
                self._shown_progress = index
                self.write_progress(self.script.path()[index].progress)

    def _watch_client(self) -> None:
        """Die when input 0 is not rewritten often enough."""
        name = f"input_int_register_{self._int_offset}"
        kicks = self.robot.registers.writes.get(name, 0)
        if kicks != self._kicks or not self.watchdog_hz:
            self._kicks, self._last_kick_s = kicks, self.robot.now_s
        elif self.robot.now_s - self._last_kick_s > 1 / self.watchdog_hz:
            raise ScriptError("the RTDE watchdog fired")
