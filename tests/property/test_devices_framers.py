from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mvp.devices import (
    DelimiterFramer,
    EchoStripper,
    Framer,
    LengthFramer,
    LineFramer,
)
from tests.fuzzing import Mutants, at_length, fuzz

LENGTHS = {0x74: 3, 0x76: 7, 0x67: 12}
MAKERS: dict[str, Callable[[], Framer]] = {
    "lines": lambda: LineFramer(max_bytes=40),
    "delimiter": lambda: DelimiterFramer(b"\xff", max_bytes=16),
    "length": lambda: LengthFramer(LENGTHS, last=0x0D),
}
likely = st.sampled_from([0x0A, 0x0D, 0xFF, 0x74, 0x76, 0x67, 0x00, 0x90])
noise = st.lists(likely | st.integers(0, 255), max_size=200).map(bytes)


def cut(data: bytes, sizes: list[int]) -> list[bytes]:
    pieces, start = [], 0
    for size in [*sizes, len(data)]:
        pieces.append(data[start : start + size])
        start += size
    return pieces


def never_raises_and_stays_small(kind: str, chunks: list[bytes]) -> None:
    framer = MAKERS[kind]()
    frames = []
    for chunk in chunks:
        frames += framer.feed(chunk)
        assert framer.held_bytes <= 40
    total = sum(map(len, chunks))
    assert framer.garbage_bytes + framer.held_bytes <= total
    assert sum(map(len, frames)) <= total
    for frame in frames:
        check_frame(kind, frame)


def check_frame(kind: str, frame: bytes) -> None:
    if kind == "lines":
        assert b"\n" not in frame
        assert len(frame) < 40
    elif kind == "delimiter":
        assert frame.index(0xFF) == len(frame) - 1 < 16
    else:
        assert len(frame) == LENGTHS[frame[0]]
        assert frame[-1] == 0x0D


@pytest.mark.parametrize("kind", MAKERS)
@given(chunks=st.lists(noise, max_size=20))
def test_a_framer_survives_anything(kind: str, chunks: list[bytes]) -> None:
    never_raises_and_stays_small(kind, chunks)


