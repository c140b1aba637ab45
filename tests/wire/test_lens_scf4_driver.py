"""The SCF4 driver by its bytes, and against the simulated controller on a bad line."""

import re
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from drivers.lens_scf4 import Scf4Lens
from mvp.devices import DeviceContext, ReplayTransport
from mvp.errors import (
    CalibrationError,
    ConfigError,
    ConnectError,
    DeviceError,
    DeviceFault,
    DeviceTimeout,
    LimitError,
    MotionStopped,
    WireError,
)
from mvp.testing import FarEnd, meanwhile
from tests.wire.lens_makes import SCF4

IDENTITY = b"EVB.1.0.2, SCF4-M RevB, Kurokesu, 5DDFF39-3739584E-00000001\r\n"


class Board:
    """As much of a controller as the tables need: moves take no time."""

    def __init__(self) -> None:
        self.steps = {"A": 24000, "B": 30000, "C": 900}
        self.sensor = {"A": False, "B": False, "C": False}
        self.forced: set[str] = set()
        self.relative = False
        self.instead: dict[bytes, bytes] = {}

    def __call__(self, sent: bytes) -> bytes:
        if sent in self.instead:
            return self.instead.pop(sent)
        line = sent.decode().strip()
        if line == "$S":
            return IDENTITY
        if line == "!1":
            fields = [*self.steps.values(), *map(int, self.sensor.values()), 0, 0, 0]
            return ", ".join(map(str, fields)).encode() + b"\r\n"
        self._do(line)
        return b"OK\r\n"

    def _do(self, line: str) -> None:
        head, _, rest = line.partition(" ")
        words = [(w[0], int(w[1:])) for w in rest.split() if len(w) > 1]
        if head in ("G90", "G91"):
            self.relative = head == "G91"
        elif head == "M231":
            self.forced.add(rest)
        elif head == "M230":
            self.forced.discard(rest)
        elif head == "G92":
            self.steps.update(words)
        elif head == "G0":
            for letter, value in words:
                if letter in self.forced:
                    self.sensor[letter] = value > 0
                elif self.relative:
                    self.steps[letter] = (self.steps[letter] + value) % 65536
                    self.sensor[letter] = False
                else:
                    self.steps[letter] = value


@pytest.fixture
def board() -> Board:
    return Board()


@pytest.fixture
def far_end(board: Board) -> FarEnd:
    return FarEnd("lens", board)


lens_on = partial(SCF4.over, settle_s=0)


def orders(far_end: FarEnd) -> list[str]:
    """What was sent, without questions."""
    return [s.decode().strip() for s in far_end.sent if s not in (b"!1\n", b"$S\n")]


HOMING = [
    "$B2", "M234 A190 B190 C190", "M235 A120 B120 C120",
    "M232 A400 B400 C400 E700 F700 G700", "M240 A600 B600 C600", "M243 C6",
    "M238", "M230 A", "M230 B", "M230 C", "G91",
    "M231 A", "G0 A+100", "M230 A", "G0 A-200", "M231 A", "G0 A+100",
    "G92 A32000", "M230 A",
    "M231 B", "G0 B+100", "M230 B", "G0 B-200", "M231 B", "G0 B+100",
    "G92 B36000", "M230 B",
    "M234 C60", "G0 C-2668", "M234 C190", "G92 C0", "M230 C",
    "M239", "G90",
]  # fmt: skip


def test_opening_asks_and_sends_nothing_else(far_end: FarEnd) -> None:
    with lens_on(far_end) as lens:
        info = lens.info()
    assert far_end.sent[:2] == [b"$S\n", b"!1\n"]
    assert orders(far_end) == ["M0"]  # on closing
    assert info.firmware == "EVB.1.0.2"
    assert info.model == "Kurokesu SCF4-M RevB"
    assert info.serial == "5DDFF39-3739584E-00000001"


def test_homing_sends_the_vendors_recipe(far_end: FarEnd) -> None:
    with lens_on(far_end) as lens:
        state = lens.home(timeout_s=60)
        assert orders(far_end) == HOMING
    assert state.homed
    assert state.steps() == {"zoom": 32000, "focus": 36000, "iris": 0}


def test_a_motor_that_starts_on_its_sensor_leaves_it_first(
    far_end: FarEnd, board: Board
) -> None:
    board.sensor["A"] = True
    with lens_on(far_end) as lens:
        lens.home(timeout_s=60)
    sent = orders(far_end)
    at = sent.index("M231 A")
    assert sent[at : at + 2] == ["M231 A", "G0 A-100"]


def test_a_target_on_the_wrong_side_gets_a_run_up(far_end: FarEnd) -> None:
    """Zoom comes from above, 94 steps too far; focus comes from its side at once."""
    with lens_on(far_end) as lens:
        lens.home(timeout_s=60)
        del far_end.sent[:]
        lens.move_steps(zoom=20000, focus=30000, iris=1000, timeout_s=60)
        assert orders(far_end) == [
            "G90", "G0 A19906 B30000 C1000", "G90", "G0 A20000",
        ]  # fmt: skip
        del far_end.sent[:]
        lens.move_steps(zoom=20000, focus=30001, iris=1000, timeout_s=60)
        assert orders(far_end) == ["G90", "G0 B30001"]


