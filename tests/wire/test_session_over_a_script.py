import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from mvp.devices import (
    LineFramer,
    RealClock,
    RecordingTransport,
    ReplayTransport,
    Session,
    Take,
)
from mvp.errors import (
    ConnectError,
    DeviceError,
    DeviceFault,
    DeviceTimeout,
    LinkLost,
    MotionStopped,
    WireError,
)
from mvp.testing import FarEnd


def ok_ends(frame: bytes) -> Take:
    if frame.startswith(b"error"):
        raise DeviceFault("refused", device="lens", code=frame.decode())
    return {b"ok": Take.DONE, b"busy": Take.ALIVE}.get(
        frame, Take.PART if frame.startswith(b"$") else Take.OTHER
    )


class Talk:
    """A session over a link in memory and what its push handler saw."""

    def __init__(self, wire: FarEnd, **keys: object) -> None:
        self.wire = wire
        self.pushed: list[bytes] = []
        self.lost: list[DeviceError] = []
        self.link = RecordingTransport(wire)
        keys = {"quiet_s": 0.03, **keys}
        self.session = Session(
            self.link,
            LineFramer(),
            clock=RealClock(),
            on_push=self.push,
            on_lost=self.lost.append,
            **keys,
        )

    def push(self, frame: bytes) -> bool:
        self.pushed.append(frame)
        if frame.startswith(b"ALARM"):
            raise DeviceFault("alarm", device="lens", code=frame.decode())
        return frame.startswith(b"<")


@pytest.fixture
def talk() -> Iterator[Callable[..., Talk]]:
    talks: list[Talk] = []

    def make(
        answer: Callable[[bytes], bytes] = lambda data: b"ok\r\n", **keys: object
    ) -> Talk:
        talks.append(Talk(FarEnd("lens", answer), **keys))
        talks[-1].session.open()
        return talks[-1]

    yield make
    for each in talks:
        each.session.close()
    assert not [t for t in threading.enumerate() if t.name.endswith("-reader")]


def soon(what: Callable[[], object]) -> None:
    end = time.monotonic() + 20
    while not what():
        assert time.monotonic() < end
        time.sleep(0.002)


def test_an_answer_of_several_lines_is_collected(talk) -> None:
    t = talk(lambda data: b"$1=2\r\n<Idle>\r\n$3=4\r\nok\r\n")
    answer = t.session.request(b"$$\n", ok_ends, timeout_s=5)
    assert answer == (b"$1=2", b"$3=4", b"ok")
    assert t.pushed == [b"<Idle>"]
    assert t.session.stray_frames == 0


def test_a_refusal_ends_the_command_and_the_next_one_works(talk) -> None:
    answers = iter([b"error:20\n", b"ok\n"])
    t = talk(lambda data: next(answers))
    with pytest.raises(DeviceFault) as caught:
        t.session.request(b"G99\n", ok_ends, timeout_s=5)
    assert caught.value.code == "error:20"
    assert t.session.request(b"G1\n", ok_ends, timeout_s=5) == (b"ok",)
    assert not t.session.out_of_step


def test_an_alarm_fails_the_command_that_waits(talk) -> None:
    t = talk(lambda data: b"ALARM:2\n")
    with pytest.raises(DeviceFault, match="alarm"):
        t.session.request(b"G1\n", ok_ends, timeout_s=5)


def test_an_alarm_while_nobody_waits_is_only_pushed(talk) -> None:
    t = talk()
    t.wire.say(b"ALARM:1\n")
    soon(lambda: t.pushed)
    assert t.session.request(b"?\n", ok_ends, timeout_s=5) == (b"ok",)


def test_a_sign_of_life_restarts_the_deadline(talk) -> None:
    t = talk(lambda data: b"")

    def slowly() -> None:
        for _ in range(30):
            time.sleep(0.05)
            t.wire.say(b"busy\n")
        t.wire.say(b"ok\n")

    helper = threading.Thread(target=slowly)
    helper.start()
    assert t.session.request(b"G28\n", ok_ends, timeout_s=1.2) == (b"ok",)
    helper.join()


