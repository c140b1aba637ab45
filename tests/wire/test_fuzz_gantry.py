"""Gantry drivers on a wire that says anything: their own errors only, and back in step."""

from __future__ import annotations

import re
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers._gantry.grbl_report import ReportReader
from drivers.arm_gantry import GantryArm
from mvp.devices import DeviceContext, text
from mvp.errors import ConnectError, DeviceError, DeviceTimeout, WireError
from mvp.testing import FarEnd
from mvp.testing.require import nothing_in_the_way
from tests.fuzzing import Mutants, at_length, fuzz
from tests.wire.still_wire import Damaged, fuzz_conversations

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivers._gantry.config import GantryConfig

GRBL = {
    b"$I\n": b"[VER:1.1f.20240928:]\r\n[OPT:V,100,1024,5,0]\r\n[AXS:5:XYZAB]\r\nok\r\n",
    b"$$\n": b"$1=25\r\n$13=0\r\n$20=1\r\n$110=5000.0\r\n$133=350.0\r\nok\r\n",
    b"?": b"<Idle|MPos:-100.000,-200.000,-50.000,10.000,20.000|H:1|FS:0,0>\r\n",
}
PLACE = b"X:100.00 Y:200.00 Z:50.00 E:0.00 A:10.00 B:20.00 Count X:8000 Y:1 Z:1\nok\n"
TRIES = 10
AXES = [
    {
        "letter": letter,
        "low": low,
        "high": 1200,
        "speed": 100,
        "acceleration": 100,
        "home": "declared" if letter in "AB" else "switch",
    }
    for letter, low in (("X", -1200), ("Y", -1200), ("Z", -900), ("A", -90), ("B", -90))
]
AT = {
    "grblhal": (-100.0, -200.0, -50.0),
    "marlin": (100.0, 200.0, 50.0),
}


def grbl(sent: bytes) -> bytes:
    return GRBL.get(sent, b"ok\r\n" if sent.endswith(b"\n") else b"")


def marlin(sent: bytes) -> bytes:
    body = sent.partition(b"*")[0]
    if b"M115" in body:
        return b"FIRMWARE_NAME:Marlin 2.1.2 X\nCap:EMERGENCY_PARSER:1\nok\n"
    return PLACE if b"M114" in body else b"ok\n"


# Nothing that moves, unlocks or sets is ever sent to find out what is the matter.
MOVES_OR_SETS = re.compile(rb"(N\d+ )?(G[0123]\b|G28|G53|\$[HXJ]|\$\d+=|M50\d)")
FAR_ENDS = {"grblhal": grbl, "marlin": marlin}


def config_of(firmware: str) -> GantryConfig:
    """Of one that is not patient."""
    return GantryArm.Config.model_validate(
        {
            "port": "x",
            "firmware": firmware,
            "axes": AXES,
            "answer_s": 0.02,
            "identify_s": 0,
        }
    )


@pytest.fixture(params=FAR_ENDS, scope="module")
def rig(request: pytest.FixtureRequest) -> Iterator[tuple[FarEnd, Any, Any]]:
    answer = FAR_ENDS[request.param]
    far_end = FarEnd("arm", answer)
    config = config_of(request.param)
    context = DeviceContext(transports=far_end.as_link)
    with GantryArm.from_config(config, context, name="arm") as arm:
        yield far_end, arm, AT[request.param]


likely = st.sampled_from(
    [
        *(bytes([b]) for b in b"\n\r<>|,:.-0123456789okXYZ"),
        b"ok\n",
        b"error:9\n",
        b"echo:busy: processing\n",
        b"Resend: 1\n",
        b"<Idle|MPos:1,2,3,4,5>\n",
        b"<Idle|WPos:1,2>\n",
        b"[VER:",
        b"X:nan",
    ]
)
noise = st.lists(likely | st.binary(max_size=3), max_size=30).map(b"".join)


def survives(rig: Any, before: bytes, after: bytes, unasked: bytes) -> object:
    """Noise around every answer, and noise that nobody asked for; where it is then.

    A device that really said that it has halted, restarted or met a limit is believed:
    such words are not among the noise.
    """
    far_end, arm, _ = rig
    quiet = far_end.answer
    far_end.say(unasked)
    far_end.answer = lambda sent: before + quiet(sent) + after
    with suppress(DeviceError):
        arm.state()
    far_end.answer = quiet
    far_end.say(b"\n")
    found = back_in_step(arm).joints[:3]
    assert not [data for data in far_end.sent if MOVES_OR_SETS.match(data)]
    far_end.sent.clear()
    return found


def back_in_step(arm: Any) -> Any:
    """Opened anew; more than once, as a busy computer misses so short a deadline."""
    for _ in range(TRIES):
        with suppress(DeviceError):
            arm.close()
        with suppress(DeviceTimeout, ConnectError):
            arm.open()
            return arm.state()
    raise AssertionError("it does not answer any more")


