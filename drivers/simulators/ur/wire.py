"""RTDE packages as bytes: big-endian, a size that counts its own header, a type."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

from drivers.simulators.ur.variables import COUNTS, FORMATS

REQUEST_PROTOCOL = ord("V")
GET_VERSION = ord("v")
SETUP_OUTPUTS = ord("O")
SETUP_INPUTS = ord("I")
START = ord("S")
PAUSE = ord("P")
DATA = ord("U")
TEXT = ord("M")
SETUP_BYTES_MAX = 2048

Scalar: TypeAlias = float | int | bool
Value: TypeAlias = Scalar | Sequence[Scalar]

_HEADER = struct.Struct(">HB")
_DOUBLE = struct.Struct(">d")


def package(kind: int, payload: bytes = b"") -> bytes:
    """One package."""
    return _HEADER.pack(_HEADER.size + len(payload), kind) + payload


def version_package(version: tuple[int, int, int, int]) -> bytes:
    """Answer to the question for the controller's version."""
    return package(GET_VERSION, struct.pack(">4I", *version))


def text_package(text: str, *, level: int, protocol: int) -> bytes:
    """A message for people; level 0 exception to 3 information."""
    message = text.encode()[:255]
    if protocol == 1:
        return package(TEXT, bytes([level]) + message)
    source = b"RTDE"
    sized = bytes([len(message)]) + message + bytes([len(source)]) + source
    return package(TEXT, sized + bytes([level]))


def output_setup(payload: bytes, *, protocol: int) -> tuple[float | None, list[str]]:
    """Frequency asked for (None in protocol 1) and names.

    Raises:
        ValueError: too short, too long, or not text.
    """
    if protocol == 1:
        return None, names_of(payload)
    if len(payload) < _DOUBLE.size:
        raise ValueError("no frequency")
    return _DOUBLE.unpack_from(payload)[0], names_of(payload[_DOUBLE.size :])


def names_of(payload: bytes) -> list[str]:
    """Variable names of a set-up; an empty name after the last comma is none.

    Raises:
        ValueError: longer than a controller takes, or not text.
    """
    if len(payload) > SETUP_BYTES_MAX:
        raise ValueError(f"more than {SETUP_BYTES_MAX} bytes of names")
    names = payload.decode("ascii").split(",")
    return names[:-1] if names[-1] == "" else names


@dataclass
class Framer:
    """Cuts a byte stream into packages."""

    _kept: bytearray = field(default_factory=bytearray)

    def feed(self, data: bytes) -> Iterator[tuple[int, bytes]]:
        """Types and payloads that are complete now.

        Raises:
            ValueError: a size below that of its own header.
        """
        self._kept += data
        while len(self._kept) >= _HEADER.size:
            size, kind = _HEADER.unpack_from(self._kept)
            if size < _HEADER.size:
                raise ValueError(f"a package of {size} bytes")
            if len(self._kept) < size:
                return
            payload = bytes(self._kept[_HEADER.size : size])
            del self._kept[:size]
            yield kind, payload


class Recipe:
    """A list of variables with its packed form.

    Args:
        number: its id on this connection.
        names: variables in order.
        types: one per name.
    """

    def __init__(self, number: int, names: Sequence[str], types: Sequence[str]) -> None:
        self.number = number
        self.names = tuple(names)
        self._counts = [COUNTS.get(type_name, 0) for type_name in types]
        layout = "".join(FORMATS[type_name] for type_name in types)
        self._struct = struct.Struct(">" + layout)

    def pack(self, values: Sequence[Value], *, protocol: int) -> bytes:
        """One data package."""
        flat: list[Scalar] = []
        for value, count in zip(values, self._counts, strict=True):
            if count:
                flat.extend(value)  # type: ignore[arg-type]
            else:
                flat.append(value)  # type: ignore[arg-type]
        body = self._struct.pack(*flat)
        return package(DATA, body if protocol == 1 else bytes([self.number]) + body)

    def unpack(self, body: bytes) -> dict[str, Value] | None:
        """Values by name; None when the length is not the recipe's."""
        if len(body) != self._struct.size:
            return None
        flat = iter(self._struct.unpack(body))
        return {
            name: [next(flat) for _ in range(count)] if count else next(flat)
            for name, count in zip(self.names, self._counts, strict=True)
        }
