"""Bytes into lines and lines into bytes, with the limits of a small controller."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from drivers.simulators.grbl_profiles import Profile

_LF, _CR = 0x0A, 0x0D


class Receiver:
    """The receive buffer; what comes while it is full is lost without a word.

    Args:
        profile: the firmware.
    """

    def __init__(self, profile: Profile) -> None:
        self._profile = profile
        self.clear()

    def clear(self) -> None:
        """Forget everything, a half line included."""
        self._bytes = bytearray()
        self._line = bytearray()
        self._last_end = 0

    @property
    def free(self) -> int:
        """Bytes that still fit."""
        return self._profile.rx_bytes - len(self._bytes)

    def put(self, byte: int) -> None:
        """Take a byte that is no real-time command."""
        if byte < 0x80 and self.free > 0:
            self._bytes.append(byte)

    def next_line(self) -> bytes | None:
        """The next complete line without its end; None when there is none yet."""
        for place, byte in enumerate(self._bytes):
            if byte not in (_LF, _CR):
                self._line.append(byte)
                continue
            pair = byte == _LF and self._last_end == _CR and not self._line
            self._last_end = byte
            if pair and not self._profile.counts_both_ends:
                continue
            del self._bytes[: place + 1]
            line, self._line = bytes(self._line), bytearray()
            return line
        self._bytes.clear()
        return None


class Speaker:
    """What the controller says, and the error that some firmwares stick to.

    Attributes:
        refusing: error that every G-code is refused with; 0 when none is.
    """

    def __init__(self, *, sticky: bool) -> None:
        self._sticky = sticky
        self._output = bytearray()
        self.refusing = 0

    def say(self, line: str) -> None:
        """One line."""
        self._output += line.encode("ascii") + b"\r\n"

    def ok(self) -> None:
        """The line before was taken."""
        self.refusing = 0
        self.say("ok")

    def error(self, code: int) -> None:
        """The line before was refused."""
        if self._sticky:
            self.refusing = code
        self.say(f"error:{code}")

    def take(self) -> bytes:
        """What was said since it was last asked."""
        said, self._output = bytes(self._output), bytearray()
        return said

    def clear(self) -> None:
        """The power went off in the middle of a word."""
        self._output.clear()
        self.refusing = 0
