"""Status reports of the GRBL family: text in, a report out; no ports, no clock."""

from __future__ import annotations

import re

from drivers._gantry.wire import Activity, Report

_FIELD = re.compile(r"\b(MPos|WPos|WCO|H):([^|>]*)")
_NUMBERS = re.compile(r"-?\d{1,7}(\.\d{1,6})?(,-?\d{1,7}(\.\d{1,6})?)*", re.ASCII)
_HOMED = re.compile(r"([01])(?:,(\d{1,5}))?", re.ASCII)
_ACTIVITIES = {
    "idle": Activity.STANDS,
    "run": Activity.MOVES,
    "jog": Activity.MOVES,
    "home": Activity.MOVES,
    "hold:1": Activity.MOVES,
    "hold:0": Activity.HELD,
    "hold": Activity.HELD,
    "door:0": Activity.HELD,
    "door:1": Activity.HELD,
    "door:2": Activity.MOVES,
    "door:3": Activity.MOVES,
    "alarm": Activity.ALARM,
    "sleep": Activity.ALARM,
    "check": Activity.ALARM,
}


class ReportReader:
    """Reads reports; remembers what comes only now and then.

    That is the work offset, and of grblHAL what it has homed.

    Args:
        letters: of the firmware's axes, in its order; empty while nobody knows them,
            and then a report has a state but no places.
    """

    def __init__(self, letters: str) -> None:
        self._letters = letters
        self._offset: tuple[float, ...] | None = None
        self._homed: bool | None = None
        self._found: frozenset[str] | None = None

    def forget(self) -> None:
        """The controller has restarted: all of that comes anew."""
        self._offset = None
        self.forget_homed()

    def forget_homed(self) -> None:
        """It is about to home."""
        self._homed = self._found = None

    def read(self, line: str) -> Report | None:
        """The report of a line; None for what is none, or cannot be understood."""
        if not (line.startswith("<") and line.endswith(">")):
            return None
        state = line[1:-1].split("|")[0]
        fields = dict(_FIELD.findall(line))
        if "WCO" in fields:
            self._offset = self._numbers(fields["WCO"])
        machine = self._machine(fields)
        activity = self._activity(state)
        if machine is None or activity is None:
            return None
        self._hear_homed(fields.get("H", ""))
        places = dict(zip(self._letters, machine, strict=bool(self._letters)))
        return Report(activity, places, self._homed, state, self._found)

    def _hear_homed(self, text: str) -> None:
        """``1`` or ``0``, and from some a number with one bit for every axis."""
        said = _HOMED.fullmatch(text)
        if said is None:
            return
        self._homed, self._found = said[1] == "1", None
        if said[2] is not None:
            bits = int(said[2])
            self._found = frozenset(
                letter for k, letter in enumerate(self._letters) if bits >> k & 1
            )

    def _machine(self, fields: dict[str, str]) -> tuple[float, ...] | None:
        if "MPos" in fields:
            return self._numbers(fields["MPos"])
        work = self._numbers(fields.get("WPos", ""))
        if work is None or self._offset is None:
            return None
        return tuple(w + o for w, o in zip(work, self._offset, strict=True))

    def _numbers(self, text: str) -> tuple[float, ...] | None:
        if not _NUMBERS.fullmatch(text):
            return None
        values = tuple(float(part) for part in text.split(","))
        fits = not self._letters or len(values) == len(self._letters)
        return values if fits else None

    def _activity(self, state: str) -> Activity | None:
        """By state and sub-state, or by the state alone."""
        word = state.lower()
        return _ACTIVITIES.get(word) or _ACTIVITIES.get(word.split(":")[0])
