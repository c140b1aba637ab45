"""The simulated GRBL family, byte by byte, on a clock that the test turns.

Transcripts are what real firmware said.
"""

from __future__ import annotations

import re
from typing import Any

import pytest

from drivers.simulators.grbl import GrblConfig, GrblMachine
from tests.wire.machine_bench import MachineBench

UNLOCK = b"[MSG:'$H'|'$X' to unlock]\r\n"
GREETING = b"\r\nGrbl 1.1h ['$' for help]\r\n" + UNLOCK


class Bench(MachineBench[GrblMachine]):
    """A controller that has booted, and the time on its clock."""

    def __init__(self, profile: str, **keys: Any) -> None:
        config = GrblConfig.model_validate({"profile": profile, "boot_s": 0.0, **keys})
        super().__init__(GrblMachine(config))
        self.say(b"")

    def home(self) -> bytes:
        return self.say(b"$H\n") + self.wait(120)

    def place(self) -> list[float]:
        found = re.search(rb"MPos:([-0-9.,]+)", self.say(b"?"))
        assert found is not None
        return [float(x) for x in found[1].split(b",")]

    def state(self) -> str:
        return self.say(b"?")[1:].split(b"|")[0].decode()


def homed(profile: str, **keys: Any) -> Bench:
    bench = Bench(profile, homing_seek_min=30_000, **keys)
    assert bench.home().endswith(b"ok\r\n")
    return bench


