"""The Theia driver by its bytes, and against the simulated board on a bad line."""

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from drivers.lens_theia import TheiaLens
from mvp.errors import (
    ConfigError,
    ConnectError,
    DeviceFault,
    DeviceTimeout,
    LimitError,
    MotionStopped,
)
from mvp.testing import FarEnd, meanwhile
from tests.wire.lens_makes import THEIA

DONE = b"\x74\x00\x0d"
SETUPS = {
    1: "67 01 00 01 00 20 C6 00 64 05 DC 0D",
    2: "67 02 00 01 00 0C 9B 00 64 05 DC 0D",
    3: "67 03 00 00 00 00 4B 00 0A 00 C8 0D",
}


class Board:
    """As much of a board as the tables need: motions take no time."""

    def __init__(self) -> None:
        self.setups = {motor: bytes.fromhex(s) for motor, s in SETUPS.items()}
        self.instead: dict[bytes, bytes] = {}

    def __call__(self, sent: bytes) -> bytes:
        if sent in self.instead:
            return self.instead.pop(sent)
        match sent[0]:
            case 0x76:
                return bytes.fromhex("76 05 03 01 00 00 0D")
            case 0x79:
                return bytes.fromhex("79 05 50 00 00 12 34 0D")
            case 0x67:
                return self.setups[sent[1]]
            case 0x63:
                self.setups[sent[1]] = b"\x67" + sent[1:]
                return b"\x63\x00\x0d"
        return DONE


@pytest.fixture
def board() -> Board:
    return Board()


@pytest.fixture
def far_end(board: Board) -> FarEnd:
    return FarEnd("lens", board)


lens_on = THEIA.over


def motions(far_end: FarEnd) -> list[str]:
    return [s.hex(" ").upper() for s in far_end.sent if s[0] in (0x66, 0x62, 0x73)]


HOMING = [
    "73 02 00 00 01 04 B0 0D", "62 02 01 34 01 04 B0 0D", "73 02 00 00 01 04 B0 0D",
    "73 01 00 00 01 04 B0 0D", "62 01 02 77 01 04 B0 0D", "73 01 00 00 01 04 B0 0D",
    "66 03 00 4B 01 00 64 0D",
]  # fmt: skip


def test_opening_asks_for_firmware_and_serial_number(far_end: FarEnd) -> None:
    with lens_on(far_end) as lens:
        info = lens.info()
    assert [s.hex() for s in far_end.sent] == ["760d", "790d"]
    assert info.firmware == "5.3.1.0.0"
    assert info.serial == "055-001234"
    assert info.extra["can_stop"].startswith("no")


def test_homing_goes_to_each_barrier_from_the_right_side(far_end: FarEnd) -> None:
    with lens_on(far_end) as lens:
        state = lens.home(timeout_s=60)
    assert motions(far_end) == HOMING
    assert state.homed
    assert state.position_is_estimated
    assert state.steps() == {"zoom": 3119, "focus": 7959, "iris": 0}


def test_a_set_up_that_is_right_is_not_written(far_end: FarEnd) -> None:
    with lens_on(far_end) as lens:
        lens.home(timeout_s=60)
    assert not [s for s in far_end.sent if s[0] in (0x63, 0x6B)]


def test_a_set_up_that_differs_is_written_once_and_read_back(
    far_end: FarEnd, board: Board
) -> None:
    board.setups[1] = bytes.fromhex("67 01 00 00 00 20 C6 00 64 05 DC 0D")
    with lens_on(far_end) as lens:
        lens.home(timeout_s=60)
        lens.home(timeout_s=60)
    writes = [s.hex(" ").upper() for s in far_end.sent if s[0] == 0x63]
    assert writes == ["63 01 00 01 00 20 C6 00 64 05 DC 0D"]


def test_a_set_up_that_must_not_be_written_is_a_fault(
    far_end: FarEnd, board: Board
) -> None:
    board.setups[1] = bytes.fromhex("67 01 00 00 00 20 C6 00 64 05 DC 0D")
    with lens_on(far_end, write_setup=False) as lens:
        with pytest.raises(DeviceFault, match="focus") as caught:
            lens.home(timeout_s=60)
    assert caught.value.code == "setup"
    assert motions(far_end) == []


