"""The VISCA driver by its bytes, and against the simulated camera and its clones."""

from collections.abc import Callable
from functools import partial

import pytest

from mvp.errors import (
    ConnectError,
    DeviceError,
    DeviceFault,
    DeviceTimeout,
    MotionStopped,
    WireError,
)
from mvp.testing import FarEnd, meanwhile
from tests.wire.lens_makes import VISCA

VERSION = "90 50 00 20 04 66 01 07 02 FF"


class Camera:
    """As much of a camera as the tables need: motions take no time."""

    def __init__(self) -> None:
        self.places = {0x47: 0x1000, 0x48: 0x6000, 0x4B: 0x08}
        self.modes = {0x38: 0x02, 0x39: 0x00, 0x00: 0x02}
        self.instead: dict[str, list[str]] = {}
        self.after: dict[str, Callable[[], None]] = {}

    def __call__(self, sent: bytes) -> bytes:
        key = sent.hex(" ").upper()
        if self.instead.get(key):
            return bytes.fromhex(self.instead[key].pop(0))
        if key in self.after:
            self.after.pop(key)()
        return bytes.fromhex(self._answer(key, sent[1:-1]))

    def _answer(self, key: str, body: bytes) -> str:
        if key == "88 30 01 FF":
            return "88 30 02 FF"
        if key == "81 01 00 01 FF":
            return "90 50 FF"
        if body[:1] == b"\x09":
            return self._inquired(body)
        what, data = body[2], body[3:]
        if what in self.places:
            value = int("".join(f"{n:x}" for n in data), 16)
            self.places[what] = value
        elif what in self.modes:
            self.modes[what] = data[0]
        return "90 41 FF 90 51 FF"

    def _inquired(self, body: bytes) -> str:
        if body == b"\x09\x00\x02":
            return VERSION
        what = body[2]
        if what in self.modes:
            return f"90 50 {self.modes[what]:02X} FF"
        return f"90 50 {nibbled(self.places[what])} FF"


def nibbled(value: int) -> str:
    return " ".join(f"0{digit}" for digit in f"{value:04X}")


@pytest.fixture
def camera() -> Camera:
    return Camera()


@pytest.fixture
def far_end(camera: Camera) -> FarEnd:
    return FarEnd("lens", camera)


lens_on = VISCA.over


def commands(far_end: FarEnd) -> list[str]:
    """What was sent, without inquiries."""
    return [s.hex(" ").upper() for s in far_end.sent if s[1] != 0x09]


ZOOM_512 = "81 01 04 47 00 02 00 00 FF"
STOPS = ["81 01 04 07 00 FF", "81 01 04 08 00 FF"]
CLEAR = "81 01 00 01 FF"


def test_opening_gives_addresses_empties_the_sockets_and_asks(far_end: FarEnd) -> None:
    with lens_on(far_end) as lens:
        info = lens.info()
    sent = [s.hex(" ").upper() for s in far_end.sent]
    assert sent[:3] == ["88 30 01 FF", "81 01 00 01 FF", "81 09 00 02 FF"]
    assert info.model == "VISCA 0020:0466"
    assert info.firmware == "0107"


def test_homing_takes_manual_control(far_end: FarEnd, camera: Camera) -> None:
    with lens_on(far_end) as lens:
        del far_end.sent[:]
        state = lens.home(timeout_s=60)
        assert commands(far_end) == [
            "81 01 00 01 FF",
            "81 01 04 19 01 FF",
            "81 01 04 38 03 FF",
            "81 01 04 39 03 FF",
        ]
    assert state.homed
    assert not state.position_is_estimated
    assert state.steps() == {"zoom": 0x1000, "focus": 0x6000, "iris": 0x08}


def test_a_camera_on_standby_is_switched_on(far_end: FarEnd, camera: Camera) -> None:
    camera.modes[0x00] = 0x03
    with lens_on(far_end) as lens:
        assert lens.home(timeout_s=60).homed
    assert "81 01 04 00 02 FF" in commands(far_end)


def test_a_move_sends_nibbles_and_comes_from_the_side_of_the_table(
    far_end: FarEnd,
) -> None:
    """Run-up of 34 counts: zoom 0x200 from 0x222, focus 0x5000 from 0x4FDE."""
    with lens_on(far_end) as lens:
        lens.home(timeout_s=60)
        lens.move_steps(zoom=0x100, focus=0x7000, iris=5, timeout_s=60)
        del far_end.sent[:]
        state = lens.move_steps(zoom=0x200, focus=0x5000, iris=5, timeout_s=60)
        assert commands(far_end) == [
            "81 01 04 47 00 02 02 02 FF",
            "81 01 04 48 04 0F 0D 0E FF",
            ZOOM_512,
            "81 01 04 48 05 00 00 00 FF",
        ]
    assert state.steps() == {"zoom": 0x200, "focus": 0x5000, "iris": 5}


