"""Inputs by the hundred thousand: what is said on a wire, damaged, and plain noise.

Hypothesis looks for the shape of a mistake; this is for volume: a few microseconds an
input, no two the same. The default profile draws the same ones each time, `make
test-full` others. A failure says which input it was and how to draw it again.
"""

from __future__ import annotations

import logging
import random
import secrets
from typing import TYPE_CHECKING

import pytest
from hypothesis import settings

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

MANY = 100_000
NUMBERS = [
    *b"0 -0 -1 1 7 255 256 32768 65536 -2147483649 99999999999999999999".split(),
    *b"1e400 -1e400 nan NaN -inf Infinity . - + 1.2.3 0x10 1_000 \xb2".split(),
    b"9" * 400,
    b"",
    b" ",
]
_LONGEST = 2000
_NOISE = 0.05  # share of inputs that never were anything


class Mutants:
    """Damaged copies of what is good.

    Args:
        good: what the parser is meant for.
        meant: pieces that mean something to it.
        seed: None draws one, or takes 0 where the same inputs are wanted.

    Attributes:
        rng: for whatever else is drawn.
    """

    def __init__(
        self, good: Sequence[bytes], meant: Sequence[bytes], seed: int | None = None
    ) -> None:
        if seed is None:
            seed = 0 if settings().derandomize else secrets.randbelow(1 << 32)
        self.seed = seed
        self._good = list(good)
        self._meant = [*meant, *NUMBERS]
        self.rng = random.Random(seed)
        self._seen: set[bytes] = set()
        self._ways: list[Callable[[bytes], bytes]] = [
            self._flipped,
            self._other_byte,
            self._cut_out,
            self._cut_short,
            self._repeated,
            self._inserted,
            self._inserted,
            self._other_number,
            self._other_number,
            self._spliced,
        ]

    @property
    def given(self) -> int:
        """How many different inputs it has given."""
        return len(self._seen)

    def next(self, good: bytes | None = None) -> bytes:
        """A new one, of any good input or of this one."""
        while True:
            data = self._one(good)
            if data not in self._seen:
                self._seen.add(data)
                return data

    def several(self, first: bytes, count: int) -> list[bytes]:
        """This one and new ones: what is said to one far end, one after the other."""
        return [first, *(self.next() for _ in range(count - 1))]

    def _one(self, good: bytes | None) -> bytes:
        rng = self.rng
        if rng.random() < _NOISE:
            return rng.randbytes(rng.randrange(80))
        data = rng.choice(self._good) if good is None else good
        for _ in range(1 + min(int(rng.expovariate(0.6)), 12)):
            data = rng.choice(self._ways)(data)
        return data[:_LONGEST]

    def _place(self, data: bytes) -> int:
        return self.rng.randrange(len(data) + 1)

    def _slice(self, data: bytes) -> slice:
        start = self._place(data)
        return slice(start, start + self.rng.choice((1, 1, 2, 3, 8, 40)))

    def _flipped(self, data: bytes) -> bytes:
        at = self._place(data)
        bit = 1 << self.rng.randrange(8)
        return data[:at] + bytes(b ^ bit for b in data[at : at + 1]) + data[at + 1 :]

    def _other_byte(self, data: bytes) -> bytes:
        at = self._place(data)
        return data[:at] + self.rng.randbytes(1) + data[at + 1 :]

    def _cut_out(self, data: bytes) -> bytes:
        gone = self._slice(data)
        return data[: gone.start] + data[gone.stop :]

    def _cut_short(self, data: bytes) -> bytes:
        return data[: self._place(data)]

    def _repeated(self, data: bytes) -> bytes:
        twice = self._slice(data)
        times = self.rng.choice((1, 1, 1, 2, 30))
        return data[: twice.stop] + data[twice] * times + data[twice.stop :]

    def _inserted(self, data: bytes) -> bytes:
        at = self._place(data)
        return data[:at] + self.rng.choice(self._meant) + data[at:]

    def _other_number(self, data: bytes) -> bytes:
        """One run of digits, or one other piece that is meant, becomes another."""
        at = self._place(data)
        while at < len(data) and not 0x30 <= data[at] <= 0x39:
            at += 1
        end = at
        while end < len(data) and (0x30 <= data[end] <= 0x39 or data[end] == 0x2E):
            end += 1
        return data[:at] + self.rng.choice(self._meant) + data[end:]

    def _spliced(self, data: bytes) -> bytes:
        other = self.rng.choice(self._good)
        return data[: self._place(data)] + other[self._place(other) :]


def at_length(test: Callable[..., None]) -> Callable[..., None]:
    """For the full run; what new inputs have broken is not forgiven where others do not."""
    for mark in (
        pytest.mark.full,
        pytest.mark.timeout(3600),
        pytest.mark.flaky(reruns=0),
    ):
        mark(test)
    return test


def fuzz(
    check: Callable[[bytes], object], mutants: Mutants, *, count: int = MANY
) -> None:
    """Check so many different inputs; what fails, or hangs, is named.

    A pytest time-out is raised in ``check`` as well, and gets the same note.
    """
    logging.disable()  # a test's record of a million warnings would fill the memory
    try:
        while mutants.given < count:
            _checked(check, mutants)
    finally:
        logging.disable(logging.NOTSET)


def _checked(check: Callable[[bytes], object], mutants: Mutants) -> None:
    data = mutants.next()
    number = mutants.given
    try:
        check(data)
    except BaseException as error:
        error.add_note(f"input {number} of seed {mutants.seed}: {data!r}")
        raise
