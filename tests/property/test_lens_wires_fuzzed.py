"""Lens drivers on a wire that says anything: their own errors only, and back in step."""

import re
from collections.abc import Callable, Iterator
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers._theia import MOTOR_IDS, Setup, TheiaConfig
from drivers.lens_scf4 import Scf4Lens
from drivers.lens_theia import TheiaLens
from drivers.lens_visca import ViscaLens
from mvp.devices import DeviceContext, Lens
from mvp.errors import DeviceError
from mvp.fileedge import FileModel
from mvp.testing import FarEnd
from tests.fuzzing import at_length
from tests.wire.still_wire import Damaged, fuzz_conversations

SCF4 = {
    b"$S\n": b"EVB.1.0.2, SCF4-M RevB, Kurokesu, 5DDF\r\n",
    b"!1\n": b"24000, 30000, 900, 0, 0, 0, 0, 0, 0\r\n",
    b"M0\n": b"OK\r\n",
}
THEIA = {
    bytes.fromhex(sent): bytes.fromhex(said)
    for sent, said in {
        "760D": "7605030100000D",
        "790D": "790550000012340D",
        "67020D": "67020000000C9B006405DC0D",  # not as configured: homing ends here
    }.items()
}
VISCA = {
    bytes.fromhex(sent): bytes.fromhex(said)
    for sent, said in {
        "883001FF": "883002FF",
        "81010001FF": "9050FF",
        "81090002FF": "905000200466010702FF",
        "81090447FF": "905001000000FF",
        "81090448FF": "905006000000FF",
        "8109044BFF": "905000000008FF",
        "8101040700FF": "9041FF9051FF",
        "8101040800FF": "9042FF9052FF",
    }.items()
}
# Commands that turn a motor: SCF4, Theia, VISCA (direct zoom, focus and iris).
MOVES = re.compile(rb"G0|[\x62\x66\x73].{10}\r|\x81\x01\x04[\x47\x48\x4b]", re.DOTALL)
AXIS = {"low": 100, "high": 2000}
Ask = Callable[[Lens], object]


def steps(lens: Lens) -> object:
    return tuple(lens.state().steps().values())


def setup(lens: Lens) -> object:
    """Homing that ends at the first set-up, which is the first question it asks."""
    try:
        lens.home(timeout_s=600)
    except DeviceError as error:
        if getattr(error, "code", "") == "setup":
            return "setup"
        raise
    return None


CASES: dict[str, tuple[type, dict[bytes, bytes], Ask, object]] = {
    "scf4": (Scf4Lens, SCF4, steps, (24000, 30000, 900)),
    "theia": (TheiaLens, THEIA, setup, "setup"),
    "visca": (ViscaLens, VISCA, steps, (0x1000, 0x6000, 8)),
}


def config_of(make: str) -> FileModel:
    """Of one that is not patient."""
    axes = {"zoom": AXIS, "focus": AXIS, "iris": {"low": 0, "high": 75}}
    keys = {"port": "x", "answer_s": 0.02, "quiet_s": 0.001, "identify_s": 0, **axes}
    if make == "theia":
        keys["write_setup"] = False
    return CASES[make][0].Config.model_validate(keys)


@pytest.fixture(params=CASES, scope="module")
def rig(request: pytest.FixtureRequest) -> Iterator[tuple[FarEnd, Lens, Ask, object]]:
    driver, table, ask, expected = CASES[request.param]
    far_end = FarEnd("lens", lambda sent: table.get(sent, b""))
    context = DeviceContext(transports=far_end.as_link)
    with driver.from_config(config_of(request.param), context, name="lens") as lens:
        yield far_end, lens, ask, expected


MEANT = np.frombuffer(b"\n\rOK!,$ 0123456789\xff\x90\x50\x41\x51\x60\x74\x67", np.uint8)
likely = st.sampled_from(MEANT.tolist())
noise = st.lists(likely | st.integers(0, 255), max_size=40).map(bytes)


def survives(
    rig: tuple[FarEnd, Lens, Ask, object], before: bytes, after: bytes, unasked: bytes
) -> object:
    """Noise around one answer, and noise that nobody asked for; the answer after that."""
    far_end, lens, ask, _ = rig
    quiet = far_end.answer
    far_end.say(unasked)
    far_end.answer = lambda sent: before + quiet(sent) + after
    with suppress(DeviceError):
        ask(lens)
    far_end.answer = quiet
    with suppress(DeviceError):
        ask(lens)
    found = ask(lens)
    assert not [data for data in far_end.sent if MOVES.match(data)]
    far_end.sent.clear()
    return found


@settings(max_examples=25, deadline=None)
@given(before=noise, after=noise, unasked=noise)
def test_any_noise_ends_in_a_device_error_and_the_next_answers_are_right(
    rig, before: bytes, after: bytes, unasked: bytes
) -> None:
    assert survives(rig, before, after, unasked) == rig[3]


def after_homing(lens: Lens) -> object:
    """Where it is then."""
    return tuple(lens.home(timeout_s=900).steps().values())


# The Theia counts by itself: what it asks its board for is asked while it homes.
AT_LENGTH = {
    **CASES,
    "theia": (
        TheiaLens,
        {k: v for k, v in THEIA.items() if k[0] != 0x67},
        after_homing,
        (3119, 7959, 0),
    ),
}
AXIS_OF = {number: axis for axis, number in MOTOR_IDS.items()}
VISCA_COMMAND = bytes.fromhex("9041FF9051FF")


def obeys(sent: bytes) -> bytes:
    """What any of the three says to a command or question that is not in its table."""
    if sent.startswith(b"\x81"):
        return VISCA_COMMAND if sent[1] == 1 else bytes.fromhex("905002FF")
    if sent[:1] == b"\x67":
        motor = TheiaConfig(port="x").motors()[AXIS_OF[sent[1]]]
        return b"\x67" + Setup.wanted(motor).encode(sent[1])[1:]
    if sent[:1] in b"\x62\x63\x66\x73":
        return (b"\x63" if sent[:1] == b"\x63" else b"\x74") + b"\x00\x0d"
    return b"OK\r\n"


def damaged(table: dict[bytes, bytes]) -> Damaged:
    """A board that damages some of its answers."""
    meant = [bytes([b]) for b in MEANT.tolist()] + [b"OK\r\n", b"\xff\x90"]
    good = [*table.values(), obeys(b""), obeys(b"\x66")]
    return Damaged(lambda sent: table.get(sent) or obeys(sent), good, meant)


def converses(lens: Lens, board: Damaged, unasked: bytes) -> None:
    """All that a lens does, each time answered by anything."""
    board.share = 0.5 if unasked[:1] > b"\x40" else 0.1
    for act in (
        lens.open,
        lambda: board.far_end.say(unasked),
        lens.state,
        lambda: lens.home(timeout_s=900),
        lens.state,
        lambda: lens.move_steps(zoom=500, focus=900, iris=40, timeout_s=60),
        lens.stop,
    ):
        with suppress(DeviceError):
            act()


@at_length
@pytest.mark.parametrize("make", AT_LENGTH)
def test_whatever_is_answered_it_is_a_device_error_at_length(make: str) -> None:
    driver, table, ask, expected = AT_LENGTH[make]
    board = damaged(table)
    lens = driver.from_config(config_of(make), board.context(), name="lens")

    def check() -> None:
        assert ask(lens) == expected

    fuzz_conversations(lens, board, lambda said: converses(lens, board, said), check)