def test_a_late_answer_is_not_taken_for_the_next_command(talk) -> None:
    """The classic: without the drain, the second command gets the first one's answer."""
    t: Talk

    def sync(ask) -> None:
        frames = ask(
            b"$S\n",
            lambda f: Take.DONE if f == b"me" else Take.OTHER,
            timeout_s=1,
        )
        assert frames == (b"me",)

    table = {b"slow\n": b"", b"$S\n": b"me\n", b"next\n": b"$new\nok\n"}
    t = talk(lambda data: table[data], sync=sync)
    with pytest.raises(DeviceTimeout):
        t.session.request(b"slow\n", ok_ends, timeout_s=0.05)
    assert t.session.out_of_step
    t.wire.say(b"$old\nok\n")
    answer = t.session.request(b"next\n", ok_ends, timeout_s=5)
    assert answer == (b"$new", b"ok")
    assert t.wire.sent == [b"slow\n", b"$S\n", b"next\n"]
    assert t.session.stray_frames == 2
    assert not t.session.out_of_step


def test_a_failed_resynchronisation_sends_no_command(talk) -> None:
    def sync(ask) -> None:
        ask(b"$S\n", ok_ends, timeout_s=0.05)

    t = talk(lambda data: b"", sync=sync)
    for _ in range(2):
        with pytest.raises(DeviceTimeout):
            t.session.request(b"move\n", ok_ends, timeout_s=0.05)
    assert t.wire.sent == [b"move\n", b"$S\n", b"$S\n"]
    assert t.session.out_of_step


