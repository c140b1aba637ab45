"""The one command of a session that waits for its answer."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, Protocol, TypeAlias

from mvp.errors import DeviceTimeout, MvpCellError

if TYPE_CHECKING:
    from collections.abc import Callable

    from mvp.devices.context import Clock


class Take(Enum):
    """What a frame is to the command that waits for its answer."""

    OTHER = "not for this command"
    PART = "belongs to the answer, which goes on"
    ALIVE = "not the answer, but the device is at it: the deadline starts anew"
    DONE = "completes the answer"


Accept: TypeAlias = "Callable[[bytes], Take]"


class Ask(Protocol):
    """Sends a command and waits for its answer, also while out of step."""

    def __call__(
        self, data: bytes, accept: Accept, *, timeout_s: float
    ) -> tuple[bytes, ...]:
        """The frames of the answer; errors as of ``Session.request``."""
        ...


@dataclass(eq=False)
class Pending:
    """A command that waits.

    Attributes:
        accept: told every frame.
        timeout_s: from sending, or from the last sign of life.
        deadline_s: on the clock.
        frames: of the answer.
        error: that ends it instead of an answer.
        complete: nothing more is taken.
        ended: set when the waiting thread may go on.
        released: set when another command may be sent.
    """

    accept: Accept
    timeout_s: float
    deadline_s: float
    frames: list[bytes] = field(default_factory=list)
    error: MvpCellError | None = None
    complete: bool = False
    ended: threading.Event = field(default_factory=threading.Event)
    released: threading.Event = field(default_factory=threading.Event)


class CommandSlot:
    """Holds the waiting command; others wait until it is released.

    Args:
        clock: monotonic time and waiting.
        name: of the device, for errors.
    """

    def __init__(self, clock: Clock, name: str) -> None:
        self._clock = clock
        self._name = name
        self._lock = threading.Lock()
        self._pending: Pending | None = None

    @property
    def is_taken(self) -> bool:
        """Whether a command waits."""
        return self._pending is not None

    def take(self, accept: Accept, timeout_s: float) -> Pending:
        """Become the command that waits, when no other does any more.

        Raises:
            DeviceTimeout: another one waits all that time.
        """
        end_s = self._clock.now_s() + timeout_s
        while True:
            now_s = self._clock.now_s()
            with self._lock:
                other = self._pending
                if other is None:
                    self._pending = Pending(accept, timeout_s, now_s + timeout_s)
                    return self._pending
            if now_s >= end_s:
                raise DeviceTimeout("busy with another command", device=self._name)
            self._clock.wait(other.released, end_s - now_s)

    def wait(self, pending: Pending) -> bool:
        """Whether the command ended before its deadline."""
        while (left_s := pending.deadline_s - self._clock.now_s()) > 0:
            if self._clock.wait(pending.ended, left_s):
                return True
        with self._lock:
            in_time = pending.complete
            pending.complete = True
        return in_time

    def release(self, pending: Pending) -> None:
        """Let the next command have the slot."""
        with self._lock:
            self._pending = None
        pending.released.set()

    def offer(self, frame: bytes) -> bool:
        """Whether the waiting command takes a frame; on the reader's thread.

        Raises:
            MvpCellError: what ``accept`` raised.
        """
        with self._lock:
            pending = self._pending
        if pending is None or pending.complete:
            return False
        take = pending.accept(frame)
        if take is Take.OTHER:
            return False
        with self._lock:
            if take is Take.ALIVE:
                pending.deadline_s = self._clock.now_s() + pending.timeout_s
            elif not pending.complete:
                pending.frames.append(frame)
                pending.complete = take is Take.DONE
        return True

    def fail(self, error: MvpCellError) -> bool:
        """End the waiting command with an error; False when none waits. Any thread."""
        with self._lock:
            pending = self._pending
            if pending is None or pending.complete:
                return False
            pending.error = error
            pending.complete = True
            return True

    def settle(self) -> None:
        """Wake the thread of a command that is complete.

        Only after all frames that came together were offered: a second copy of an
        answer must not meet the next command.
        """
        with self._lock:
            if self._pending is not None and self._pending.complete:
                self._pending.ended.set()
