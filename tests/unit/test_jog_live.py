"""Live while jogging: the position beside the motion, the picture beside the person."""

from __future__ import annotations

import signal
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import cv2
import numpy as np
import pytest

from mvp.cell.beside import call_beside
from mvp.cell.jog_camera import JogCamera
from mvp.cell.jog_job import Jogger
from mvp.cell.jog_lens import JogLens
from mvp.cell.live_picture import LivePicture
from mvp.cell.live_position import LivePosition
from mvp.cli.jog import _without_live
from mvp.cli.main import invoke
from mvp.devices import Frame, RealClock
from mvp.errors import (
    DeviceTimeout,
    LinkLost,
    MotionStopped,
    OutputError,
    UsageError,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from mvp.cell.engine import CellDevices
    from mvp.cell.plan_job import Setting

SOON_S = 20.0


def until(holds: Callable[[], bool]) -> None:
    """Wait for another thread."""
    never = threading.Event()
    for _ in range(round(SOON_S / 0.005)):
        if holds():
            return
        never.wait(0.005)
    pytest.fail("it did not come to pass")


class Ticks:
    """A clock that runs as it is waited for, and ends a thread after so many waits."""

    def __init__(self, waits: int) -> None:
        self.left, self.time_s = waits, 0.0

    def now_s(self) -> float:
        return self.time_s

    def wait(self, event: threading.Event, seconds: float) -> bool:
        if not self.left:
            event.set()
        self.left -= 1
        self.time_s += seconds
        return event.is_set()


def a_frame(number: int = 0, start_s: float = 0.0) -> Frame:
    pixels = np.full((30, 40), number % 256, np.uint8)
    return Frame(pixels, 255, start_s, 0.01, start_s, number)


class Camera:
    """Counts its pictures, refuses two users, fails when told to."""

    def __init__(self) -> None:
        self.name = "camera"
        self.count, self.users, self.clashes = 0, 0, 0
        self.configured_s: list[float] = []
        self.fails: Exception | None = None
        self.blocks = False
        self.stopped = threading.Event()

    def exposure_range_s(self) -> tuple[float, float]:
        return 0.001, 0.5

    def configure(self, *, exposure_s: float, gain: float = 1.0) -> None:
        self.configured_s.append(exposure_s)

    def capture(self, *, not_before_s: float, timeout_s: float) -> Frame:
        self.users += 1
        self.clashes += self.users > 1
        try:
            threading.Event().wait(0.002)
            if self.fails is not None:
                raise self.fails
            if self.blocks and self.stopped.wait(SOON_S):
                raise MotionStopped("stopped", device="camera")
            self.count += 1
            return a_frame(self.count, not_before_s)
        finally:
            self.users -= 1

    def stop(self) -> None:
        self.stopped.set()


def jog_camera(camera: Camera) -> JogCamera:
    devices = SimpleNamespace(camera=camera, clock=RealClock())
    return JogCamera(cast("CellDevices", devices))


def a_live(camera: Camera, saved: list[int] | None = None) -> LivePicture:
    taker = jog_camera(camera)
    kept = saved if saved is not None else []
    return LivePicture(
        taker.picture,
        lambda path, frame: kept.append(frame.frame_id),
        lambda: "here",
        taker.stop,
        every_s=0.001,
    )


# ------------------------------------------------------------------ position


def test_the_position_is_asked_for_until_the_motion_has_ended() -> None:
    said = iter(["", "at 1", "at 2", "at 3"])
    seen: list[str] = []

    def ask() -> str:
        seen.append(position.text)
        return next(said)

    position = LivePosition(ask, Ticks(4), every_s=0.5)
    with position:
        until(lambda: position.text == "1.5 s: at 3")
    assert seen == ["", "", "0.5 s: at 1", "1.0 s: at 2"]


def test_a_device_that_cannot_be_asked_now_is_asked_again() -> None:
    answers: list[str | Exception] = [DeviceTimeout("homing", device="arm"), "at 2"]
    seen: list[str] = []

    def ask() -> str:
        seen.append(position.text)
        answer = answers.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return answer

    position = LivePosition(ask, Ticks(2), every_s=0.25)
    with position:
        until(lambda: position.text == "0.5 s: at 2")
    assert seen[1] == "0.2 s: cannot be asked where it is now: homing"


def test_an_answer_that_does_not_come_keeps_nobody_from_stopping() -> None:
    asked, answer, stopped = (threading.Event() for _ in range(3))
    stops: list[bool] = []

    def ask() -> str:
        asked.set()
        answer.wait(SOON_S)
        return ""

    def move() -> None:
        asked.wait(SOON_S)
        stops.append(stopped.wait(SOON_S))
        answer.set()
        raise MotionStopped("stopped", device="arm")

    def press() -> None:
        if asked.is_set():
            raise KeyboardInterrupt

    with (
        pytest.raises(KeyboardInterrupt),
        LivePosition(ask, every_s=0.001),
    ):
        call_beside(move, stopped.set, press)
    assert stops == [True]


def test_an_error_does_not_wait_for_an_answer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked, answer = threading.Event(), threading.Event()
    waits: list[object] = []

    def ask() -> str:
        monkeypatch.setattr(threading.current_thread(), "join", waits.append)
        asked.set()
        answer.wait(SOON_S)
        return ""

    def fail() -> None:
        asked.wait(SOON_S)
        raise LinkLost("is gone", device="arm")

    try:
        with pytest.raises(LinkLost), LivePosition(ask, every_s=0.001):
            call_beside(fail, pytest.fail)
    finally:
        answer.set()
    assert waits == []


def test_each_command_asks_the_lens_once_and_a_late_answer_changes_no_other(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    hands = iter(["before", "now"])
    monkeypatch.setattr(JogLens, "tool_from_camera", lambda lens: next(hands))
    monkeypatch.setattr(Jogger, "_arm_words", lambda jogger, arm, hand: hand)
    devices = SimpleNamespace(
        arm=SimpleNamespace(state=lambda: None), camera=None, clock=RealClock()
    )
    jogger = Jogger(
        cast("Setting", None),
        cast("CellDevices", devices),
        lambda path, frame: None,
        lambda frame: None,
        0.5,
    )
    late, next_one = jogger.following(), jogger.following()
    assert next_one() == ""
    with jogger.under_way.moving("the arm", 1.0):
        assert [late(), next_one(), late(), next_one()] == [
            "before",
            "now",
            "before",
            "now",
        ]


def test_who_looks_is_called_in_the_callers_thread_while_it_moves() -> None:
    looks: list[threading.Thread] = []
    enough = threading.Event()

    def look() -> None:
        looks.append(threading.current_thread())
        if len(looks) == 3:
            enough.set()

    assert call_beside(lambda: enough.wait(SOON_S), pytest.fail, look) is True
    assert set(looks) == {threading.current_thread()}


def test_a_motion_that_nobody_watches_any_more_is_stopped() -> None:
    stopped = threading.Event()

    def look() -> None:
        raise RuntimeError("cannot draw")

    with pytest.raises(RuntimeError, match="cannot draw"):
        call_beside(lambda: stopped.wait(SOON_S), stopped.set, look)
    assert stopped.is_set()


# ------------------------------------------------------------------- picture


def test_a_file_is_kept_up_to_date_until_it_is_off() -> None:
    camera, saved = Camera(), []
    live = a_live(camera, saved)
    assert live.to_file(Path("a.png")).frame_id == 1
    until(lambda: len(saved) > 4)
    assert saved == sorted(set(saved))
    assert live.is_on
    assert live.end()
    count = camera.count
    threading.Event().wait(0.02)
    assert camera.count == count
    assert not live.is_on
    assert not live.end()
    assert live.failure() is None


def test_without_a_first_picture_it_is_not_on() -> None:
    camera = Camera()
    camera.fails = DeviceTimeout("no frame in time", device="camera")
    live = a_live(camera)
    with pytest.raises(DeviceTimeout):
        live.to_file(Path("a.png"))
    assert not live.is_on


def test_a_camera_that_fails_ends_it_and_no_motion_and_is_told_once() -> None:
    camera = Camera()
    live = a_live(camera)
    live.to_file(Path("a.png"))

    def move() -> str:
        camera.fails = LinkLost("is gone", device="camera", hint="check the cable")
        until(lambda: not live.is_on)
        return "arrived"

    assert call_beside(move, pytest.fail) == "arrived"
    failure = live.failure()
    assert failure is not None
    assert (failure.message, failure.hint) == ("camera: is gone", "check the cable")
    assert live.failure() is None


def test_a_file_that_cannot_be_written_any_more_ends_it() -> None:
    full: list[int] = []

    def save(path: Path, frame: Frame) -> None:
        full.append(1)
        if len(full) > 2:
            raise OutputError("no room")

    taker = jog_camera(Camera())
    live = LivePicture(taker.picture, save, lambda: "", taker.stop, every_s=0.001)
    live.to_file(Path("a.png"))
    until(lambda: not live.is_on)
    failure = live.failure()
    assert failure is not None
    assert failure.message == "no room"


def test_a_stop_of_all_devices_ends_a_picture_that_is_waited_for() -> None:
    camera = Camera()
    live = a_live(camera)
    live.to_file(Path("a.png"))
    camera.blocks = True
    until(lambda: camera.users == 1)
    camera.stop()
    until(lambda: not live.is_on)
    failure = live.failure()
    assert failure is not None
    assert "together with arm and lens" in failure.message


def test_ending_it_does_not_wait_for_a_picture() -> None:
    camera = Camera()
    live = a_live(camera)
    live.to_file(Path("a.png"))
    camera.blocks = True
    until(lambda: camera.users == 1)
    live.end()
    assert camera.users == 0
    assert live.failure() is None


def test_who_looks_sees_picture_and_place_and_leaves_a_file_going() -> None:
    camera = Camera()
    live = a_live(camera)
    with live.looked_at():
        until(lambda: live.newest is not None)
        assert live.newest is not None
        assert live.newest.where == "here"
    assert not live.is_on
    live.to_file(Path("a.png"))
    with live.looked_at():
        until(lambda: live.newest is not None)
    assert live.is_on
    live.end()


def test_a_camera_has_one_user_at_a_time_and_each_picture_is_new() -> None:
    camera = Camera()
    taker = jog_camera(camera)
    live = LivePicture(
        taker.picture,
        lambda path, frame: None,
        lambda: "",
        taker.stop,
        every_s=0.001,
    )
    live.to_file(Path("a.png"))
    shots = [taker.picture().frame_id for _ in range(20)]
    live.end()
    assert camera.clashes == 0
    assert shots == sorted(set(shots))


def test_an_exposure_holds_from_the_next_picture_on() -> None:
    camera = Camera()
    taker = jog_camera(camera)
    taker.picture()
    assert taker.expose(0.02) == "exposure 20 ms"
    taker.picture()
    assert camera.configured_s == [0.01, 0.02]
    with pytest.raises(UsageError, match="1 to 500 ms"):
        taker.expose(3.0)


def test_who_will_not_wait_for_the_last_picture_does_not_have_to() -> None:
    waited: list[bool] = []

    def end() -> None:
        waited.append(True)
        signal.raise_signal(signal.SIGINT)
        pytest.fail("it goes on waiting")

    live = SimpleNamespace(is_on=True, end=end)
    _without_live(cast("Jogger", SimpleNamespace(live=live)))
    assert waited


# ------------------------------------------------------------------- command


def test_a_script_keeps_a_live_file_and_sends_no_control_character(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    file = tmp_path / "live.png"
    words = [f"live {file}", "live off", "live off", "where"]
    options = [part for word in words for part in ("--do", word)]
    assert invoke(["jog", "virtual", *options, "--json"]) == 0
    said = capsys.readouterr().err
    assert "live until live off" in said
    assert "the live picture is off\nit was off\n" in said
    assert "\x1b" not in said
    assert "\r" not in said
    picture = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
    assert picture is not None
    assert picture.shape == (1024, 1280)


def test_without_a_terminal_a_live_picture_needs_a_file(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert invoke(["jog", "virtual", "--do", "live"]) == 2
    assert "live picture.png" in capsys.readouterr().err
