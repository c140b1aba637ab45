"""What the driver asks of a firmware, whichever it is."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from mvp.devices import Finding, Session
    from mvp.errors import DeviceFault


class Activity(Enum):
    """What the machine does, in the words that every firmware shares."""

    STANDS = "stands"
    MOVES = "moves"
    HELD = "held"
    ALARM = "alarm"


@dataclass(frozen=True)
class Report:
    """Where the machine says that it is.

    Attributes:
        machine: coordinate by axis letter, mm or deg.
        homed: what the firmware itself says of it; None when it says nothing.
        found: letters of the axes that it says it has homed; None as above.
        state: the firmware's own word.
    """

    activity: Activity
    machine: Mapping[str, float]
    homed: bool | None
    state: str
    found: frozenset[str] | None = None


@dataclass(frozen=True)
class Identity:
    """Who answered; ``serial`` is what its owner called it, if anything."""

    firmware: str
    version: str
    serial: str = ""


class GantryWire(Protocol):
    """One conversation with a firmware. Time-outs and lost links are errors."""

    @property
    def session(self) -> Session:
        """The conversation, to ask where it leads, to write it down and to close it."""
        ...

    @property
    def can_stop(self) -> str:
        """``yes``, or ``no: `` and why a stop does not act at once."""
        ...

    @property
    def doubts(self) -> tuple[Finding, ...]:
        """What about its settings somebody should look at; known once it is open."""
        ...

    @property
    def alarm(self) -> DeviceFault | None:
        """The alarm that stands; None for none that was seen to come."""
        ...

    def open(self) -> Identity:
        """Connect and ask who is there; moves nothing.

        Raises:
            ConnectError: nobody, or another firmware.
        """
        ...

    def report(self) -> Report:
        """Where it is now, also while it moves.

        Raises:
            DeviceFault: an alarm stands and it does not answer.
            DeviceTimeout, WireError, LinkLost: no sensible answer.
        """
        ...

    def home(self, *, timeout_s: float) -> None:
        """Let the firmware find its switches; returns when it has.

        Raises:
            DeviceFault: a switch was not found.
        """
        ...

    def move(self, words: str, *, feed_min: float, timeout_s: float) -> None:
        """One straight move; returns when the machine stands.

        Raises:
            DeviceFault, LimitError: refused, or ended by an alarm.
            MotionStopped: ``halt`` was called.
        """
        ...

    def halt(self) -> None:
        """Begin to stop, at once, from any thread; the move's caller ends it."""
        ...

    def settle_halt(self) -> bool:
        """End a stop that ``halt`` began; whether the position is still known."""
        ...

    def reset_steps(self) -> list[tuple[str, Callable[[], str]]]:
        """What a person does about the state it is in: text and action."""
        ...
