"""The control program of the simulated controller, cycle by cycle, without sockets."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.simulators.ur.dashboard import Dashboard
from drivers.simulators.ur.robot import Robot, RobotSettings, RuntimeState
from drivers.simulators.ur.safety import RobotMode, SafetyMode
from drivers.simulators.ur.script import ScriptReader

HOME = (0.0, -1.57, 1.57, -1.57, -1.57, 0.0)
TARGET = (1.0, *HOME[1:])
MOVE_J, MOVE_L, STOP_L, STOP_J, MOVE_PATH, WATCHDOG = 1, 3, 33, 34, 45, 35
READY, DONE = 1, 2
SCRIPT = b"""def rtde_control():
    global reg_offset_float = # float register offset
%d
    global reg_offset_int = # int register offset
%d
    def exec_move_path():
        # inject move path
%s
    end
end
"""


class Desk:
    """A robot with the control program, and a client's side of its registers."""

    def __init__(self, offset: int = 0, path: bytes = b"", **settings: object) -> None:
        self.robot = Robot(RobotSettings(**settings))  # type: ignore[arg-type]
        self.offset = offset
        self.upload(path)

    def upload(self, path: bytes = b"") -> None:
        text = SCRIPT % (self.offset, self.offset, path)
        for program in ScriptReader().feed(text):
            self.robot.upload(program)
        self.run(0.1)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / self.robot.cycle_s)):
            self.robot.tick()

    def ask(self, command: int, *values: float, flag: int = 0) -> None:
        """Put a command into the registers."""
        registers = self.robot.registers
        registers.in_double[self.offset : self.offset + len(values)] = values
        registers.in_int[self.offset + 1] = flag
        registers.apply({f"input_int_register_{self.offset}": command})

    def done(self) -> None:
        """Take the command back, as a client does once it is done."""
        self.ask(0)
        self.run(2 * self.robot.cycle_s)
        assert self.answer == READY

    def finish(self, command: int, *values: float, flag: int = 0) -> int:
        """One command from beginning to end; cycles it took."""
        self.ask(command, *values, flag=flag)
        for cycle in range(20_000):
            self.robot.tick()
            if self.answer == DONE:
                self.done()
                return cycle
        raise TimeoutError(f"command {command} is never done")

    @property
    def answer(self) -> int:
        return self.robot.registers.out_int[self.offset]

    @property
    def word(self) -> tuple[int, bool, int]:
        """Operation, running, progress."""
        word = self.robot.registers.out_int[self.offset + 2]
        return word >> 24, bool(word & 0x8000), word & 0x7FFF

    @property
    def joints(self) -> np.ndarray:
        return self.robot.arm.joints


@pytest.mark.parametrize("offset", [0, 24])
def test_a_command_is_done_once_until_it_is_taken_back(offset: int) -> None:
    desk = Desk(offset)
    assert desk.answer == READY
    desk.ask(MOVE_J, *TARGET, 2.0, 10.0)
    desk.run(0.1)
    assert desk.answer == READY
    desk.run(2.0)
    assert desk.answer == DONE
    assert desk.robot.arm.begun == 1
    np.testing.assert_array_equal(desk.joints, TARGET)


def test_a_move_takes_the_time_of_its_trapezoid() -> None:
    desk = Desk()
    cycles = desk.finish(MOVE_J, *TARGET, 0.5, 2.0)
    assert cycles * desk.robot.cycle_s == pytest.approx(1 / 0.5 + 0.5 / 2.0, abs=0.01)


@pytest.mark.parametrize("scale", [2.0, 5.0])
def test_a_scaled_arm_takes_so_many_times_less(scale: float) -> None:
    desk = Desk(speed_scale=scale)
    cycles = desk.finish(MOVE_J, *TARGET, 0.5, 2.0)
    assert cycles * desk.robot.cycle_s == pytest.approx(2.25 / scale, abs=0.01)


def test_a_line_is_straight_and_keeps_its_speed() -> None:
    desk = Desk()
    robot = desk.robot
    start = robot.kin.tool_pose(robot.arm.joints, robot.tcp)
    target = np.add(start, [0.0, 0.1, -0.05, 0.0, 0.0, 0.0])
    desk.ask(MOVE_L, *target, 0.1, 0.5)
    way = []
    for _ in range(1000):
        robot.tick()
        way.append(robot.kin.tool_pose(robot.arm.joints, robot.tcp))
    along = np.array(way)[:, :3] - start[:3]
    direction = (target - start)[:3] / np.linalg.norm((target - start)[:3])
    assert np.abs(along - np.outer(along @ direction, direction)).max() < 1e-6
    np.testing.assert_allclose(way[-1], target, atol=1e-9)
    speeds = np.diff(along @ direction) / robot.cycle_s
    assert speeds.max() == pytest.approx(0.1, rel=1e-2)
    assert np.abs(np.diff(speeds)).max() / robot.cycle_s < 0.6


def test_operations_count_to_127_and_begin_again() -> None:
    desk = Desk()
    seen = []
    for k in range(130):
        desk.finish(MOVE_J, *(TARGET if k % 2 else HOME), 3.0, 40.0, flag=1)
        seen.append(desk.word[0])
    assert seen == [(k + 1) % 128 for k in range(130)]


