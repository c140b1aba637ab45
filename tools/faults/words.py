"""The vocabulary of the fault table: faults, cases, orders to a simulator."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Mapping

    from mvp.errors import DeviceError

FAULTS: dict[str, str] = {
    "refused": "nobody takes the connection",
    "silent": "connected, but nothing comes back",
    "slow": "answers come later than they may",
    "garbage": "what comes back makes no sense",
    "half frame": "an answer arrives in part",
    "dropped at rest": "the link breaks while nothing moves",
    "dropped in motion": "the link breaks while it moves or exposes",
    "restarted": "the device restarts while it moves or exposes",
    "wrong identity": "another device answers",
    "limit": "it is asked for what it must not do",
    "alarm": "the device itself reports a fault, or its mechanics stick",
    "operator stop": "a person says stop",
    "silent in motion": "it moves or exposes, and nothing comes back any more",
}

Moment = Literal["opening", "rest", "motion"]
Act = Literal["move", "beyond", "home"]


@dataclass(frozen=True)
class Order:
    """One line to the fault channel of a simulator."""

    verb: str
    keys: Mapping[str, object] = field(default_factory=dict)


def order(verb: str, **keys: object) -> Order:
    """Short for ``Order``."""
    return Order(verb, keys)


@dataclass(frozen=True)
class Case:
    """One cell of the matrix.

    Attributes:
        how: what is done, for the page.
        at: before the driver opens, at rest, or while it moves or exposes.
        raises: errors that are right; empty where it must go on rightly all the same.
        within_s: the error must have come by then.
        may_go_on: to go on rightly is right as well.
        do: what brings the fault about.
        undo: what takes it away.
        code: word of the device that a ``DeviceFault`` must carry; empty for any.
        act: what the driver is asked to do.
        stop: ``stop()`` of the driver is the event.
        stands: the far end must have been stopped: it stands, short of its target.
        impostor: key of another simulator that the driver is led to.
        simulator: further keys of the simulator.
        driver: further keys of the driver.
        patience_s: how long the way back may be tried, for what takes time to start.
        timeout_s: deadline that the action is given.
    """

    how: str
    at: Moment
    raises: tuple[type[DeviceError], ...]
    within_s: float
    do: tuple[Order, ...] = ()
    undo: tuple[Order, ...] = ()
    code: str = ""
    act: Act = "move"
    stop: bool = False
    stands: bool = False
    impostor: str = ""
    simulator: Mapping[str, object] = field(default_factory=dict)
    driver: Mapping[str, object] = field(default_factory=dict)
    patience_s: float = 0.0
    timeout_s: float = 60.0
    may_go_on: bool = False


@dataclass(frozen=True)
class NoSense:
    """A fault that a device cannot have."""

    why: str


Row: TypeAlias = dict[str, Case | NoSense]