@pytest.mark.parametrize("answer", [b"ERROR\r\n", b"1,2,3\r\n", b"OKOK\r\n", b"\xff\n"])
def test_anything_but_ok_is_a_fault_and_the_last_word(
    far_end: FarEnd, board: Board, answer: bytes
) -> None:
    with lens_on(far_end) as lens:
        lens.home(timeout_s=60)
        del far_end.sent[:]
        board.instead = {b"G0 A19906 B30000 C1000\n": answer}
        with pytest.raises(DeviceFault) as caught:
            lens.move_steps(zoom=20000, focus=30000, iris=1000, timeout_s=60)
        assert orders(far_end) == ["G90", "G0 A19906 B30000 C1000", "M0"]
        assert "answers" in caught.value.message


def test_a_disturbed_status_is_asked_for_again(far_end: FarEnd, board: Board) -> None:
    with lens_on(far_end) as lens:
        board.instead = {b"!1\n": b"24000, 30000, 9x0, 0, 0, 0, 0, 0, 0\r\n"}
        assert lens.state().zoom == 24000


def test_a_status_that_is_always_disturbed_is_an_error(far_end: FarEnd) -> None:
    with lens_on(far_end) as lens:
        far_end.answer = lambda sent: IDENTITY if sent == b"$S\n" else b"1,2\r\n"
        with pytest.raises(WireError, match="nine whole numbers"):
            lens.state()


def test_counters_that_went_back_to_zero_mean_that_home_is_lost(
    far_end: FarEnd, board: Board
) -> None:
    with lens_on(far_end) as lens:
        lens.home(timeout_s=60)
        assert lens.state().homed
        board.steps = dict.fromkeys("ABC", 0)
        assert not lens.state().homed
        with pytest.raises(LimitError, match="not homed"):
            lens.move_steps(zoom=20000, focus=30000, iris=1000, timeout_s=60)


def test_a_garbled_order_is_found_out_by_reading_back(
    far_end: FarEnd, board: Board
) -> None:
    """The line loses a digit; the controller says OK to something else."""
    with lens_on(far_end) as lens:
        lens.home(timeout_s=60)
        far_end.answer = lambda sent: board(sent.replace(b"A19906", b"A1990"))
        with pytest.raises(DeviceFault, match="1990"):
            lens.move_steps(zoom=20000, focus=30000, iris=1000, timeout_s=60)
        assert not lens.state().homed


def test_another_device_on_the_port_is_refused() -> None:
    grbl = FarEnd("lens", lambda sent: b"error:20\r\n")
    with pytest.raises(ConnectError, match="no SCF4"):
        lens_on(grbl).open()
    assert set(grbl.sent) == {b"$S\n"}


def test_a_range_without_room_for_the_run_up_is_refused(far_end: FarEnd) -> None:
    iris = {"low": 0, "high": 2200, "backlash_steps": 20}
    with pytest.raises(ConfigError, match="-34"):
        lens_on(far_end, iris=iris).open()


def test_a_lens_without_ranges_says_how_to_give_them(far_end: FarEnd) -> None:
    with pytest.raises(ConfigError, match="iris") as caught:
        lens_on(far_end, iris=None).open()
    assert "lens_table" in caught.value.hint


def test_ranges_come_from_the_lens_table_unless_they_are_given(far_end: FarEnd) -> None:
    table = Path("cell_configs/virtual/calibration/lens_table.json")
    root = Path(__file__).parents[2]
    lens = lens_on(
        far_end, zoom=None, iris=None, focus=None, lens_table=str(root / table)
    )
    with pytest.raises(ConfigError, match=r"zoom would move within -49 \.\. 3200"):
        lens.limits()
    zoom, iris = {"low": 100, "high": 3000}, {"low": 100, "high": 900}
    focus = {"low": 200, "high": 300}
    given = lens_on(far_end, zoom=zoom, iris=iris, focus=focus, lens_table="none.json")
    assert given.limits()["focus"] == (200, 300)


def test_a_motor_of_one_step_is_not_run_against_its_end(far_end: FarEnd) -> None:
    with lens_on(far_end, iris={"low": 900, "high": 900}) as lens:
        assert lens.limits()["iris"] == (900, 900)
        before = len(far_end.sent)
        with pytest.raises(ConfigError, match="one step 900"):
            lens.home(timeout_s=60)
        assert not any(line.startswith(b"G0") for line in far_end.sent[before:])


@pytest.mark.parametrize("content", ["", "{}", "[1]"])
def test_what_is_no_lens_table_is_refused(
    far_end: FarEnd, tmp_path: Path, content: str
) -> None:
    path = tmp_path / "table.json"
    path.write_text(content)
    with pytest.raises(CalibrationError, match="no lens table"):
        lens_on(far_end, zoom=None, lens_table=str(path)).open()