def test_a_busy_camera_is_asked_again(far_end: FarEnd, camera: Camera) -> None:
    with lens_on(far_end) as lens:
        lens.home(timeout_s=60)
        camera.instead = {ZOOM_512: ["90 60 03 FF", "90 60 03 FF"]}
        assert lens.move_steps(zoom=0x200, focus=0x7000, iris=5, timeout_s=60)
    assert commands(far_end).count(ZOOM_512) == 3


def test_auto_focus_that_came_back_is_switched_off_and_the_move_repeated(
    far_end: FarEnd, camera: Camera
) -> None:
    focus = "81 01 04 48 07 00 00 00 FF"

    def back_to_automatic() -> None:
        camera.modes[0x38] = 0x02

    with lens_on(far_end) as lens:
        lens.home(timeout_s=60)
        camera.after = {ZOOM_512: back_to_automatic}
        camera.instead = {focus: ["90 61 41 FF"]}
        lens.move_steps(zoom=0x200, focus=0x7000, iris=5, timeout_s=60)
        sent = commands(far_end)
    at = sent.index(focus)
    assert sent[at : at + 3] == [focus, "81 01 04 38 03 FF", focus]


@pytest.mark.parametrize(
    ("answer", "word"),
    [
        ("90 60 02 FF", "does not know"),
        ("90 60 01 FF", "length"),
        ("90 61 77 FF", "77"),
    ],
)
def test_a_refusal_is_a_fault_with_its_code_and_everything_is_stopped(
    far_end: FarEnd, camera: Camera, answer: str, word: str
) -> None:
    with lens_on(far_end) as lens:
        lens.home(timeout_s=60)
        del far_end.sent[:]
        camera.instead = {ZOOM_512: [answer]}
        with pytest.raises(DeviceFault, match=word) as caught:
            lens.move_steps(zoom=0x200, focus=0x7000, iris=5, timeout_s=60)
        assert caught.value.code == answer.split()[2].lower()
        assert commands(far_end) == [ZOOM_512, *STOPS, CLEAR]


def test_an_acknowledged_command_that_fails_later_is_a_fault(
    far_end: FarEnd, camera: Camera
) -> None:
    with lens_on(far_end) as lens:
        lens.home(timeout_s=60)
        camera.instead = {ZOOM_512: ["90 42 FF 90 62 41 FF"]}
        with pytest.raises(DeviceFault, match="cannot do that now"):
            lens.move_steps(zoom=0x200, focus=0x7000, iris=5, timeout_s=60)


def test_completion_alone_is_not_arrival(far_end: FarEnd, camera: Camera) -> None:
    """The camera says that it is done and stands somewhere else."""
    with lens_on(far_end) as lens:
        lens.home(timeout_s=60)
        camera.instead = {ZOOM_512: ["90 41 FF 90 51 FF"]}
        with pytest.raises(DeviceFault, match="zoom stands at 4096 instead of 512"):
            lens.move_steps(zoom=0x200, focus=0x7000, iris=5, timeout_s=60)


def test_a_completion_that_is_lost_costs_time_only(
    far_end: FarEnd, camera: Camera
) -> None:
    def without_completion(sent: bytes) -> bytes:
        said = camera(sent)
        return said[:3] if sent == bytes.fromhex(ZOOM_512) else said

    with lens_on(far_end) as lens:
        lens.home(timeout_s=60)
        far_end.answer = without_completion
        state = lens.move_steps(zoom=0x200, focus=0x7000, iris=5, timeout_s=60)
    assert state.zoom == 0x200


def test_completions_of_unknown_sockets_are_ignored(
    far_end: FarEnd, camera: Camera
) -> None:
    with lens_on(far_end) as lens:
        lens.home(timeout_s=60)
        far_end.say(bytes.fromhex("90 52 FF A0 51 FF 90 62 04 FF 00 FF FF"))
        assert lens.move_steps(zoom=0x200, focus=0x7000, iris=5, timeout_s=60).homed


def test_a_position_with_impossible_nibbles_is_asked_for_again(
    far_end: FarEnd, camera: Camera
) -> None:
    with lens_on(far_end) as lens:
        camera.instead = {"81 09 04 47 FF": ["90 50 01 10 00 00 FF"]}
        assert lens.state().zoom == 0x1000
        camera.instead = {"81 09 04 47 FF": ["90 50 01 10 00 00 FF"] * 3}
        with pytest.raises(WireError, match="90 50 01 10"):
            lens.state()


