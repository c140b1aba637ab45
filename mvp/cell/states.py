"""States of a run, and which may follow which.

::

    stateDiagram-v2
        [*] --> idle
        idle --> preparing: run
        preparing --> paused: pause or step
        preparing --> moving: next view
        preparing --> finishing: no view, abort, fault
        paused --> moving: resume
        paused --> finishing: abort
        moving --> adjusting: arm stands
        moving --> finishing: abort, fault
        adjusting --> capturing: lens stands
        adjusting --> finishing: abort, fault
        capturing --> verifying: picture and record on disk
        capturing --> finishing: abort, fault
        verifying --> moving: next view
        verifying --> paused: pause or step
        verifying --> finishing: last view, abort, fault
        finishing --> finished: run_finished recorded
        finished --> [*]
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mvp.cell.records import FinishReason


class RunState(Enum):
    """Where a run is."""

    IDLE = "idle"
    PREPARING = "preparing"
    PAUSED = "paused"
    MOVING = "moving"
    ADJUSTING = "adjusting"
    CAPTURING = "capturing"
    VERIFYING = "verifying"
    FINISHING = "finishing"
    FINISHED = "finished"


_S = RunState
TRANSITIONS: dict[RunState, frozenset[RunState]] = {
    _S.IDLE: frozenset({_S.PREPARING}),
    _S.PREPARING: frozenset({_S.PAUSED, _S.MOVING, _S.FINISHING}),
    _S.PAUSED: frozenset({_S.MOVING, _S.FINISHING}),
    _S.MOVING: frozenset({_S.ADJUSTING, _S.FINISHING}),
    _S.ADJUSTING: frozenset({_S.CAPTURING, _S.FINISHING}),
    _S.CAPTURING: frozenset({_S.VERIFYING, _S.FINISHING}),
    _S.VERIFYING: frozenset({_S.MOVING, _S.PAUSED, _S.FINISHING}),
    _S.FINISHING: frozenset({_S.FINISHED}),
    _S.FINISHED: frozenset(),
}


@dataclass(frozen=True)
class RunStatus:
    """A snapshot for whoever watches.

    Attributes:
        view: id of the view being taken, or of the next one while paused.
        index: how many views are behind us.
        total: how many views the run takes.
        reason: how it ended, once finished.
    """

    state: RunState
    view: str | None
    index: int
    total: int
    reason: FinishReason | None = None
