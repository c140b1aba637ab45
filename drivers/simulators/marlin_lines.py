"""Lines of Marlin: the receive buffer, numbers, checksums, and what jumps the queue."""

from __future__ import annotations

import re
from dataclasses import dataclass

_RX_MAX = 128
_LINE_MAX = 96
_NUMBERED = re.compile(rb"^N(-?\d{1,9})(.*)\*(\d{1,3})$")
_URGENT = re.compile(rb"[^\n]*(M410|M112)(?!\d)[^\n]*\n")


@dataclass
class Damaged(Exception):
    """A line that is not done; ``why`` in Marlin's words."""

    why: str


class LineReader:
    """Takes bytes and gives whole lines; what the buffer cannot hold is lost.

    Attributes:
        last_number: of the last line that was taken.
    """

    def __init__(self) -> None:
        self._bytes = bytearray()
        self.last_number = 0

    def put(self, data: bytes) -> None:
        """Take bytes from the host."""
        self._bytes += data[: max(_RX_MAX - len(self._bytes), 0)]

    def take_urgent(self) -> list[str]:
        """Commands that do not wait for their turn; an emergency parser finds them."""
        found = [m[1].decode() for m in _URGENT.finditer(bytes(self._bytes))]
        if found:
            self._bytes = bytearray(_URGENT.sub(b"", bytes(self._bytes)))
        return found

    def next_line(self) -> bytes | None:
        """The next line without its end, still with number and checksum."""
        line, mark, rest = bytes(self._bytes).partition(b"\n")
        if not mark:
            return None
        self._bytes = bytearray(rest)
        return line[:_LINE_MAX].strip()

    def checked(self, line: bytes) -> bytes:
        """The command in a line.

        Raises:
            Damaged: number or checksum are not as they should be.
        """
        if not line.startswith(b"N"):
            return line
        match = _NUMBERED.match(line)
        if match is None:
            raise Damaged("No Checksum with line number")
        check = 0
        for byte in line[: line.rindex(b"*")]:
            check ^= byte
        if check != int(match[3]):
            raise Damaged("checksum mismatch")
        number = int(match[1])
        if number != self.last_number + 1 and not match[2].strip().startswith(b"M110"):
            raise Damaged("Line Number is not Last Line Number+1")
        self.last_number = number
        return match[2]
