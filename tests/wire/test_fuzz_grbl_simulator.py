"""Whatever the simulated GRBL family is told: it obeys its rules, and answers again."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.simulators.grbl import GrblConfig, GrblMachine
from tests.fuzzing import Mutants, at_length, fuzz
from tests.wire.machine_bench import MachineBench

_CHUNKS = st.lists(
    st.one_of(
        st.binary(max_size=40),
        st.sampled_from(
            [b"$H\n", b"$X\n", b"\x18", b"!", b"~", b"?", b"$J=G91X-5F100\n", b"$C\n"]
        ),
        st.from_regex(
            rb"(G[0-9]{1,2}|[XYZABF]-?[0-9]{1,4}(\.[0-9])?){1,6}\n", fullmatch=True
        ),
    ),
    max_size=12,
)
_PROFILES = st.sampled_from(["grbl", "grblhal", "fluidnc"])


def _nonsense(profile: str, chunks: list[bytes]) -> bytes:
    """Whatever was said: it obeys its rules on the way; its answer after a reset."""
    config = GrblConfig.model_validate({"profile": profile, "boot_s": 0.0})
    board = MachineBench(GrblMachine(config))
    board.say(b"")
    axes = board.machine.motion.axes
    before, said = axes.truth, b""
    for chunk in chunks:
        said += board.say(chunk) + board.wait(0.02)
    if b"$" not in b"".join(chunks):  # locked until it is homed or unlocked
        assert (axes.truth == before).all()
    lines = sum(chunk.count(b"\n") + chunk.count(b"\r") for chunk in chunks)
    assert said.count(b"ok\r\n") + said.count(b"error:") <= lines
    board.say(b"\x18")
    board.wait(0.05)
    stands = axes.truth
    assert board.say(b"?").startswith(b"<")
    answer = board.say(b"$I\n")
    board.wait(0.05)
    assert (axes.truth == stands).all(), "a reset ends every motion"
    return answer


@given(_PROFILES, _CHUNKS)
@settings(max_examples=100, deadline=None)
def test_nonsense_does_not_upset_it(profile: str, chunks: list[bytes]) -> None:
    assert b"[VER:" in _nonsense(profile, chunks)


LINES = [
    b"G0 X-10 Y-20.5 Z-3 A4 B5\n",
    b"G53 G1 X-100.000 Y-200.000 Z-50.000 A10.000 B-20.000 F3000.0\n",
    b"G21 G90 G94\nG4 P0\n",
    b"$J=G91 X-5 F100\n",
    b"$H\n",
    b"$I\n$$\n$G\n$#\n?",
    b"$X\n~!\x18?\x84\x85\x9e",
    b"$20=1\n$130=500.0\n",
    b"(comment) ;more\nM3 S100\n",
]
PIECES = b"G1 G91 G28.1 G92 X-1 F F0 $ $J= $C $SLP ! ~ ? \x18 \x82 \x85 \n \r M2 ( ) ;"


@at_length
@pytest.mark.parametrize("profile", ["grbl", "grblhal", "fluidnc"])
def test_much_nonsense_does_not_upset_it(profile: str) -> None:
    mutants = Mutants(LINES, PIECES.split(b" "))

    def check(first: bytes) -> None:
        assert b"[VER:" in _nonsense(profile, mutants.several(first, 20))

    fuzz(check, mutants)