def test_two_motors_on_one_output_are_refused() -> None:
    with pytest.raises(ValueError, match="same letter"):
        Scf4Lens.Config.model_validate({"port": "x", "zoom_motor": {"letter": "B"}})


def test_nothing_forbidden_is_ever_sent(far_end: FarEnd) -> None:
    with lens_on(far_end) as lens:
        lens.home(timeout_s=60)
        lens.move_steps(zoom=20000, focus=30000, iris=1000, timeout_s=60)
    forbidden = re.compile(r"\$B3|G4|M24[15-7]|M7|M8")
    assert not [line for line in orders(far_end) if forbidden.match(line)]


@pytest.fixture
def bench(lens_bench) -> Callable[..., object]:
    """A simulator and a lens on it; keys are those of the simulator."""
    return partial(lens_bench, SCF4)


@pytest.mark.parametrize(
    "start", [{"zoom": 17500, "focus": 28000}, {"zoom": 39000, "focus": 38900}]
)
def test_homing_finds_the_same_edge_from_both_sides(bench, start) -> None:
    """Counters begin at zero, so one of the two wraps below it on its way."""
    places = {
        "zoom": {"low": 17000, "high": 39500, "reference": 32000},
        "focus": {"low": 27500, "high": 39000, "reference": 36000},
    }
    b = bench(**{a: {**p, "start": start[a]} for a, p in places.items()})
    lens = b.lens()
    lens.home(timeout_s=60)
    assert b.places() == pytest.approx({"zoom": 32000, "focus": 36000, "iris": 0})
    lens.move_steps(zoom=20000, focus=37000, iris=1234, timeout_s=60)
    assert b.places() == pytest.approx({"zoom": 20000, "focus": 37000, "iris": 1234})


def test_a_late_answer_is_not_taken_for_the_next_one(bench) -> None:
    b = bench()
    lens = b.lens(answer_s=1.0)
    b.do("hold_next", seconds=1.5)
    assert lens.state().steps() == {"zoom": 0, "focus": 0, "iris": 0}
    assert lens.home(timeout_s=60).homed


def test_a_motor_that_never_finds_its_sensor_times_out_and_stands(bench) -> None:
    b = bench()
    lens = b.lens()
    b.do("stall", axis="zoom")
    with pytest.raises(DeviceTimeout):
        lens.home(timeout_s=1.0)
    state = lens.state()
    assert state.standing
    assert not state.homed


def test_a_controller_that_restarts_in_motion_is_a_fault(bench) -> None:
    b = bench(speed_scale=4)
    lens = b.lens()
    b.do("turn", axis="zoom", steps=8100)  # close to its edge
    b.do("turn", axis="focus", steps=6100)
    lens.home(timeout_s=60)
    target = {"zoom": 20000, "focus": 36000, "iris": 1000}
    result = b.amid_a_move(lens, target, lambda: b.do("power_cycle"))
    assert isinstance(result, DeviceError)
    assert not lens.state().homed


def test_a_stop_keeps_the_counters_right(bench) -> None:
    b = bench(speed_scale=5)
    lens = b.lens()
    lens.home(timeout_s=60)
    target = {"zoom": 18000, "focus": 30000, "iris": 1000}
    assert isinstance(b.amid_a_move(lens, target, lens.stop), MotionStopped)
    state = lens.state()
    assert state.homed
    assert b.places()["zoom"] == pytest.approx(state.zoom, abs=1)


def test_a_stop_while_homing_leaves_it_unhomed_and_usable(bench) -> None:
    b = bench(speed_scale=8)
    lens = b.lens()
    result = meanwhile(
        lambda: lens.home(timeout_s=60), lambda: not lens.state().standing, lens.stop
    )
    assert isinstance(result, MotionStopped)
    assert not lens.state().homed
    assert lens.home(timeout_s=60).homed


def test_a_recorded_fault_plays_back(bench, tmp_path: Path) -> None:
    b = bench()
    lens = b.lens(DeviceContext(dump_folder=tmp_path), answer_s=0.2)
    lens.info()
    b.do("noise", silence=True)
    with pytest.raises(DeviceTimeout) as caught:
        lens.state()
    b.do("noise")
    dump = tmp_path / "lens-1.wire.jsonl"
    assert str(dump) in caught.value.hint
    config = Scf4Lens.Config.model_validate({**b.keys, "answer_s": 0.2})
    replay = ReplayTransport.load(dump)
    context = DeviceContext(transports=lambda config, name: replay)
    again = Scf4Lens.from_config(config, context, name="lens")
    again.open()
    assert again.info() == lens.info().__class__(
        **{**vars(lens.info()), "extra": again.info().extra}
    )
    again.close()


def test_no_thread_is_left(bench) -> None:
    lens = bench().lens()
    lens.close()
    time.sleep(0)
    assert not [t for t in threading.enumerate() if t.name == "lens-reader"]
