"""What every lens driver keeps to on a bad line, against its simulated controller."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import pytest

from mvp.errors import ConnectError, DeviceError, LinkLost
from mvp.testing import FarEnd
from tests.wire.lens_makes import SCF4, THEIA, VISCA, LensMake

MOVES = pytest.mark.parametrize("moves", [3, pytest.param(60, marks=pytest.mark.full)])


@dataclass(frozen=True)
class Trial:
    """How the tests below meet one make.

    Attributes:
        pieces: a line that cuts, delays and echoes what the driver must put together.
        noise: drops and flips.
        quick: keys of the driver on the noisy line.
        near: lowest and highest target of zoom, focus and iris on it.
        off_steps: how far a motor may then be from its target.
        in_motion: speed at which a fault meets it on its way.
    """

    make: LensMake
    target: dict[str, int]
    pieces: dict[str, object]
    noise: dict[str, object]
    quick: dict[str, object]
    near: tuple[tuple[int, int], ...]
    off_steps: float
    in_motion: float
    name: str


TRIALS = {
    "scf4": Trial(
        SCF4,
        target={"zoom": 20000, "focus": 30000, "iris": 1234},
        pieces={"max_chunk": 3, "delay_s": 0.003, "garbage_hex": "41540d0a"},
        noise={"drop": 0.002, "flip": 0.002},
        quick={"answer_s": 0.2, "settle_s": 0},
        near=((30000, 36000), (36000, 36000), (1000, 1600)),
        off_steps=1,
        in_motion=4,
        name="SCF4",
    ),
    "theia": Trial(
        THEIA,
        target={"zoom": 1000, "focus": 4000, "iris": 40},
        pieces={"max_chunk": 2, "delay_s": 0.005, "garbage_hex": "41540d"},
        # The board has no checksum and no read-back: only what it says may suffer.
        noise={"drop": 0.01, "flip": 0.01, "direction": "to_host"},
        quick={"answer_s": 0.3},
        near=((2500, 2800), (7700, 7760), (0, 60)),
        off_steps=0,
        in_motion=4,
        name="Theia",
    ),
    "visca": Trial(
        VISCA,
        target={"zoom": 0x2000, "focus": 0x9000, "iris": 3},
        pieces={"max_chunk": 2, "delay_s": 0.003},
        noise={"drop": 0.003, "flip": 0.003},
        quick={"answer_s": 0.2},
        near=((0, 0x3F00), (0x1100, 0xE000), (0, 0x11)),
        off_steps=1,
        in_motion=2,
        name="VISCA device",
    ),
}


@pytest.fixture(params=TRIALS)
def trial(request: pytest.FixtureRequest) -> Trial:
    return TRIALS[request.param]


@pytest.fixture
def bench(lens_bench, trial: Trial) -> Callable[..., object]:
    """A simulator and a lens on it; keys are those of the simulator."""
    return partial(lens_bench, trial.make)


def test_a_silent_port_is_refused(trial: Trial) -> None:
    with pytest.raises(ConnectError, match=f"no {trial.name}"):
        trial.make.over(FarEnd("lens", lambda sent: b"")).open()


def test_bytes_in_pieces_late_and_echoed_change_nothing(bench, trial: Trial) -> None:
    b = bench(noise={**trial.pieces, "echo": True})
    lens = b.lens(strip_echo=True)
    lens.home(timeout_s=60)
    assert lens.move_steps(**trial.target, timeout_s=60).steps() == trial.target
    assert b.places() == pytest.approx(trial.target)


def test_a_pulled_cable_in_motion_is_a_lost_link_and_costs_home(
    bench, trial: Trial
) -> None:
    b = bench(speed_scale=trial.in_motion)
    lens = b.lens()
    lens.home(timeout_s=60)
    assert isinstance(
        b.amid_a_move(lens, trial.target, lambda: b.do("unplug")), LinkLost
    )
    with pytest.raises(LinkLost):
        lens.state()
    b.do("replug")
    lens.close()
    lens.open()
    assert not lens.state().homed


@MOVES
def test_a_noisy_line_ends_in_a_device_error_or_the_right_place(
    bench, trial: Trial, moves: int
) -> None:
    b = bench()
    lens = b.lens(**trial.quick)
    lens.home(timeout_s=60)
    rng = np.random.default_rng(5)
    arrived = 0
    for _ in range(moves):
        b.do("noise", **trial.noise)
        steps = [int(rng.integers(low, high + 1)) for low, high in trial.near]
        target = dict(zip(("zoom", "focus", "iris"), steps, strict=True))
        try:
            lens.move_steps(**target, timeout_s=20)
            assert b.places() == pytest.approx(target, abs=trial.off_steps)
            arrived += 1
        except DeviceError:
            b.do("noise")
            lens.home(timeout_s=60)
    assert arrived or moves < 10