def test_an_asynchronous_move_is_done_at_once_and_runs_beside() -> None:
    desk = Desk()
    assert desk.finish(MOVE_J, *TARGET, 1.0, 5.0, flag=1) < 5
    assert desk.word[1:] == (True, 0)
    desk.run(2.0)
    assert not desk.word[1]
    np.testing.assert_array_equal(desk.joints, TARGET)


def test_a_new_move_brakes_the_old_one_without_a_jump() -> None:
    desk = Desk()
    desk.finish(MOVE_J, *TARGET, 1.0, 5.0, flag=1)
    desk.run(0.4)
    desk.ask(MOVE_J, *HOME, 1.0, 5.0)
    rates = []
    for _ in range(1500):
        desk.robot.tick()
        rates.append(desk.robot.arm.rate[0])
    assert np.abs(np.diff(rates)).max() / desk.robot.cycle_s < 5.5
    np.testing.assert_array_equal(desk.joints, HOME)


def test_stops_are_joint_stops_until_one_was_asynchronous() -> None:
    desk = Desk()
    stopped_s = []
    for command, flag in ((STOP_L, 0), (STOP_J, 1), (STOP_J, 0)):
        desk.finish(MOVE_J, *HOME, 3.0, 20.0)
        desk.finish(MOVE_J, *TARGET, 1.0, 10.0, flag=1)
        desk.run(0.3)
        before = desk.robot.cycle
        desk.ask(command, 4.0, flag=flag)
        desk.run(2 * desk.robot.cycle_s)
        while desk.robot.arm.rate.any():
            desk.robot.tick()
        stopped_s.append((desk.robot.cycle - before) * desk.robot.cycle_s)
        desk.run(0.01)
        desk.done()
    assert stopped_s[0] == pytest.approx(1.0 / 4.0, abs=0.01)
    tool_speed = np.linalg.norm([-0.492159, -0.133379])
    assert stopped_s[1:] == pytest.approx([tool_speed / 4.0] * 2, abs=0.01)


def test_a_path_shows_its_entries_and_rounds_its_corners() -> None:
    lines = b"".join(
        b"        signal_async_progress(%d)\n        movej([%f,-1.57,1.57,-1.57,-1.57,0.0],"
        b"a=4.0,v=1.0,r=%f)\n" % (k, base, blend)
        for k, (base, blend) in enumerate([(0.5, 0.05), (1.0, 0.0), (0.8, 0.0)])
    )
    desk = Desk(path=lines)
    desk.ask(MOVE_PATH, flag=1)
    seen, rates = [], []
    for _ in range(2000):
        desk.robot.tick()
        rates.append(desk.robot.arm.rate[0])
        if not seen or seen[-1] != desk.word[1:]:
            seen.append(desk.word[1:])
    assert [word[1] for word in seen if word[0]] == [0, 1, 2]
    assert not seen[-1][0]
    assert desk.joints[0] == pytest.approx(0.8)
    first_corner = np.array(rates)[: int(np.argmin(rates))]
    moving = first_corner[first_corner > 0.3]
    assert len(moving) > 0
    assert np.abs(np.diff(rates)).max() / desk.robot.cycle_s < 8.5


def test_nothing_moves_while_the_slider_is_at_zero() -> None:
    desk = Desk()
    desk.robot.registers.slider = 0.0
    desk.run(0.5)
    desk.ask(MOVE_J, *TARGET, 1.0, 5.0)
    desk.run(3.0)
    np.testing.assert_array_equal(desk.joints, HOME)
    desk.robot.registers.slider = 0.5
    desk.run(1.2)
    assert 0.1 < desk.joints[0] < 0.9
    desk.run(3.0)
    assert desk.answer == DONE
    np.testing.assert_array_equal(desk.joints, TARGET)


def test_a_protective_stop_holds_within_a_fifth_of_a_second_and_locks_for_five() -> (
    None
):
    desk = Desk()
    dashboard = Dashboard(desk.robot)
    desk.finish(MOVE_J, *TARGET, 1.0, 5.0, flag=1)
    desk.run(0.4)
    desk.robot.safety.protective_stop()
    desk.run(0.21)
    assert desk.robot.arm.standing
    stands = desk.joints.copy()
    assert "until 5s" in dashboard.reply("unlock protective stop")
    desk.run(4.7)
    assert "until 5s" in dashboard.reply("unlock protective stop")
    desk.run(0.2)
    assert dashboard.reply("unlock protective stop") == "Protective stop releasing"
    desk.run(1.0)
    np.testing.assert_array_equal(desk.joints, stands)


def test_play_after_a_protective_stop_goes_on_with_the_old_move() -> None:
    desk = Desk(unlock_delay_s=0.0)
    dashboard = Dashboard(desk.robot)
    desk.finish(MOVE_J, *TARGET, 1.0, 5.0, flag=1)
    desk.run(0.4)
    desk.robot.safety.protective_stop()
    desk.run(1.0)
    dashboard.reply("unlock protective stop")
    assert dashboard.reply("play") == "Starting program"
    desk.run(2.0)
    np.testing.assert_array_equal(desk.joints, TARGET)