class TestGrbl:
    @pytest.fixture
    def board(self) -> Bench:
        return homed("grbl")

    def test_power_on_greets_and_is_locked(self) -> None:
        board = Bench("grbl")
        board.machine.power_up(board.now_s)
        assert board.wait(0.1) == GREETING
        assert board.say(b"G1X-5F100\n") == b"error:9\r\n"
        said = board.say(b"?")
        assert said.startswith(b"<Alarm|MPos:0.000,0.000,0.000|Bf:15,128|FS:0,0")

    def test_it_says_who_it_is(self) -> None:
        board = Bench("grbl")
        assert board.say(b"$I\n") == b"[VER:1.1h.20190830:]\r\n[OPT:V,15,128]\r\nok\r\n"

    def test_the_first_idle_report_and_the_cadence_of_its_rare_fields(
        self, board: Bench
    ) -> None:
        board.say(b"\x18")
        reports = [board.say(b"?") for _ in range(22)]
        place = b"<Idle|MPos:-1.000,-1.000,-1.000|Bf:15,128|FS:0,0"
        assert reports[0] == place + b"|WCO:0.000,0.000,0.000>\r\n"
        assert reports[1] == place + b"|Ov:100,100,100>\r\n"
        offsets = [k for k, said in enumerate(reports) if b"WCO" in said]
        assert offsets == [0, 10, 20]
        assert not [r for r in reports if b"WCO" in r and b"Ov" in r]

    def test_a_whole_line_end_counts_twice(self, board: Bench) -> None:
        assert board.say(b"G21\r\n") == b"ok\r\nok\r\n"

    def test_a_long_line_is_refused(self, board: Bench) -> None:
        assert board.say(b"G1" + b"0" * 78 + b"\n") == b"error:11\r\n"

    def test_spelling_does_not_matter_and_other_numbers_do(self, board: Bench) -> None:
        assert board.say(b"g1x-5f100 (there) ; now\n") == b"ok\r\n"
        assert board.say(b"G1 X-3,5\n") == b"error:1\r\n"
        assert board.say(b"G1 X-3 f1e3\n") == b"error:20\r\n"
        assert board.say(b"G1 X-3\xe9 F100\n") == b"ok\r\n"

    def test_a_status_is_answered_before_the_text_around_it(self, board: Bench) -> None:
        said = board.say(b"G1 X-20 F600\n?")
        assert said.startswith(b"<Idle")
        assert said.endswith(b"ok\r\n")

    def test_fifty_questions_get_three_answers(self, board: Bench) -> None:
        assert board.say(b"?" * 50).count(b"<") == 3

    def test_twelve_lines_at_once_overflow_and_join(self, board: Bench) -> None:
        line = b"G1 X-10.00 Y-10.00 Z-10.0000 F3000\n"
        said = board.say(line * 12) + board.wait(2)
        assert len(line) == 35
        assert said.startswith(b"ok\r\nok\r\nok\r\nALARM:2\r\n[MSG:Reset to continue]")
        assert board.say(b"?$X\n") == b""

    def test_ok_means_queued_and_a_dwell_means_done(self, board: Bench) -> None:
        board.say(b"G1 X-50.5 F3000\n")
        assert board.say(b"G4 P0\n") == b""
        assert board.state() == "Run"
        assert board.wait(3) == b"ok\r\n"
        assert board.place() == [-50.5, -1.0, -1.0]

    def test_the_sixteenth_move_waits_for_room(self, board: Bench) -> None:
        for k in range(15):
            assert board.say(b"G1 X-%d F300\n" % (10 + k)) == b"ok\r\n"
        assert board.say(b"G1 X-30\n") == b""
        assert board.wait(4) == b"ok\r\n"

    def test_questions_while_it_moves(self, board: Bench) -> None:
        board.say(b"G1 X-50 F600\n")
        assert board.say(b"$I\n") == b"error:8\r\n"
        assert board.say(b"$G\n").startswith(b"[GC:G1 G54")
        assert board.say(b"$J=G91 X1 F100\n") == b"error:8\r\n"

    def test_a_hold_keeps_the_place_and_a_reset_then_keeps_it_too(
        self, board: Bench
    ) -> None:
        board.say(b"G1 X-100 F3000\n")
        board.wait(0.5)
        board.say(b"!")
        assert board.state() == "Hold:1"
        assert board.wait(0.3) == b""
        assert board.state() == "Hold:0"
        place = board.place()
        assert board.say(b"\x18") == b"\r\nGrbl 1.1h ['$' for help]\r\n"
        assert board.state() == "Idle"
        assert board.place() == place

    def test_a_hold_at_rest_keeps_lines_waiting(self, board: Bench) -> None:
        board.say(b"!")
        assert board.state() == "Hold:0"
        assert board.say(b"G1 X-5 F600\n") == b""
        assert board.say(b"~") == b"ok\r\n"

    def test_a_door(self, board: Bench) -> None:
        board.say(b"G1 X-100 F3000\n")
        board.wait(0.3)
        board.say(b"\x84")
        assert board.state() == "Door:2"
        board.wait(0.3)
        assert board.state() == "Door:0"
        board.say(b"~")
        board.wait(3)
        assert board.place()[0] == -100.0

    def test_a_reset_in_motion_loses_the_place(self, board: Bench) -> None:
        board.say(b"G1 X-100 F3000\n")
        board.wait(0.3)
        assert board.say(b"\x18") == b"ALARM:3\r\n" + GREETING

    def test_a_soft_limit_makes_it_dead_until_a_reset(self, board: Bench) -> None:
        place = board.place()
        assert board.say(b"G1 X-5000 F3000\n") == (
            b"ALARM:2\r\n[MSG:Reset to continue]\r\n"
        )
        assert board.say(b"?") == b""
        assert board.say(b"$X\n") == b""
        assert board.say(b"\x18") == b"ok\r\n" + GREETING
        assert board.say(b"$X\n") == b"[MSG:Caution: Unlocked]\r\nok\r\n"
        assert board.place() == place

    def test_a_limit_switch_and_the_way_off_it(self) -> None:
        board = homed("grbl", hard_limits=True)
        board.say(b"G1 X-20 F3000\n")
        board.wait(1)
        board.say(b"G1 X-40 F3000\n")
        board.machine.axes.press.add(0)
        assert board.wait(0.01) == b"ALARM:1\r\n[MSG:Reset to continue]\r\n"
        assert board.say(b"?") == b""
        board.say(b"\x18")
        assert b"|Pn:X" in board.say(b"?")
        board.say(b"$X\n")
        assert b"ALARM:1" in board.say(b"G1 X-30 F3000\n") + board.wait(0.05)
        board.say(b"\x18")
        board.say(b"$X\n")
        assert board.say(b"$21=0\n") == b"ok\r\n"
        board.say(b"G91 G1 X-10 F3000\n")
        assert b"ALARM" not in board.wait(1)

    def test_homing_is_silent_and_ends_at_the_pull_off(self) -> None:
        board = Bench("grbl", homing_seek_min=30_000)
        board.say(b"$H\n")
        assert board.say(b"?????") == b""
        said = board.wait(120)
        assert said.startswith(b"<Home|MPos:-1.000,-1.000,-1.000|")
        assert said.count(b"<") == 1
        assert said.endswith(b"ok\r\n")

    def test_homing_at_the_other_end(self) -> None:
        axes = [
            {"letter": x, "travel": 200, "rate_min": 6000, "acceleration": 500}
            for x in "XYZ"
        ]
        axes[0] |= {"switch": "low", "start": 50}
        board = homed("grbl", axes=axes)
        assert board.place() == [-199.0, -1.0, -1.0]

    def test_only_newer_firmware_homes_one_axis(self, board: Bench) -> None:
        assert board.say(b"$H1\n") == b"error:3\r\n"
        assert board.say(b"$HX\n") == b"error:3\r\n"

    def test_a_reset_while_it_homes(self) -> None:
        board = Bench("grbl")
        board.say(b"$H\n")
        board.wait(0.5)
        assert board.say(b"\x18") == b"ALARM:6\r\nok\r\n" + GREETING

    def test_a_switch_that_is_not_there(self) -> None:
        board = Bench("grbl", homing_seek_min=60_000)
        board.machine.axes.broken.add(2)
        board.say(b"$H\n")
        assert board.wait(60) == b"ALARM:9\r\nok\r\n" + GREETING

    def test_jogs(self, board: Bench) -> None:
        assert board.say(b"$J=G91 X-10\n") == b"error:22\r\n"
        assert board.say(b"$J=G91 X10 F100\n") == b"error:15\r\n"
        assert board.say(b"$J=G91 G21 X-100 F3000\n") == b"ok\r\n"
        assert board.say(b"G1 X-5 F100\n") == b"error:9\r\n"
        board.wait(0.3)
        assert board.state() == "Jog"
        assert board.say(b"\x85") + board.wait(0.3) == b""
        assert board.state() == "Idle"
        assert -100 < board.place()[0] < -1

    def test_check_mode_reads_and_does_not_move(self, board: Bench) -> None:
        assert board.say(b"$C\n") == b"[MSG:Enabled]\r\nok\r\n"
        assert board.say(b"G1 X-50 F100\n") == b"ok\r\n"
        board.wait(0.5)
        assert board.place()[0] == -1.0
        assert board.state() == "Check"
        said = board.say(b"$C\n")
        assert said == b"[MSG:Disabled]\r\nok\r\n\r\nGrbl 1.1h ['$' for help]\r\n"
        board.say(b"$C\n")
        assert board.say(b"G1 X-5000 F100\n").startswith(b"ALARM:2")

    def test_sleep_ends_by_a_reset_in_alarm(self, board: Bench) -> None:
        assert board.say(b"$SLP\n") == b"ok\r\n"
        assert board.state() == "Sleep"
        assert board.say(b"G21\n") == b""
        assert board.say(b"\x18") == GREETING
        assert board.state() == "Alarm"

    def test_it_counts_whole_steps(self, board: Bench) -> None:
        board.say(b"G1 X-2.010 F600\n")
        board.wait(1)
        assert board.place()[0] in (-2.008, -2.012)
        assert board.machine.axes.truth[0] in (-2.008, -2.012)

    def test_inches(self) -> None:
        board = homed("grbl", settings={"13": "1"})
        assert board.place() == [-0.039, -0.039, -0.039]

    def test_boot_coordinates_have_soft_limits_too(self) -> None:
        board = Bench("grbl")
        board.say(b"$X\n")
        assert board.say(b"G1 X5 F100\n").startswith(b"ALARM:2")


