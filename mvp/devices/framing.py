"""Bytes to frames: pure, bounded, never raising, whatever the wire delivers.

A framer keeps what is not complete yet and counts what it had to throw away.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Mapping


class Framer(Protocol):
    """Cuts a stream of bytes into frames."""

    @property
    def garbage_bytes(self) -> int:
        """Bytes thrown away since it was made."""
        ...

    @property
    def held_bytes(self) -> int:
        """Bytes of the frame that is not complete yet."""
        ...

    def feed(self, data: bytes) -> list[bytes]:
        """Take what came and hand out the frames that are complete now."""
        ...

    def reset(self) -> None:
        """Throw away the frame that is not complete; used when the wire was quiet."""
        ...


class DelimiterFramer:
    """Frames that end with a fixed byte, handed out with it.

    Args:
        delimiter: one byte that never occurs inside a frame.
        max_bytes: longest frame with its delimiter; a longer one is thrown away up to
            and including the next delimiter.
    """

    def __init__(self, delimiter: bytes, *, max_bytes: int) -> None:
        if len(delimiter) != 1 or max_bytes < 1:
            raise ValueError("one delimiter byte and a positive length are needed")
        self._delimiter = delimiter
        self._max = max_bytes
        self._held = bytearray()
        self._skipping = False
        self._garbage = 0

    @property
    def garbage_bytes(self) -> int:
        """Bytes thrown away since it was made."""
        return self._garbage

    @property
    def held_bytes(self) -> int:
        """Bytes of the frame that is not complete yet."""
        return len(self._held)

    def feed(self, data: bytes) -> list[bytes]:
        """Take what came and hand out the frames that are complete now."""
        *ended, rest = data.split(self._delimiter)
        frames = []
        for piece in ended:
            self._hold(piece + self._delimiter)
            if not self._skipping:
                frames.append(bytes(self._held))
            self._held.clear()
            self._skipping = False
        self._hold(rest)
        return frames

    def reset(self) -> None:
        """Throw away the frame that is not complete."""
        self._garbage += len(self._held)
        self._held.clear()
        self._skipping = False

    def _hold(self, piece: bytes) -> None:
        if self._skipping or len(self._held) + len(piece) > self._max:
            self._garbage += len(self._held) + len(piece)
            self._held.clear()
            self._skipping = self._skipping or bool(piece)
        else:
            self._held += piece


class LineFramer:
    """Lines ended by LF, handed out without it and without CR; may be empty.

    Args:
        max_bytes: longest line; a longer one is thrown away up to the next LF.
    """

    def __init__(self, *, max_bytes: int = 1024) -> None:
        self._lines = DelimiterFramer(b"\n", max_bytes=max_bytes)

    @property
    def garbage_bytes(self) -> int:
        """Bytes thrown away since it was made."""
        return self._lines.garbage_bytes

    @property
    def held_bytes(self) -> int:
        """Bytes of the line that is not complete yet."""
        return self._lines.held_bytes

    def feed(self, data: bytes) -> list[bytes]:
        """Take what came and hand out the lines that are complete now."""
        return [line.strip(b"\r\n") for line in self._lines.feed(data)]

    def reset(self) -> None:
        """Throw away the line that is not complete."""
        self._lines.reset()


class LengthFramer:
    """Frames whose length follows from their first byte, and whose last byte is fixed.

    A byte that begins no frame, and the first byte of a frame that does not end as it
    must, are thrown away one at a time until frames fit again.

    Args:
        lengths: bytes of a frame by its first byte, both ends included.
        last: what every frame ends with; it may occur inside a frame.
    """

    def __init__(self, lengths: Mapping[int, int], *, last: int) -> None:
        if not lengths or min(lengths.values()) < 2:
            raise ValueError("frames have a first and a last byte")
        self._lengths = dict(lengths)
        self._last = last
        self._held = bytearray()
        self._garbage = 0

    @property
    def garbage_bytes(self) -> int:
        """Bytes thrown away since it was made."""
        return self._garbage

    @property
    def held_bytes(self) -> int:
        """Bytes of the frame that is not complete yet."""
        return len(self._held)

    def feed(self, data: bytes) -> list[bytes]:
        """Take what came and hand out the frames that are complete now."""
        self._held += data
        frames = []
        start = 0
        while start < len(self._held):
            length = self._lengths.get(self._held[start], 0)
            end = start + length
            if end > len(self._held):
                break
            if length and self._held[end - 1] == self._last:
                frames.append(bytes(self._held[start:end]))
                start = end
            else:
                self._garbage += 1
                start += 1
        del self._held[:start]
        return frames

    def reset(self) -> None:
        """Throw away the frame that is not complete."""
        self._garbage += len(self._held)
        self._held.clear()


class EchoStripper:
    """Takes the bytes that were sent out of the bytes that come back.

    Only a complete echo is taken out; an answer that merely begins like it is not.

    Args:
        max_bytes: most that is expected back at a time.
    """

    def __init__(self, *, max_bytes: int = 4096) -> None:
        self._max = max_bytes
        self._expected: list[bytes] = []
        self._seen = b""

    def sent(self, data: bytes) -> None:
        """Expect these bytes back."""
        self._expected.append(data)
        while sum(map(len, self._expected)) > self._max:
            self._expected.pop(0)

    def feed(self, data: bytes) -> bytes:
        """What came, without echo."""
        self._seen += data
        passed = b""
        while self._seen and self._expected:
            echo = self._expected[0]
            if self._seen.startswith(echo):
                self._seen = self._seen[len(echo) :]
                self._expected.pop(0)
            elif echo.startswith(self._seen):
                return passed
            else:
                # An answer to something earlier, or noise: the echo may still follow.
                passed, self._seen = passed + self._seen[:1], self._seen[1:]
        passed, self._seen = passed + self._seen, b""
        return passed

    def reset(self) -> bytes:
        """Expect nothing any more; hand out what was held back."""
        held, self._seen = self._seen, b""
        self._expected.clear()
        return held


def text(frame: bytes) -> str:
    """A line as text; bytes that are not ASCII become the replacement character."""
    return frame.decode("ascii", errors="replace")
