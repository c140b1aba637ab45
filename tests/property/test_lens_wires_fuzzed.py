"""Lens drivers on a wire that says anything: their own errors only, and back in step."""

import re
from collections.abc import Callable, Iterator
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.lens_scf4 import Scf4Lens
from drivers.lens_theia import TheiaLens
from drivers.lens_visca import ViscaLens
from mvp.devices import DeviceContext, Lens
from mvp.errors import DeviceError
from mvp.testing import FarEnd

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


@pytest.fixture(params=CASES, scope="module")
def rig(request: pytest.FixtureRequest) -> Iterator[tuple[FarEnd, Lens, Ask, object]]:
    driver, table, ask, expected = CASES[request.param]
    far_end = FarEnd("lens", lambda sent: table.get(sent, b""))
    axes = {"zoom": AXIS, "focus": AXIS, "iris": {"low": 0, "high": 75}}
    keys = {"port": "x", "answer_s": 0.02, "quiet_s": 0.001, "identify_s": 0, **axes}
    if request.param == "theia":
        keys["write_setup"] = False
    config = driver.Config.model_validate(keys)
    context = DeviceContext(transports=far_end.as_link)
    with driver.from_config(config, context, name="lens") as lens:
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


@pytest.mark.full
@pytest.mark.timeout(3600)
@settings(max_examples=500, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_any_noise_ends_in_a_device_error_at_length(rig, seed: int) -> None:
    """100,000 noises: of every 200, two are around an answer and the rest unasked."""
    rng = np.random.default_rng(seed)
    values = rng.integers(0, 256, (200, 40), np.uint8)
    values = np.where(
        rng.random(values.shape) < 0.5, rng.choice(MEANT, values.shape), values
    )
    sizes = rng.integers(0, 41, 200)
    noises = [row[:size].tobytes() for row, size in zip(values, sizes, strict=True)]
    for unasked in noises[3:]:
        rig[0].say(unasked)
    assert survives(rig, *noises[:3]) == rig[3]
