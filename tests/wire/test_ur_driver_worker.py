"""The driver's side of the pipe, against workers that misbehave in every way."""

import sys
import textwrap
import time

import pytest

from drivers._ur.process import WorkerProcess
from drivers._ur.status import Freshness, Implausible, Status
from mvp.devices import RealClock
from mvp.errors import ConnectError, DeviceFault, DeviceTimeout, LinkLost

STATUS = Status(
    t_controller_s=12.5,
    joints_rad=(0.0, -1.5, 1.5, 0.0, 0.1, 0.2),
    speeds_rad_s=(0.0,) * 6,
    target_speeds_rad_s=(0.0,) * 6,
    tcp_m_rad=(0.4, 0.1, 0.3, 0.0, 3.1, 0.0),
    robot_mode=7,
    safety_mode=1,
    safety_bits=1,
    runtime_state=2,
    slider=1.0,
)
HELLO = 'say({"hello": 1})'


def worker(*lines: str) -> WorkerProcess:
    """A worker that runs these lines; ``say`` writes a message, ``hear`` reads one."""
    script = textwrap.dedent(
        """
        import json, os, signal, sys, time
        def say(message):
            os.write(1, (json.dumps(message) + chr(10)).encode())
        def hear():
            return json.loads(sys.stdin.readline())
        """
    )
    script += "\n".join(lines)
    return WorkerProcess("arm", RealClock(), command=(sys.executable, "-c", script))


def test_a_worker_that_answers_is_heard():
    process = worker(
        HELLO,
        "asked = hear()",
        'say({"id": asked["id"], "ok": True, "twice": 2 * asked["number"]})',
        "hear()",
    )
    process.wait_started()
    assert process.request("double", timeout_s=20, number=21)["twice"] == 42
    process.kill("end of test")


def test_a_worker_that_cannot_start_says_why():
    process = worker("sys.exit('no module named rtde')")
    with pytest.raises(ConnectError, match=r"code 1 .*no module named rtde"):
        process.wait_started()


@pytest.mark.parametrize(
    ("last", "told"),
    [
        ("os.kill(os.getpid(), signal.SIGSEGV)", "SIGSEGV"),
        ("os.kill(os.getpid(), signal.SIGABRT)", "SIGABRT"),
        ("os._exit(3)", "code 3"),
        ('say({"lost": "the robot hung up"}); hear()', "the robot hung up"),
        ("os.write(1, b'Segmentation fault?\\n'); hear()", "makes no sense"),
        ('say({"status": {"joints": []}}); hear()', "makes no sense"),
        ("os.close(1); time.sleep(60)", "closed its pipe"),
    ],
)
def test_the_end_of_a_worker_ends_a_request_with_the_reason(last, told):
    process = worker(HELLO, "hear()", last)
    process.wait_started()
    with pytest.raises(LinkLost, match=told):
        process.request("anything", timeout_s=20)
    assert not process.alive
    with pytest.raises(LinkLost, match=told):
        process.post("more")
    process.kill("end of test")


def test_a_worker_that_never_answers_is_killed():
    process = worker(HELLO, "time.sleep(3600)")
    process.wait_started()
    with pytest.raises(DeviceTimeout, match="'state'"):
        process.request("state", timeout_s=0.1)
    assert not process.alive
    assert process.kill("again") is None


@pytest.mark.parametrize(
    ("words", "code"),
    [
        ("One of the RTDE input registers are already in use!", "registers-in-use"),
        ("Please enable remote control on the robot!", "local-mode"),
        ("Failed to start control script, before timeout", "script-rejected"),
    ],
)
def test_sentences_of_the_library_become_codes(words, code):
    refusal = {"ok": False, "kind": "RuntimeError", "message": words}
    process = worker(HELLO, "asked = hear()", f"say(dict({refusal}, id=asked['id']))")
    process.wait_started()
    with pytest.raises(DeviceFault) as error:
        process.request("control", timeout_s=20)
    assert error.value.code == code
    assert error.value.hint
    process.kill("end of test")


def test_an_unknown_sentence_of_the_library_is_shown():
    refusal = {"ok": False, "kind": "RuntimeError", "message": "it is Monday"}
    process = worker(HELLO, "asked = hear()", f"say(dict({refusal}, id=asked['id']))")
    process.wait_started()
    with pytest.raises(ConnectError, match="it is Monday"):
        process.request("listen", timeout_s=20)
    process.kill("end of test")


def test_the_newest_state_and_its_age_are_kept():
    message = {"status": STATUS.to_wire()}
    process = worker(HELLO, f"say({message})", "hear()")
    process.wait_started()
    deadline = time.monotonic() + 20
    while time.monotonic() < deadline:
        try:
            found, age_s = process.status()
            break
        except LinkLost:
            time.sleep(0.01)
    assert found == STATUS
    assert age_s < 20
    process.kill("end of test")


def test_a_worker_that_leaves_says_so():
    process = worker(
        HELLO,
        "asked = hear()",
        'say({"id": asked["id"], "ok": True, "over": asked["do"] == "leave"})',
    )
    process.wait_started()
    assert process.close(timeout_s=20, deceleration_rad_s2=3.0)
    assert not process.close(timeout_s=20, deceleration_rad_s2=3.0)


def test_a_worker_that_leaves_a_program_waiting_says_so():
    process = worker(
        HELLO,
        "asked = hear()",
        'say({"id": asked["id"], "ok": True, "over": False})',
    )
    process.wait_started()
    assert not process.close(timeout_s=20, deceleration_rad_s2=3.0)


@pytest.mark.parametrize(
    "change",
    [
        {"joints_rad": (0.0,) * 5},
        {"joints_rad": (float("nan"), 0.0, 0.0, 0.0, 0.0, 0.0)},
        {"joints_rad": (7.0, 0.0, 0.0, 0.0, 0.0, 0.0)},
        {"robot_mode": 9},
        {"slider": float("inf")},
        {"t_controller_s": float("nan")},
    ],
)
def test_frames_that_no_robot_sends_are_refused(change):
    with pytest.raises(Implausible):
        Status.from_wire({**STATUS.to_wire(), **change})


def test_age_is_told_by_the_clock_of_the_controller():
    fresh = Freshness()
    assert fresh.age_s(0.0) == float("inf")
    for k in range(100):
        fresh.note(500.0 + 0.008 * k, 10.0 + 0.008 * k)
    now = 10.0 + 0.008 * 99
    assert fresh.age_s(now) == pytest.approx(0, abs=1e-6)
    assert fresh.age_s(now + 0.3) == pytest.approx(0.3, abs=1e-6)
    # A frame that waited on the way is old although it has only just arrived.
    fresh.note(500.0 + 0.008 * 100, now + 0.6)
    assert fresh.age_s(now + 0.6) > 0.5