def test_commands_of_two_threads_do_not_mix(talk) -> None:
    t = talk(lambda data: b"$" + data + b"ok\n")
    wrong: list[object] = []

    def ask(who: bytes) -> None:
        for _ in range(100):
            answer = t.session.request(who + b"\n", ok_ends, timeout_s=10)
            if answer != (b"$" + who, b"ok"):
                wrong.append(answer)

    threads = [threading.Thread(target=ask, args=(b"%d" % i,)) for i in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []


def test_bytes_without_answer_pass_a_command_that_waits(talk) -> None:
    t = talk(lambda data: b"ok\n" if data == b"!" else b"")
    result: list[object] = []
    waiting = threading.Thread(
        target=lambda: result.append(t.session.request(b"G1\n", ok_ends, timeout_s=20))
    )
    waiting.start()
    soon(lambda: t.wire.sent)
    t.session.send(b"!")
    waiting.join()
    assert result == [(b"ok",)]


def test_a_stop_ends_the_wait_and_leaves_the_session_out_of_step(talk) -> None:
    t = talk(lambda data: b"" if data == b"G1\n" else b"ok\n")
    result: list[object] = []

    def move() -> None:
        try:
            t.session.request(b"G1\n", ok_ends, timeout_s=20)
        except MotionStopped as error:
            result.append(error)

    waiting = threading.Thread(target=move)
    waiting.start()
    soon(lambda: t.wire.sent)
    assert t.session.abort(MotionStopped("stop", device="lens"), in_step=False)
    waiting.join()
    assert len(result) == 1
    assert t.session.out_of_step
    assert not t.session.abort(MotionStopped("stop", device="lens"))


def test_an_unplugged_link_fails_the_command_and_all_that_follow(talk) -> None:
    t = talk(lambda data: b"")
    result: list[object] = []

    def move() -> None:
        try:
            t.session.request(b"G1\n", ok_ends, timeout_s=20)
        except LinkLost as error:
            result.append(error)

    waiting = threading.Thread(target=move)
    waiting.start()
    soon(lambda: t.wire.sent)
    t.wire.unplug()
    waiting.join()
    assert len(result) == 1
    with pytest.raises(LinkLost):
        t.session.request(b"G1\n", ok_ends, timeout_s=1)
    with pytest.raises(LinkLost):
        t.session.send(b"!")
    assert len(t.lost) == 1
    assert t.session.is_lost


def test_a_lost_link_opens_anew(talk) -> None:
    t = talk()
    t.wire.unplug()
    soon(lambda: t.session.is_lost)
    t.wire.unplugged = False
    t.session.open()
    assert t.session.request(b"G1\n", ok_ends, timeout_s=5) == (b"ok",)


def test_a_closed_session_refuses(talk) -> None:
    t = talk()
    t.session.close()
    t.session.close()
    with pytest.raises(ConnectError, match="not connected"):
        t.session.request(b"G1\n", ok_ends, timeout_s=1)


def test_echoed_commands_are_taken_out(talk) -> None:
    t = talk(lambda data: data + b"$1\nok\n", strip_echo=True)
    for _ in range(3):
        answer = t.session.request(b"$$\n", ok_ends, timeout_s=5)
        assert answer == (b"$1", b"ok")


def test_a_time_out_writes_the_traffic_down(talk, tmp_path: Path) -> None:
    t = talk(lambda data: b"half an ans", dump_folder=tmp_path / "dumps")
    with pytest.raises(DeviceTimeout) as caught:
        t.session.request(b"$S\n", ok_ends, timeout_s=1.0)
    files = list((tmp_path / "dumps").iterdir())
    assert [f.name for f in files] == ["lens-1.wire.jsonl"]
    assert str(files[0]) in caught.value.hint
    replay = ReplayTransport.load(files[0])
    replay.open()
    assert replay.read(timeout_s=0) == b""
    replay.write(b"$S\n")
    assert replay.read(timeout_s=1) == b"half an ans"


def test_a_device_that_never_falls_silent_is_an_error(talk, monkeypatch) -> None:
    t = talk(quiet_s=0.8)
    t.session.fall_out_of_step()
    monkeypatch.setattr("mvp.devices.session._DRAIN_LIMIT_S", 1.0)
    ending = threading.Event()

    def chatter() -> None:
        while not ending.wait(0.005):
            t.wire.say(b"noise\n")

    helper = threading.Thread(target=chatter)
    helper.start()
    try:
        with pytest.raises(WireError, match="silent"):
            t.session.request(b"G1\n", ok_ends, timeout_s=1)
    finally:
        ending.set()
        helper.join()
    assert t.wire.sent == []


def test_a_chatty_device_that_may_speak_unasked_is_quiet_enough(talk) -> None:
    t = talk()
    t.session.fall_out_of_step()
    ending = threading.Event()

    def report() -> None:
        while not ending.wait(0.005):
            t.wire.say(b"<Idle>\n")

    helper = threading.Thread(target=report)
    helper.start()
    try:
        assert t.session.request(b"G1\n", ok_ends, timeout_s=5) == (b"ok",)
    finally:
        ending.set()
        helper.join()


def test_a_question_is_repeated_until_the_device_has_booted(talk) -> None:
    answers = deque([b"", b"AT garbage\n", b"ok\n"])
    t = talk(lambda data: answers.popleft())
    frames = t.session.request_until(b"$I\n", ok_ends, timeout_s=0.5, patience_s=20)
    assert frames == (b"ok",)


def test_an_answer_that_may_be_left_out_keeps_the_session_in_step(talk) -> None:
    t = talk(lambda data: b"")
    answer = t.session.request(b"x\n", ok_ends, timeout_s=0.05, optional=True)
    assert answer == ()
    assert not t.session.out_of_step


def test_an_answer_that_comes_twice_at_once_does_not_meet_the_next_command(
    talk,
) -> None:
    t = talk(lambda data: (b"$" + data + b"ok\n") * 2)
    for k in range(300):
        answer = t.session.request(b"%d\n" % k, ok_ends, timeout_s=5)
        assert answer == (b"$%d" % k, b"ok")
    assert t.session.stray_frames == 600


def test_half_a_command_in_the_device_swallows_one_question_only(talk) -> None:
    """The line feed of a command was lost: the first question ends that line."""
    held = b""

    def device(data: bytes) -> bytes:
        nonlocal held
        line, held = held + data, b""
        if not line.endswith(b"\n"):
            held = line
            return b""
        return b"me\n" if line == b"$S\n" else b"ok\n" if line == b"G1\n" else b"?\n"

    def sync(ask) -> None:
        ask(b"$S\n", lambda f: Take.DONE if f == b"me" else Take.OTHER, timeout_s=1)

    t = talk(device, sync=sync)
    with pytest.raises(DeviceTimeout):
        t.session.request(b"G1", ok_ends, timeout_s=0.05)
    assert t.session.request(b"G1\n", ok_ends, timeout_s=5) == (b"ok",)
