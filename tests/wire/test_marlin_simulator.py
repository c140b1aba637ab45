"""The simulated Marlin board, byte by byte, on a clock that the test turns."""

from __future__ import annotations

import re
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.simulators.marlin import MarlinConfig, MarlinMachine
from tests.fuzzing import Mutants, at_length, fuzz
from tests.wire.machine_bench import MachineBench

KILLED = b"Error:Printer halted. kill() called!\n"


def summed(line: str) -> bytes:
    check = 0
    for byte in line.encode():
        check ^= byte
    return f"{line}*{check}\n".encode()


class Bench(MachineBench[MarlinMachine]):
    """A board that has booted, and the time on its clock."""

    def __init__(self, **keys: Any) -> None:
        super().__init__(MarlinMachine(MarlinConfig.model_validate(keys)))


@pytest.fixture
def board() -> Bench:
    return Bench(homing_seek_min=30_000)


def test_power_on(board: Bench) -> None:
    board.machine.power_up(board.now_s)
    assert board.say(b"M115\n") == b""
    assert board.wait(0.6).startswith(b"start\necho:Marlin")
    assert board.say(b"M110 N0\n") == b"ok\n"


def test_it_says_who_it_is(board: Bench) -> None:
    said = board.say(b"M115\n")
    assert said.startswith(b"FIRMWARE_NAME:Marlin 2.1.2.1 ")
    assert b"\nCap:EMERGENCY_PARSER:1\n" in said
    assert said.endswith(b"\nok\n")


def test_what_it_does_not_know_is_ok_too(board: Bench) -> None:
    assert board.say(b"G77\n") == b'echo:Unknown command: "G77"\nok\n'


def test_checksums_and_numbers(board: Bench) -> None:
    assert board.say(summed("N0 M110 N0")) == b"ok\n"
    assert board.say(summed("N1 G21")) == b"ok\n"
    assert board.say(b"N2 G90*1\n") == (
        b"Error:checksum mismatch, Last Line: 1\nResend: 2\nok\n"
    )
    assert board.say(summed("N4 G90")).startswith(
        b"Error:Line Number is not Last Line Number+1, Last Line: 1\nResend: 2"
    )
    assert board.say(b"N2 G90\n").startswith(b"Error:No Checksum with line number")
    assert board.say(summed("N2 G90")) == b"ok\n"
    assert board.say(b"G21\n") == b"ok\n"


def test_homing_says_that_it_is_at_it_and_ends_at_zero(board: Bench) -> None:
    assert board.say(b"G28 X Y Z\n") == b""
    said = board.wait(60)
    assert said.startswith(b"echo:busy: processing\n")
    assert said.endswith(b"ok\n")
    place = board.say(b"M114\n")
    assert place.startswith(b"X:5.00 Y:5.00 Z:5.00 E:0.00 A:0.00 B:0.00 Count X:400 ")


def test_an_axis_without_a_switch_is_homed_where_it_stands(board: Bench) -> None:
    before = board.machine.axes.truth
    assert board.say(b"G28 A B\n") + board.wait(0.1) == b"ok\n"
    assert (board.machine.axes.truth == before).all()
    assert board.say(b"M114\n").endswith(b"ok\n")


def test_the_position_is_the_planned_one(board: Bench) -> None:
    assert board.say(b"G1 X100 F3000\n") == b"ok\n"
    said = board.say(b"M114\n")
    assert said.startswith(b"X:100.00 ")
    assert b"Count X:0 " in said
    board.say(b"M400\n")
    assert board.wait(4) == b"echo:busy: processing\nok\n"
    assert b"Count X:8000 " in board.say(b"M114\n")


def test_it_clamps_without_a_word(board: Bench) -> None:
    assert board.say(b"G1 X5000 Y-3 F3000\n") == b"ok\n"
    assert board.say(b"M114\n").startswith(b"X:1200.00 Y:0.00 ")


def test_end_stops_can_be_switched_off(board: Bench) -> None:
    board.say(b"M211 S0\nG1 Y-3 F3000\n")
    assert board.say(b"M114\n").startswith(b"X:0.00 Y:-3.00 ")


def test_moves_wait_for_room(board: Bench) -> None:
    for k in range(16):
        assert board.say(b"G1 X%d F600\n" % (10 * k + 10)) == b"ok\n"
    assert board.say(b"G1 X5\n") == b""
    assert board.wait(1.5) == b"ok\n"


