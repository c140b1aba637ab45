"""URScript as text: cutting uploads into programs and reading what matters of them."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from drivers.simulators.ur.motion import PathEntry, ScriptError

if TYPE_CHECKING:
    from collections.abc import Iterator

CONTROL_PROGRAM = "rtde_control"
_OPENS = re.compile(r"^(?:def|sec)\s+(\w+)\s*\(.*\)\s*:")
_MOVE = re.compile(r"^(movej|movel|movep)\(\s*p?\[([^\]]*)\]\s*(.*)\)$")
_SETTING = re.compile(r"\b([avr])\s*=\s*([-+.\deE]+)")
_CALL = re.compile(r"^(\w+)\(\s*(.*?)\s*\)$")
_OFFSET = r"# {} register offset\s*\n\s*(\d+)"
_LINE_MAX = 1 << 20


@dataclass(frozen=True)
class Program:
    """One program as it came over the wire."""

    name: str
    lines: tuple[str, ...]

    @property
    def is_control(self) -> bool:
        """Whether it is the program that obeys an RTDE control client."""
        return self.name == CONTROL_PROGRAM

    def offset(self, kind: Literal["int", "float"]) -> int:
        """First register that the control program uses, 0 or 24."""
        found = re.search(_OFFSET.format(kind), "\n".join(self.lines))
        return int(found.group(1)) if found else 0

    def path(self) -> tuple[PathEntry, ...]:
        """The moves between the injection mark and the next ``end``.

        Raises:
            ScriptError: a line that is not a move.
        """
        entries: list[PathEntry] = []
        progress = 0
        for line in self._path_lines():
            call = _CALL.match(line)
            if call and call.group(1) == "signal_async_progress":
                progress = int(call.group(2))
            else:
                entries.append(path_entry(line, progress))
        return tuple(entries)

    def _path_lines(self) -> Iterator[str]:
        lines = iter(self.lines)
        for line in lines:
            if "# inject move path" in line:
                break
        for line in lines:
            text = line.strip()
            if text == "end":
                return
            if text and not text.startswith("#"):
                yield text


def path_entry(line: str, progress: int = 0) -> PathEntry:
    """One ``movej([...], a=, v=, r=)`` or ``movel(p[...], ...)`` line.

    Raises:
        ScriptError: not such a line.
    """
    found = _MOVE.match(line)
    if not found:
        raise ScriptError(f"cannot run {line!r}")
    kind, numbers, rest = found.groups()
    settings = {key: float(value) for key, value in _SETTING.findall(rest)}
    target = tuple(float(number) for number in numbers.split(","))
    if len(target) != 6:
        raise ScriptError(f"{kind} needs six numbers, not {len(target)}")
    joint = kind == "movej"
    return PathEntry(
        kind,
        target,
        settings.get("a", 1.4 if joint else 1.2),
        settings.get("v", 1.05 if joint else 0.25),
        settings.get("r", 0.0),
        progress,
    )


def call_of(line: str) -> tuple[str, list[str]] | None:
    """Name and arguments of a plain call, or None."""
    found = _CALL.match(line.strip())
    if not found:
        return None
    return found.group(1), [part.strip() for part in found.group(2).split(",")]


@dataclass
class ScriptReader:
    """Cuts what arrives on a script port into programs.

    A program ends with the line ``end`` in column 0; a line outside is a program of
    its own.
    """

    _rest: bytes = b""
    _name: str = ""
    _lines: list[str] = field(default_factory=list)

    def feed(self, data: bytes) -> Iterator[Program]:
        """Programs that are complete now."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        self._rest = self._rest[-_LINE_MAX:]
        for raw in lines:
            program = self._line(raw.rstrip(b"\r").decode("utf-8", "replace"))
            if program is not None:
                yield program

    def _line(self, line: str) -> Program | None:
        if not self._name:
            opens = _OPENS.match(line)
            if opens:
                self._name, self._lines = opens.group(1), [line]
                return None
            return Program("", (line,)) if line.strip() else None
        self._lines.append(line)
        if line.rstrip() != "end":
            return None
        program = Program(self._name, tuple(self._lines))
        self._name, self._lines = "", []
        return program