@settings(max_examples=15, deadline=None)
@given(before=noise, after=noise, unasked=noise)
def test_any_noise_ends_in_a_device_error_and_then_all_is_well(
    rig: Any, before: bytes, after: bytes, unasked: bytes
) -> None:
    assert survives(rig, before, after, unasked) == rig[2]


GREETINGS = [
    b"Grbl 1.1h ['$' for help]\r\n",
    b"[MSG:INFO: FluidNC v3.7.8]\r\n",
    b"ALARM:1\r\n",
    b"<Hold:0|WPos:1.000,2.000,3.000,0.000,0.000|WCO:0,0,0,0,0|Pn:X>\r\n",
    b"error:9\r\n",
    b"start\necho:Marlin 2.1.2\n",
    b"Error:Printer halted. kill() called!\n",
    b"Error:checksum mismatch, Last Line: 3\nResend: 4\nok\n",
    b"echo:busy: processing\n",
    b'echo:Unknown command: "G77"\nok\n',
]
PIECES = (
    b"ok error: ALARM: < > | , : MPos: WCO: [VER: [AXS:5:XYZAB] $13=1 Resend: X: Count"
)


@pytest.mark.parametrize("place", [b"1" * 400, b"12345678", b"1.2.3", b"-", b"nan"])
def test_a_place_that_no_axis_can_have_is_no_place(place: bytes) -> None:
    """400 digits are infinity to Python; the head of 12345678 is another place."""
    far_end = FarEnd("arm", marlin)
    context = DeviceContext(transports=far_end.as_link)
    with GantryArm.from_config(config_of("marlin"), context, name="arm") as arm:
        said = PLACE.replace(b"A:10.00", b"A:" + place)
        far_end.answer = lambda sent: said if b"M114" in sent else marlin(sent)
        with pytest.raises(WireError, match="no A"):
            arm.state()
        far_end.answer = marlin
        assert arm.state().joints[:3] == AT["marlin"]


def damaged(firmware: str) -> Damaged:
    """A board that damages some of its answers."""
    good = [*GRBL.values(), *GREETINGS, PLACE, marlin(b"M115"), b"ok\n"]
    return Damaged(FAR_ENDS[firmware], good, PIECES.split())


def converses(arm: GantryArm, board: Damaged, unasked: bytes) -> None:
    """All that a gantry does, each time answered by anything."""
    here = [0.0] * len(AXES)
    board.share = board.mutants.rng.choice((0.05, 0.2, 0.6))
    for act in (
        arm.open,
        lambda: board.far_end.say(unasked),
        arm.state,
        lambda: arm.home(timeout_s=900, clear=nothing_in_the_way),
        arm.state,
        lambda: arm.move_joints(here, timeout_s=60),
        arm.stop,
        lambda: list(arm.recovery()),
    ):
        with suppress(DeviceError):
            act()


@at_length
@pytest.mark.parametrize("firmware", FAR_ENDS)
def test_whatever_is_answered_it_is_a_device_error_at_length(firmware: str) -> None:
    board = damaged(firmware)
    arm = GantryArm.from_config(config_of(firmware), board.context(), name="arm")

    def check() -> None:
        assert arm.state().joints[:3] == AT[firmware]

    fuzz_conversations(arm, board, lambda said: converses(arm, board, said), check)


FIELDS = ["MPos:", "WPos:", "WCO:", "H:1", "H:", "FS:0,0", "Pn:X"]
numbers = st.lists(st.floats() | st.integers(), max_size=7).map(
    lambda values: ",".join(str(v) for v in values)
)
fields = st.lists(
    st.tuples(st.sampled_from(FIELDS), numbers).map("".join) | st.text(max_size=8),
    max_size=5,
)
states = st.sampled_from(["Idle", "Run", "Hold:0", "Alarm", "Door:9", "", "idle"])
reports = st.builds(lambda s, f: f"<{'|'.join([s, *f])}>", states, fields)


def reads(lines: list[str]) -> list[float]:
    """Every line is a whole report or none; what a good one after them all is read as."""
    reader = ReportReader("XYZAB")
    for line in lines:
        report = reader.read(line)
        assert report is None or set(report.machine) == set("XYZAB")
    good = reader.read("<Idle|MPos:1.000,-2.000,3.000,4.000,5.000|H:1>")
    return list(good.machine.values()) if good else []


@settings(deadline=None)
@given(st.lists(reports | st.text(max_size=40), max_size=6))
def test_any_line_is_a_report_with_every_axis_or_none(lines: list[str]) -> None:
    assert reads(lines) == [1.0, -2.0, 3.0, 4.0, 5.0]


@at_length
def test_any_line_is_a_report_or_none_at_length() -> None:
    mutants = Mutants([GRBL[b"?"].strip(), *GREETINGS], PIECES.split())

    def check(line: bytes) -> None:
        assert reads([text(line)]) == [1.0, -2.0, 3.0, 4.0, 5.0]

    fuzz(check, mutants)