def test_a_dwell_in_milliseconds(board: Bench) -> None:
    assert board.say(b"G4 P300\n") + board.wait(0.2) == b""
    assert board.wait(0.2) == b"ok\n"


def test_a_longer_ok(board: Bench) -> None:
    board = Bench(advanced_ok=True)
    assert board.say(summed("N1 G90")) == b"ok N1 P15 B3\n"


def test_a_quick_stop_jumps_the_queue(board: Bench) -> None:
    board.say(b"G1 X500 F3000\nM400\n")
    board.wait(0.5)
    assert board.say(b"M410\n") == b"ok\n"
    assert not board.machine.axes.busy


def test_without_an_emergency_parser_it_waits(board: Bench) -> None:
    board = Bench(emergency_parser=False)
    board.say(b"G1 X50 F3000\nM400\n")
    board.wait(0.5)
    assert board.say(b"M410\n") == b""
    assert board.machine.axes.busy
    assert board.wait(1) == b"ok\nok\n"


def test_a_failed_homing_kills_it_until_it_is_switched_off(board: Bench) -> None:
    board.machine.axes.broken.add(0)
    board.say(b"G28\n")
    assert board.wait(30).endswith(b"Error:Homing Failed\n" + KILLED)
    assert board.say(b"M115\n") == b""
    board.machine.power_up(board.now_s)
    assert board.wait(1).startswith(b"start\n")


def test_killed_by_the_host(board: Bench) -> None:
    board.say(b"G1 X50 F3000\n")
    assert board.say(b"M112\n") == KILLED
    assert board.say(b"M114\n") == b""


def test_it_moves_without_being_homed(board: Bench) -> None:
    assert board.say(b"G1 X10 A20 F3000\nM400\n") == b"ok\n"
    assert board.wait(2) == b"ok\n"
    assert board.machine.axes.truth[0] == pytest.approx(610.0)


def test_positions_that_nobody_asked_for(board: Bench) -> None:
    assert board.say(b"M154 S1\n") == b"ok\n"
    assert board.wait(3.2).count(b"X:0.00 ") == 3


_CHUNKS = st.lists(
    st.one_of(
        st.binary(max_size=40),
        st.sampled_from([b"G28\n", b"M410\n", b"M112\n", b"M400\n", b"N1 G28*18\n"]),
        st.from_regex(
            rb"([GMNXYZABF]-?[0-9]{1,4}){1,6}(\*[0-9]{1,3})?\n", fullmatch=True
        ),
    ),
    max_size=12,
)


def _nonsense(chunks: list[bytes]) -> bytes:
    """Whatever was said: only G moves it; its answer when switched off and on."""
    board = Bench(boot_s=0.05)
    axes = board.machine.axes
    before = axes.truth
    for chunk in chunks:
        board.say(chunk)
        board.wait(0.02)
    if b"G" not in b"".join(chunks).upper():
        assert (axes.truth == before).all()
    board.machine.power_up(board.now_s)
    board.wait(0.1)
    stands = axes.truth
    said = board.say(b"M115\n")
    board.wait(0.05)
    assert (axes.truth == stands).all()
    return said


@given(_CHUNKS)
@settings(max_examples=100, deadline=None)
def test_nonsense_does_not_upset_it(chunks: list[bytes]) -> None:
    assert re.fullmatch(rb"FIRMWARE_NAME:Marlin .*ok\n", _nonsense(chunks), re.DOTALL)


LINES = [
    b"G1 X100.5 Y-20 Z3 A4 B5 F3000\n",
    summed("N1 G1 X10 F600"),
    summed("N0 M110 N0") + summed("N1 G90") + summed("N2 G28 X Y Z"),
    b"M115\nM114\nM400\nM119\n",
    b"M410\nM112\n",
    b"M211 S0\nM154 S1\nM92 X80\n",
    b"G4 P300\nG92 X0\n; comment\n",
]
PIECES = b"G0 G28 G91 G92 M110 M410 M112 N1 N-1 *0 *255 ; \n \r X Y-1 F F0 S1 P\xff"


@at_length
def test_much_nonsense_does_not_upset_it() -> None:
    mutants = Mutants(LINES, PIECES.split(b" "))

    def check(first: bytes) -> None:
        said = _nonsense(mutants.several(first, 20))
        assert re.fullmatch(rb"FIRMWARE_NAME:Marlin .*ok\n", said, re.DOTALL)

    fuzz(check, mutants)