def test_an_unknown_motor_is_a_fault(far_end: FarEnd, board: Board) -> None:
    board.setups[3] = b"\x67" + 10 * b"\xff" + b"\x0d"
    with lens_on(far_end) as lens, pytest.raises(DeviceFault, match="motor for iris"):
        lens.home(timeout_s=60)
    assert motions(far_end) == []


def test_the_vendors_example_of_taking_up_the_backlash(far_end: FarEnd) -> None:
    """500 steps towards the barrier are 560 there and 60 back."""
    with lens_on(far_end) as lens:
        lens.home(timeout_s=60)
        lens.move_steps(zoom=1000, focus=4000, iris=40, timeout_s=60)
        del far_end.sent[:]
        state = lens.move_steps(zoom=1000, focus=4500, iris=40, timeout_s=60)
    assert motions(far_end) == ["66 01 02 30 01 04 B0 0D", "62 01 00 3C 01 04 B0 0D"]
    assert state.focus == 4500


def test_a_motor_that_was_measured_at_one_step_stays_there(far_end: FarEnd) -> None:
    """As the table of a lens has it that was measured at one zoom."""
    with lens_on(far_end, zoom={"low": 1000, "high": 1000}) as lens:
        lens.home(timeout_s=60)
        state = lens.move_steps(zoom=1000, focus=4000, iris=40, timeout_s=60)
        assert (state.zoom, lens.limits()["zoom"]) == (1000, (1000, 1000))
        with pytest.raises(
            LimitError, match=r"zoom step 1001 is outside 1000 \.\. 1000"
        ):
            lens.check_steps(zoom=1001, focus=4000, iris=40)


def test_steps_that_look_like_line_ends_are_sent_as_they_are(far_end: FarEnd) -> None:
    """3338 is 0D 0A."""
    with lens_on(far_end) as lens:
        lens.home(timeout_s=60)
        del far_end.sent[:]
        lens.move_steps(zoom=3000, focus=7959 - 3338, iris=0, timeout_s=60)
    assert "62 01 0D 0A 01 04 B0 0D" in motions(far_end)


def test_opening_the_iris_is_minus_and_closing_is_plus(far_end: FarEnd) -> None:
    with lens_on(far_end) as lens:
        lens.home(timeout_s=60)
        lens.move_steps(zoom=1000, focus=4000, iris=40, timeout_s=60)
        lens.move_steps(zoom=1000, focus=4000, iris=30, timeout_s=60)
    iris = [m for m in motions(far_end) if m[3:5] == "03"]
    assert iris[1:] == ["62 03 00 28 01 00 64 0D", "66 03 00 0A 01 00 64 0D"]


def test_what_stands_where_it_should_is_not_moved_again(far_end: FarEnd) -> None:
    with lens_on(far_end) as lens:
        lens.home(timeout_s=60)
        lens.move_steps(zoom=1000, focus=4000, iris=40, timeout_s=60)
        del far_end.sent[:]
        lens.move_steps(zoom=1000, focus=4000, iris=40, timeout_s=60)
    assert far_end.sent == []


def test_what_cannot_end_in_time_is_not_begun(far_end: FarEnd) -> None:
    """4000 steps at 1200 per second take 3.3 s, and nothing can stop them."""
    with lens_on(far_end) as lens:
        lens.home(timeout_s=60)
        del far_end.sent[:]
        with pytest.raises(DeviceTimeout, match="nothing has moved"):
            lens.move_steps(zoom=3000, focus=3959, iris=0, timeout_s=3.0)
        assert far_end.sent == []
        assert lens.state().homed
        with pytest.raises(DeviceTimeout, match="nothing has moved"):
            lens.home(timeout_s=5.0)
        assert lens.state().homed


def test_a_motion_that_ended_badly_is_a_fault(far_end: FarEnd, board: Board) -> None:
    with lens_on(far_end) as lens:
        board.instead = {bytes.fromhex(HOMING[3]): b"\x74\x01\x0d"}
        with pytest.raises(DeviceFault) as caught:
            lens.home(timeout_s=60)
        assert caught.value.code == "74 01"
        assert not lens.state().homed
    assert motions(far_end) == HOMING[:4]


def test_an_answer_of_another_kind_is_not_the_answer(
    far_end: FarEnd, board: Board
) -> None:
    """A late firmware answer, then garbage, then the end of the motion."""
    with lens_on(far_end) as lens:
        first = bytes.fromhex(HOMING[0])
        board.instead = {first: b"\x76\x05\x03\x01\x00\x00\x0d\x00\xff\x74\x00\x0d"}
        assert lens.home(timeout_s=60).homed