def test_a_missing_device_number_is_refused(far_end: FarEnd) -> None:
    with pytest.raises(ConnectError, match="1 devices, number 2"):
        lens_on(far_end, address=2).open()


def test_being_switched_on_costs_home(far_end: FarEnd) -> None:
    with lens_on(far_end) as lens:
        lens.home(timeout_s=60)
        far_end.say(b"\x90\x38\xff")
        end = 1000
        while lens.state().homed:
            end -= 1
            assert end


def test_a_device_that_knows_no_version_is_taken(
    far_end: FarEnd, camera: Camera
) -> None:
    camera.instead = {"81 09 00 02 FF": ["90 60 02 FF"]}
    with lens_on(far_end) as lens:
        assert lens.info().model == "VISCA, version not told"


def test_a_device_without_lens_initialisation_is_homed_all_the_same(
    far_end: FarEnd, camera: Camera
) -> None:
    camera.instead = {"81 01 04 19 01 FF": ["90 60 02 FF"]}
    with lens_on(far_end) as lens:
        assert lens.home(timeout_s=60).homed


@pytest.fixture
def bench(lens_bench) -> Callable[..., object]:
    """A simulator and a lens on it; keys are those of the simulator."""
    return partial(lens_bench, VISCA)


TARGET = {"zoom": 0x2000, "focus": 0x9000, "iris": 3}
CLONES = {
    "no acknowledgment": ({"no_ack": True}, {"acknowledges": False, "answer_s": 0.3}),
    "completes at once": ({"completes_at_once": True}, {}),
    "back to automatic": ({"auto_focus_after_zoom": True}, {}),
    "ignores the unknown": ({"ignores_unknown": True}, {}),
    "number 3": ({"address": 3}, {"address": 3}),
    "none of it": (
        {"no_ack": True, "completes_at_once": True, "ignores_unknown": True},
        {"acknowledges": False, "answer_s": 0.3},
    ),
}


@pytest.mark.parametrize("clone", CLONES)
def test_clones_arrive_where_they_are_sent(bench, clone: str) -> None:
    simulator, driver = CLONES[clone]
    b = bench(**simulator)
    lens = b.lens(**driver)
    lens.home(timeout_s=60)
    assert lens.move_steps(**TARGET, timeout_s=60).steps() == TARGET
    assert b.places() == pytest.approx(TARGET)


def test_a_late_answer_is_not_taken_for_the_next_one(bench) -> None:
    """A late zoom position has the shape of a focus position."""
    b = bench()
    lens = b.lens(answer_s=0.6)
    b.do("hold_next", seconds=0.9)
    assert lens.state().steps() == {"zoom": 0x1000, "focus": 0x6000, "iris": 0x08}


def test_an_axis_that_sticks_is_a_fault_where_it_stands(bench) -> None:
    b = bench()
    lens = b.lens()
    lens.home(timeout_s=60)
    b.do("stall", axis="focus")
    with pytest.raises(DeviceFault, match="focus stands at") as caught:
        lens.move_steps(**TARGET, timeout_s=60)
    assert caught.value.code == "stall"


def test_an_axis_that_sticks_before_the_deadline_is_stopped_by_it(bench) -> None:
    b = bench(speed_scale=0.5)
    lens = b.lens()
    lens.home(timeout_s=60)
    with pytest.raises(DeviceTimeout, match="stopped"):
        lens.move_steps(**TARGET, timeout_s=0.4)
    place = b.places()["zoom"]
    assert lens.state().standing
    assert b.places()["zoom"] == place
    assert place != TARGET["zoom"]


def test_a_stop_in_motion_stands_at_once(bench) -> None:
    b = bench(speed_scale=1)
    lens = b.lens()
    lens.home(timeout_s=60)
    result = meanwhile(
        lambda: lens.move_steps(**TARGET, timeout_s=60),
        lambda: not lens.state().standing and b.places()["zoom"] > 0x1000,
        lens.stop,
    )
    assert isinstance(result, MotionStopped)
    place = b.places()["zoom"]
    assert lens.state().zoom == round(place)
    assert place < TARGET["zoom"]


def test_power_lost_in_motion_is_a_device_error_and_costs_home(bench) -> None:
    b = bench(speed_scale=1)
    lens = b.lens(answer_s=0.4)
    lens.home(timeout_s=60)
    result = b.amid_a_move(lens, TARGET, lambda: b.do("power_cycle"))
    assert isinstance(result, DeviceError)
    assert not lens.state().homed
