"""What a bad line does to bytes: pure, seeded, in order."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from pydantic import Field

from mvp.fileedge import FileModel

if TYPE_CHECKING:
    from numpy.random import Generator

_MOST_HELD = 10_000


class Noise(FileModel):
    """How bad the line is; the default is a perfect one.

    Attributes:
        drop: probability that a byte is lost.
        flip: probability that one bit of a byte is turned over.
        duplicate: probability that a whole answer comes twice.
        max_chunk: answers are cut into pieces of 1 to so many bytes; 0 leaves them.
        delay_s: every piece waits a random time up to this.
        late_s: every answer waits this long.
        echo: the line returns what it is given, before any answer.
        silence: nothing comes back.
        garbage_hex: comes first whenever the port is opened.
        direction: which way ``drop`` and ``flip`` act.
    """

    drop: float = Field(default=0.0, ge=0, le=1)
    flip: float = Field(default=0.0, ge=0, le=1)
    duplicate: float = Field(default=0.0, ge=0, le=1)
    max_chunk: int = Field(default=0, ge=0)
    delay_s: float = Field(default=0.0, ge=0)
    late_s: float = Field(default=0.0, ge=0)
    echo: bool = False
    silence: bool = False
    garbage_hex: str = Field(default="", pattern="^([0-9a-fA-F]{2})*$")
    direction: Literal["to_host", "to_device", "both"] = "both"


@dataclass(frozen=True)
class Due:
    """Bytes and the moment at which the far end gets them."""

    at_s: float
    data: bytes


class NoisyLine:
    """Decides what becomes of bytes; the order of what is left never changes.

    Args:
        noise: how bad the line is; may be replaced at any time.
        rng: where its mishaps come from.
        byte_s: time that one byte takes; 0 for none.
    """

    def __init__(self, noise: Noise, rng: Generator, *, byte_s: float = 0.0) -> None:
        self.noise = noise
        self._rng = rng
        self._byte_s = byte_s
        self._free_s = {"in": 0.0, "out": 0.0}
        self._late_once: list[float] = []
        self._drop_next = 0

    def hold_next(self, seconds: float, *, count: int = 1) -> None:
        """Let each of the next answers come this much later.

        Raises:
            ValueError: that are more answers than anybody waits for.
        """
        if count > _MOST_HELD:
            raise ValueError(f"count is at most {_MOST_HELD}")
        self._late_once += [seconds] * count

    def drop_next(self, count: int) -> None:
        """Lose the next bytes that go to the host."""
        self._drop_next += count

    def opening(self, now_s: float) -> list[Due]:
        """What comes when the port is opened."""
        return self._paced(bytes.fromhex(self.noise.garbage_hex), now_s, "out")

    def to_device(self, data: bytes, now_s: float) -> list[Due]:
        """What the device gets of what the host sent."""
        if self.noise.direction != "to_host":
            data = self._disturbed(data)
        return self._paced(data, now_s, "in")

    def echoed(self, data: bytes, now_s: float) -> list[Due]:
        """What the host gets back at once of what it sent."""
        return self._paced(data, now_s, "out") if self.noise.echo else []

    def to_host(self, data: bytes, now_s: float) -> list[Due]:
        """What the host gets of what the device said, piece by piece."""
        if self.noise.silence or not data:
            return []
        if self._rng.random() < self.noise.duplicate:
            data += data
        if self.noise.direction != "to_device":
            data = self._disturbed(data)
        lost = min(self._drop_next, len(data))
        self._drop_next -= lost
        begin_s = now_s + self.noise.late_s
        if self._late_once:
            begin_s += self._late_once.pop(0)
        due: list[Due] = []
        for piece in self._pieces(data[lost:]):
            begin_s += self._rng.random() * self.noise.delay_s
            due += self._paced(piece, begin_s, "out")
        return due

    def _disturbed(self, data: bytes) -> bytes:
        """Bytes lost and bits turned over."""
        if not data or not (self.noise.drop or self.noise.flip):
            return data
        values = np.frombuffer(data, np.uint8)
        turned = self._rng.random(values.size) < self.noise.flip
        bits = (1 << self._rng.integers(0, 8, values.size)).astype(np.uint8)
        values = np.where(turned, values ^ bits, values)
        kept = self._rng.random(values.size) >= self.noise.drop
        return values[kept].tobytes()

    def _pieces(self, data: bytes) -> list[bytes]:
        if not self.noise.max_chunk:
            return [data]
        pieces = []
        while data:
            size = int(self._rng.integers(1, self.noise.max_chunk + 1))
            pieces.append(data[:size])
            data = data[size:]
        return pieces

    def _paced(self, data: bytes, now_s: float, way: Literal["in", "out"]) -> list[Due]:
        """After everything sent before, and not faster than the line."""
        if not data:
            return []
        start_s = max(now_s, self._free_s[way])
        if not self._byte_s:
            self._free_s[way] = start_s
            return [Due(start_s, data)]
        self._free_s[way] = start_s + self._byte_s * len(data)
        return [
            Due(start_s + self._byte_s * (i + 1), data[i : i + 1])
            for i in range(len(data))
        ]