class TestGrblHal:
    @pytest.fixture
    def board(self) -> Bench:
        return homed("grblhal")

    def test_it_says_who_it_is(self) -> None:
        board = Bench("grblhal", user_text="north")
        said = board.say(b"$I\n")
        assert b":north]\r\n[OPT:VNML+,100,1024,5,0]\r\n[AXS:5:XYZAB]\r\nok" in said
        board.machine.power_up(board.now_s)
        assert b"GrblHAL 1.1f ['$' or '$HELP' for help]" in board.wait(0.1)

    def test_a_report(self, board: Bench) -> None:
        board.say(b"??")
        assert board.say(b"?") == (
            b"<Idle|MPos:-1.000,-1.000,-1.000,0.000,0.000|Bf:100,1024|H:1>\r\n"
        )

    def test_every_question_is_answered(self, board: Bench) -> None:
        assert board.say(b"?" * 30 + b"\x80" * 20).count(b"<") == 50

    def test_a_whole_line_end_counts_once(self, board: Bench) -> None:
        assert board.say(b"G21\r\n") == b"ok\r\n"

    def test_an_error_sticks_until_an_empty_line(self, board: Bench) -> None:
        assert board.say(b"G1 X-3,5 F100\n") == b"error:1\r\n"
        assert board.say(b"G21\n") == b"error:1\r\n"
        assert board.say(b"\n") == b"ok\r\n"
        assert board.say(b"G21\n") == b"ok\r\n"

    def test_an_error_sticks_until_a_dollar_command(self, board: Bench) -> None:
        board.say(b"G77\n")
        assert board.say(b"G21\n") == b"error:20\r\n"
        board.say(b"$G\n")
        assert board.say(b"G21\n") == b"ok\r\n"

    def test_an_alarm_still_answers_but_unlocks_only_after_a_reset(
        self, board: Bench
    ) -> None:
        assert board.say(b"G1 X-5000 F3000\n").startswith(b"ALARM:2")
        assert board.state() == "Alarm"
        assert board.say(b"$X\n") == b"error:79\r\n"
        board.say(b"\x18")
        assert board.say(b"$X\n") == b"[MSG:Caution: Unlocked]\r\nok\r\n"

    def test_an_axis_that_was_not_homed_runs_far_outside(self) -> None:
        board = Bench("grblhal")
        board.say(b"$X\n")
        assert board.say(b"G1 X50 F100\n") == b"ok\r\n"

    def test_one_axis_is_homed_by_its_letter(self) -> None:
        keys = {"homing_seek_min": 30_000, "settings": {"22": "3"}}
        board = Bench("grblhal", **keys)
        board.say(b"$HZ\n")
        assert board.wait(60).endswith(b"ok\r\n")
        assert board.machine.motion.homed == {2}
        assert b"|H:0,4>" in board.say(b"?")

    def test_one_axis_is_homed_only_where_that_is_allowed(self) -> None:
        board = Bench("grblhal", settings={"22": "1"})
        assert board.say(b"$HZ\n") == b"error:5\r\n"

    def test_it_reports_now_and_then_while_it_homes(self) -> None:
        board = Bench("grblhal")
        board.say(b"$H\n")
        said = b"".join(board.say(b"?") + board.wait(0.1) for _ in range(20))
        assert 1 <= said.count(b"<Home|") < 20

    def test_the_other_hold_byte_works_where_the_first_is_switched_off(self) -> None:
        board = homed("grblhal", hold_byte=False)
        board.say(b"G1 X-100 F3000\n")
        board.wait(0.5)
        assert board.state() == "Run"
        board.say(b"\x82")
        board.wait(0.3)
        assert board.state() == "Hold:0"

    def test_turning_axes(self, board: Bench) -> None:
        assert board.say(b"G1 A45 B-30 F6000\n") == b"ok\r\n"
        board.wait(3)
        assert board.place()[3:] == [45.0, -30.0]

    def test_reports_that_nobody_asked_for(self) -> None:
        board = Bench("grblhal", auto_report_s=0.2)
        assert 4 <= board.wait(1.0).count(b"<") <= 6


def test_a_rapid_move_of_one_axis_moves_only_that_one() -> None:
    board = Bench("grblhal")
    board.say(b"$X\n")
    before = board.machine.motion.axes.counter.copy()
    board.say(b"G0 A5\n")
    board.wait(5.0)
    moved = board.machine.motion.axes.counter - before
    assert moved.tolist() == [0, 0, 0, 5, 0]


def test_settings_are_numbers_as_on_the_board() -> None:
    board = Bench("grblhal")
    assert board.say(b"$10=500.0\n") == b"ok\r\n"
    assert b"$10=500\r\n" in board.say(b"$$\n")
    assert board.say(b"$130=432.5\n") == b"ok\r\n"
    assert b"$130=432.5\r\n" in board.say(b"$$\n")
    for bad, error in ((b"", 2), (b"x", 2), (b"1e400", 2), (b"9" * 60, 2), (b"-1", 4)):
        assert board.say(b"$10=" + bad + b"\n") == b"error:%d\r\n" % error
    assert board.state() == "Alarm"