@pytest.mark.full
@pytest.mark.parametrize("kind", MAKERS)
@settings(max_examples=1_000, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_framer_survives_anything_at_length(kind: str, seed: int) -> None:
    """100,000 inputs; half of their bytes are those that mean something."""
    rng = np.random.default_rng(seed)
    bytes_ = rng.integers(0, 256, (100, 60), np.uint8)
    meant = np.frombuffer(b"\n\r\xff\x74\x76\x67\x00\x90", np.uint8)
    bytes_ = np.where(
        rng.random(bytes_.shape) < 0.5, rng.choice(meant, bytes_.shape), bytes_
    )
    sizes = rng.integers(0, 61, 100)
    chunks = [row[:size].tobytes() for row, size in zip(bytes_, sizes, strict=True)]
    never_raises_and_stays_small(kind, chunks)


@pytest.mark.parametrize("kind", MAKERS)
@given(data=noise, sizes=st.lists(st.integers(0, 9), max_size=60))
def test_how_the_bytes_are_cut_changes_nothing(
    kind: str, data: bytes, sizes: list[int]
) -> None:
    whole, pieces = MAKERS[kind](), MAKERS[kind]()
    expected = whole.feed(data)
    assert [f for p in cut(data, sizes) for f in pieces.feed(p)] == expected
    assert pieces.held_bytes == whole.held_bytes
    assert pieces.garbage_bytes == whole.garbage_bytes


@given(st.lists(st.text("abc $=:.,-0123456789<>|", max_size=30), max_size=20))
def test_lines_come_out_as_they_went_in(lines: list[str]) -> None:
    data = b"".join(line.encode() + b"\r\n" for line in lines)
    assert LineFramer(max_bytes=40).feed(data) == [line.encode() for line in lines]


payload = st.binary(min_size=2, max_size=14).map(lambda b: b.replace(b"\xff", b"\x00"))


@given(st.lists(payload, max_size=20))
def test_delimited_frames_come_out_as_they_went_in(payloads: list[bytes]) -> None:
    frames = [p + b"\xff" for p in payloads]
    assert DelimiterFramer(b"\xff", max_bytes=16).feed(b"".join(frames)) == frames


@st.composite
def by_length(draw: st.DrawFn) -> bytes:
    first = draw(st.sampled_from(sorted(LENGTHS)))
    body = draw(st.binary(min_size=LENGTHS[first] - 2, max_size=LENGTHS[first] - 2))
    return bytes([first]) + body + b"\r"


@given(st.lists(by_length(), max_size=20))
def test_frames_by_length_may_hold_the_last_byte_inside(frames: list[bytes]) -> None:
    assert LengthFramer(LENGTHS, last=0x0D).feed(b"".join(frames)) == frames


@given(by_length(), st.binary(max_size=30))
def test_a_framer_by_length_finds_back_after_noise(frame: bytes, noise: bytes) -> None:
    """Enough frames after any noise, and whole ones come out again."""
    out = LengthFramer(LENGTHS, last=0x0D).feed(noise + frame * 10)
    assert frame in out[-9:]


def test_an_overlong_line_is_dropped_to_its_end() -> None:
    framer = LineFramer(max_bytes=10)
    assert framer.feed(b"x" * 5000) == []
    assert framer.held_bytes == 0
    assert framer.feed(b"yyy\nok\n") == [b"ok"]
    assert framer.garbage_bytes == 5004


def test_a_forgotten_partial_frame_does_not_poison_the_next() -> None:
    framer = LengthFramer(LENGTHS, last=0x0D)
    framer.feed(b"\x67\x01")
    framer.reset()
    assert framer.feed(b"\x74\x00\x0d") == [b"\x74\x00\x0d"]


@given(st.binary(min_size=1, max_size=20), st.binary(max_size=20))
def test_an_echo_is_taken_out_and_the_answer_stays(sent: bytes, answer: bytes) -> None:
    stripper = EchoStripper()
    stripper.sent(sent)
    data = sent + answer
    assert b"".join(stripper.feed(data[i : i + 1]) for i in range(len(data))) == answer


def test_an_answer_without_echo_passes() -> None:
    stripper = EchoStripper()
    stripper.sent(b"\x76\x0d")
    passed = stripper.feed(b"\x76\x05\x00\x00\x00\x00\x0d") + stripper.reset()
    assert passed == b"\x76\x05\x00\x00\x00\x00\x0d"


def test_an_answer_equal_to_the_command_is_kept() -> None:
    stripper = EchoStripper()
    stripper.sent(b"\x88\x01\xff")
    assert stripper.feed(b"\x88\x01\xff\x88\x01\xff") == b"\x88\x01\xff"


@given(st.lists(noise, max_size=10), st.lists(noise, max_size=10))
def test_an_echo_stripper_only_removes(sent: list[bytes], came: list[bytes]) -> None:
    stripper = EchoStripper(max_bytes=100)
    for data in sent:
        stripper.sent(data)
    passed = b"".join(map(stripper.feed, came)) + stripper.reset()
    assert len(passed) <= sum(map(len, came))


SENT = (b"G1 X10\n", b"$$\n")
ECHOED = [b"G1 X10\nok\n$$\n$1=2\nok\n", b"G1 X10\n$$\n<Idle>\nok\n"]


@at_length
def test_an_echo_stripper_loses_nothing_but_echoes_at_length() -> None:
    """Of 100,000 damaged streams, each cut in two."""
    mutants = Mutants(ECHOED, [*SENT, b"ok", b"\n", b"G1"])

    def check(data: bytes) -> None:
        stripper = EchoStripper()
        for sent in SENT:
            stripper.sent(sent)
        at = mutants.rng.randrange(len(data) + 1)
        passed = stripper.feed(data[:at]) + stripper.feed(data[at:])
        held = stripper.reset()
        gone = len(data) - len(passed + held)
        assert gone in (0, len(SENT[0]), len(SENT[0]) + len(SENT[1]))
        assert bytes(sorted(passed + held + b"".join(SENT))) == bytes(
            sorted(data + b"".join(SENT)[gone:])
        )

    fuzz(check, mutants)