def test_a_new_upload_after_a_protective_stop_forgets_the_old_move() -> None:
    desk = Desk(unlock_delay_s=0.0)
    desk.finish(MOVE_J, *TARGET, 1.0, 5.0, flag=1)
    desk.run(0.4)
    desk.robot.safety.protective_stop()
    desk.run(1.0)
    stands = desk.joints.copy()
    Dashboard(desk.robot).reply("unlock protective stop")
    desk.upload()
    desk.run(1.0)
    assert desk.robot.state == RuntimeState.PLAYING
    np.testing.assert_array_equal(desk.joints, stands)


def test_an_upload_while_it_is_locked_is_ignored() -> None:
    desk = Desk()
    desk.robot.safety.protective_stop("stop")
    desk.upload()
    assert desk.robot.state == RuntimeState.STOPPED


def test_an_emergency_stop_brakes_before_the_power_goes() -> None:
    desk = Desk()
    desk.finish(MOVE_J, *TARGET, 1.0, 5.0, flag=1)
    desk.run(0.4)
    desk.robot.safety.emergency_stop()
    desk.run(0.1)
    assert desk.robot.safety.power == RobotMode.RUNNING
    assert not desk.robot.arm.standing
    desk.run(0.15)
    assert desk.robot.safety.power == RobotMode.POWER_OFF
    assert Dashboard(desk.robot).reply("power on") == "Powering on"
    desk.run(2.0)
    assert desk.robot.safety.power == RobotMode.POWER_OFF


def test_an_emergency_stop_that_is_released_at_once_still_takes_the_power() -> None:
    desk = Desk()
    desk.finish(MOVE_J, *TARGET, 1.0, 5.0, flag=1)
    desk.run(0.4)
    desk.robot.safety.emergency_stop()
    desk.run(0.05)
    desk.robot.safety.release()
    assert not desk.robot.arm.standing
    desk.run(0.3)
    assert desk.robot.arm.standing
    assert desk.robot.safety.power == RobotMode.POWER_OFF
    assert not desk.robot.arm.held


@pytest.mark.parametrize(
    ("command", "values"),
    [
        (MOVE_J, (*TARGET, 0.0, 1.0)),
        (MOVE_J, (7.0, *HOME[1:], 1.0, 1.0)),
        (MOVE_L, (3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.1, 0.1)),
        (STOP_J, (0.0,)),
        (99, ()),
    ],
)
def test_what_cannot_be_done_ends_the_program(
    command: int, values: tuple[float, ...]
) -> None:
    desk = Desk()
    desk.ask(command, *values)
    desk.run(0.1)
    assert desk.robot.state == RuntimeState.STOPPED
    assert "run-time error" in desk.robot.endings[-1]
    np.testing.assert_array_equal(desk.joints, HOME)


def test_the_watchdog_wants_the_first_input_written() -> None:
    desk = Desk()
    desk.finish(WATCHDOG, 10.0)
    for _ in range(10):
        desk.ask(0)
        desk.run(0.09)
    assert desk.robot.state == RuntimeState.PLAYING
    desk.run(0.12)
    assert desk.robot.state == RuntimeState.STOPPED


def test_a_stream_beyond_a_limit_is_a_protective_stop() -> None:
    desk = Desk(joints_rad=(0.0, -1.57, 3.1, -1.57, -1.57, 0.0))
    desk.ask(9, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 10.0, 0.0)
    desk.run(1.0)
    assert desk.robot.safety.mode == SafetyMode.PROTECTIVE_STOP
    assert desk.robot.arm.standing
    assert 3.14 < desk.joints[2] < 3.4


def test_local_mode_refuses_programs_and_orders_but_answers_questions() -> None:
    desk = Desk(remote=False)
    dashboard = Dashboard(desk.robot)
    assert desk.robot.state == RuntimeState.STOPPED
    assert "Remote Control mode" in dashboard.reply("power off")
    assert dashboard.reply("robotmode") == "Robotmode: RUNNING"
    assert dashboard.reply("is in remote control") == "false"
    desk.robot.remote = True
    assert "reconnect" in dashboard.reply("stop")
    assert Dashboard(desk.robot).reply("stop") == "Stopped"


def test_an_old_generation_knows_no_remote_mode() -> None:
    desk = Desk(remote=False, profile="3.15")
    assert desk.robot.state == RuntimeState.PLAYING
    assert "could not understand" in Dashboard(desk.robot).reply("is in remote control")


def test_a_closed_light_curtain_lets_the_move_go_on() -> None:
    desk = Desk()
    desk.ask(MOVE_J, *TARGET, 1.0, 5.0)
    desk.run(0.4)
    desk.robot.safety.safeguard_stop()
    desk.run(1.0)
    assert desk.robot.state == RuntimeState.PAUSED
    assert desk.robot.arm.standing
    desk.robot.safety.release()
    desk.run(2.0)
    assert desk.answer == DONE