def test_firmware_that_is_too_old_is_refused(far_end: FarEnd, board: Board) -> None:
    board.instead = {b"\x76\x0d": bytes.fromhex("76 04 00 00 00 00 0D")}
    with pytest.raises(ConnectError, match=r"4\.0\.0\.0\.0 is too old"):
        lens_on(far_end).open()


def test_a_range_beyond_the_barrier_is_refused(far_end: FarEnd) -> None:
    with pytest.raises(ConfigError, match=r"focus would move within 100 \.\. 8010"):
        lens_on(far_end, focus={**THEIA.keys["focus"], "high": 7950}).open()


def test_a_speed_outside_its_limits_is_refused() -> None:
    with pytest.raises(ValueError, match="speed is outside"):
        TheiaLens.Config.model_validate(
            {"port": "x", "zoom_motor": {"steps": 100, "speed": 2000}}
        )


@pytest.fixture
def bench(lens_bench) -> Callable[..., object]:
    """A simulator and a lens on it; keys are those of the simulator."""
    return partial(lens_bench, THEIA)


@pytest.mark.parametrize("focus", [0, 5000, 8100, 8390])
def test_homing_finds_the_barrier_from_anywhere(bench, focus: float) -> None:
    travel = {"low": 0, "high": 8390, "start": focus, "reference": 7959}
    b = bench(focus=travel)
    lens = b.lens()
    lens.home(timeout_s=60)
    assert b.places() == pytest.approx({"zoom": 3119, "focus": 7959, "iris": 0})


def test_the_count_follows_the_motors(bench) -> None:
    b = bench()
    lens = b.lens()
    lens.home(timeout_s=60)
    rng = np.random.default_rng(3)
    for _ in range(5):
        target = {
            axis: int(rng.integers(low, high + 1))
            for axis, (low, high) in lens.limits().items()
        }
        assert lens.move_steps(**target, timeout_s=60).steps() == target
        assert b.places() == pytest.approx(target)


def test_a_late_answer_is_not_taken_for_that_of_the_next_motion(bench) -> None:
    b = bench()
    lens = b.lens()
    lens.home(timeout_s=60)
    b.do("hold_next", seconds=1.5)
    with pytest.raises(DeviceTimeout, match="no answer") as caught:
        lens.move_steps(zoom=2900, focus=7800, iris=0, timeout_s=60)
    assert "home" in caught.value.hint
    state = lens.state()
    assert not state.homed
    assert not state.standing
    with pytest.raises(LimitError, match="not homed"):
        lens.move_steps(zoom=1000, focus=4000, iris=40, timeout_s=60)
    lens.home(timeout_s=60)
    target = {"zoom": 1000, "focus": 4000, "iris": 40}
    lens.move_steps(**target, timeout_s=60)
    assert b.places() == pytest.approx(target)


def test_a_stop_lets_the_motion_end_and_sends_no_other(bench) -> None:
    b = bench(speed_scale=4)
    lens = b.lens()
    lens.home(timeout_s=60)
    target = {"zoom": 2500, "focus": 3000, "iris": 75}
    assert isinstance(b.amid_a_move(lens, target, lens.stop), MotionStopped)
    state = lens.state()
    assert state.standing
    assert state.homed
    assert b.places() == pytest.approx(state.steps())
    assert state.steps() == {"zoom": 2440, "focus": 7959, "iris": 0}


def test_power_lost_in_motion_is_a_time_out(bench) -> None:
    b = bench(speed_scale=1)
    b.do("turn", axis="zoom", steps=2300)
    b.do("turn", axis="focus", steps=5900)
    lens = b.lens(answer_s=1.5)
    result = meanwhile(
        lambda: lens.home(timeout_s=60),
        lambda: not lens.state().standing,
        lambda: b.do("power_cycle"),
    )
    assert isinstance(result, DeviceTimeout)
    assert not lens.state().homed


def test_a_motor_that_turns_by_hand_is_put_right_by_homing(bench) -> None:
    b = bench()
    lens = b.lens()
    lens.home(timeout_s=60)
    lens.move_steps(zoom=1000, focus=4000, iris=40, timeout_s=60)
    b.do("turn", axis="focus", steps=-77)
    lens.home(timeout_s=60)
    assert b.places()["focus"] == pytest.approx(7959)
