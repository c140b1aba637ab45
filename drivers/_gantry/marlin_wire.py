"""Marlin 2: every line is answered by ``ok``, in order; lines carry a checksum.

Arrival is the answer to ``M400``, during which ``busy`` lines are signs of life. The
software end-stops clamp without a word, so the position is compared with the target.
Nothing can be asked while it moves; the only stop is ``M410``, after which the position
is doubtful.
"""

from __future__ import annotations

import logging
import math
import re
import threading
from typing import TYPE_CHECKING

from drivers._gantry.wire import Activity, Identity, Report
from mvp.devices import LineFramer, Session, Take, text
from mvp.errors import (
    ConnectError,
    DeviceError,
    DeviceFault,
    DeviceTimeout,
    MotionStopped,
    WireError,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivers._gantry.config import GantryConfig
    from mvp.devices import Accept, Ask, DeviceContext, Finding

_LOG = logging.getLogger(__name__)
_OK = re.compile(r"ok\b")
_PLACE = re.compile(r"([XYZABCUVW]):(-?\d{1,7}(?:\.\d{1,6})?)(?![\d.])")
_RESEND = re.compile(r"Resend:\s*(\d+)")
_SENT_AGAIN = 3
_GREETING_S = 1.0  # a board that is still starting swallows the question
_QUICK_STOP_S = 10.0
_LOOK_S = 0.05  # how often a question that waits looks whether a motion has begun
_NO_STOP = (
    "no: its firmware has no emergency parser, a stop acts when the move has ended"
)
_NOBODY = "cede2a2f-41a2-4748-9b12-c55c62f367ff"  # of boards that got no name


class _Damaged(WireError):
    """The line did not arrive as it was sent; it was not executed."""


class MarlinWire:
    """Conversation with one board.

    Args:
        config: port, axes, whether lines are numbered.
        context: clock, links, where traffic is written after a fault.
        name: of the device.
        on_home_lost: told when the position is not known any more.
        stopping: set while a motion shall end; no further line of it is sent then.
    """

    alarm = None  # a board that has halted answers with an error instead
    doubts: tuple[Finding, ...] = ()

    def __init__(
        self,
        config: GantryConfig,
        context: DeviceContext,
        name: str,
        *,
        on_home_lost: Callable[[str], None],
        stopping: threading.Event,
    ) -> None:
        self._name = name
        self._stopping = stopping
        self._config = config
        self._on_home_lost = on_home_lost
        self._number = 0
        self._asking = threading.RLock()
        self._doing = ""
        self._halted = ""
        self.can_stop = "yes"
        self._last: Report | None = None
        self.session = Session(
            context.transports(config, name),
            LineFramer(),
            clock=context.clock,
            on_push=self._pushed,
            sync=self._sync,
            on_lost=lambda error: on_home_lost("the link was lost"),
            strip_echo=config.strip_echo,
            dump_folder=context.dump_folder,
        )

    def open(self) -> Identity:
        """Connect and ask who is there. Moves nothing.

        Raises:
            ConnectError: nobody answers, or it is no Marlin.
        """
        self._halted = self._doing = ""
        self.session.open()
        try:
            lines = self.session.request_until(
                b"M115\n",
                self._listing(),
                timeout_s=min(self._config.answer_s, _GREETING_S),
                patience_s=self._config.identify_s,
            )
        except DeviceTimeout as error:
            raise ConnectError(
                "no Marlin answers on this port",
                device=self._name,
                hint="is it switched on, and is this the right port and speed?",
            ) from error
        said = " ".join(text(line) for line in lines)
        found = re.search(r"FIRMWARE_NAME:\s*(\S+(?:\s+[\d.]+)?)", said)
        if found is None:
            raise ConnectError(
                "it gives no firmware name: this is no Marlin",
                device=self._name,
                hint="check port and firmware",
            )
        self.can_stop = "yes" if "EMERGENCY_PARSER:1" in said else _NO_STOP
        if self.can_stop == _NO_STOP:
            _LOG.warning("%s: can stop: %s", self._name, _NO_STOP)
        self._renumber()
        self._order("G21")
        self._order("G90")
        self.report()
        called = re.search(r"UUID:\s*([0-9a-fA-F-]{36})", said)
        uuid = called[1].lower() if called else ""
        return Identity("marlin", found[1], "" if uuid == _NOBODY else uuid)

    def report(self) -> Report:
        """The planned end of the queue when it stands; the last one while it moves.

        Raises:
            DeviceFault: the board has halted.
            DeviceTimeout, WireError, LinkLost: no sensible answer.
        """
        moving = self._moving()
        if moving is not None:
            return moving
        self._refuse_when_halted()
        for _ in range(math.ceil(self._config.answer_s / _LOOK_S)):
            if self._asking.acquire(timeout=_LOOK_S):
                break
            # A motion has begun meanwhile, and nothing can be asked before its end.
            moving = self._moving()
            if moving is not None:
                return moving
        else:
            raise DeviceTimeout("is busy with another question", device=self._name)
        try:
            return self._moving() or self._place()
        finally:
            self._asking.release()

    def _moving(self) -> Report | None:
        """The last known place while a motion of ours is under way."""
        if not self._doing or self._last is None:
            return None
        return Report(Activity.MOVES, self._last.machine, None, self._doing)

    def _place(self) -> Report:
        frames = self._ask("M114")
        places: dict[str, float] = {}
        for frame in frames:
            before_count = text(frame).split("Count")[0]
            places |= {axis: float(v) for axis, v in _PLACE.findall(before_count)}
        missing = [a.letter for a in self._config.axes if a.letter not in places]
        if missing:
            raise WireError(
                f"its position has no {', '.join(missing)}",
                device=self._name,
                hint="does the firmware have that axis?",
            )
        self._last = Report(Activity.STANDS, places, None, "idle")
        return self._last

    def home(self, *, timeout_s: float) -> None:
        """``G28`` of the axes that have a switch.

        Raises:
            DeviceFault: a switch was not found; the board has halted.
            MotionStopped: ``halt`` was called.
        """
        self._refuse_when_halted()
        letters = [a.letter for a in self._config.axes if not a.declared]
        self._motion("homing", "G28 " + " ".join(letters), timeout_s)
        self._motion("homing", "M400", timeout_s)

    def move(self, words: str, *, feed_min: float, timeout_s: float) -> None:
        """One straight move.

        Raises:
            DeviceFault: refused, or the board has halted.
            DeviceTimeout: it still moves.
            MotionStopped: ``halt`` was called.
        """
        self._refuse_when_halted()
        self._order("G90")
        self._motion("moving", f"G1 {words} F{feed_min:.1f}")
        self._motion("moving", "M400", timeout_s)

    def halt(self) -> None:
        """``M410``; at once where the board reads ahead, else when its turn comes."""
        self.session.send(b"M410\n")
        self.session.abort(self._stopped(), in_step=False)

    def settle_halt(self) -> bool:
        """Wait for quiet; the position is doubtful after a quick stop."""
        self._doing = ""
        self.session.fall_out_of_step()
        try:
            self._order("M400", _QUICK_STOP_S)
        except DeviceError as error:
            _LOG.warning("%s: %s", self._name, error.detail)
        return False

    def reset_steps(self) -> list[tuple[str, Callable[[], str]]]:
        """A halted board wakes up only when it is switched off and on."""
        if not self._halted:
            return []
        return [
            (
                f"The board has halted ({self._halted}). Look what it touched, then "
                "switch it off and on.",
                self._person_restarts,
            )
        ]

    # ------------------------------------------------------------ lines

    def _motion(self, doing: str, line: str, timeout_s: float | None = None) -> None:
        """A line of a motion, unless that shall end.

        A stop that came between two lines was too early: it is told again.
        """
        if self._stopping.is_set():
            raise self._stopped()
        self._doing = doing
        self._order(line, timeout_s)
        if self._stopping.is_set():
            self.halt()
            raise self._stopped()
        self._doing = ""  # after an error ``settle_halt`` still has to know

    def _stopped(self) -> MotionStopped:
        return MotionStopped("stopped while it moved", device=self._name)

    def _order(self, line: str, timeout_s: float | None = None) -> None:
        self._ask(line, timeout_s)

    def _ask(self, line: str, timeout_s: float | None = None) -> tuple[bytes, ...]:
        """Send a line until it has arrived whole; what was damaged was not executed."""
        with self._asking:  # line numbers follow each other
            return self._asked(line, timeout_s)

    def _asked(self, line: str, timeout_s: float | None) -> tuple[bytes, ...]:
        limit = self._config.answer_s if timeout_s is None else timeout_s
        for tries_left in reversed(range(_SENT_AGAIN + 1)):
            self._number += 1
            try:
                return self.session.request(
                    self._framed(line),
                    lambda frame: self._is_ok(line, frame),
                    timeout_s=limit,
                )
            except _Damaged as error:
                _LOG.warning("%s: %s", self._name, error.detail)
                if self._doing and self._stopping.is_set():
                    raise self._stopped() from error
                if not tries_left:
                    raise
                self._renumber()
        raise RuntimeError("unreachable")

    def _framed(self, line: str) -> bytes:
        if not self._config.number_lines:
            return f"{line}\n".encode("ascii")
        return numbered(self._number, line)

    def _renumber(self) -> None:
        """Begin to count lines anew."""
        self._number = 0
        if self._config.number_lines:
            self.session.request(
                numbered(0, "M110 N0"),
                lambda frame: self._is_ok("M110", frame),
                timeout_s=self._config.answer_s,
            )

    def _is_ok(self, line: str, frame: bytes) -> Take:
        said = text(frame).strip()
        if _OK.match(said):
            return Take.DONE
        if said.startswith(("echo:busy", "busy")):
            return Take.PART  # a sign of life; the deadline stays
        if _RESEND.match(said):
            self.session.fall_out_of_step()
            raise _Damaged(f"{line!r} arrived damaged", device=self._name)
        if said.startswith("Error:") and "Last Line" in said:
            return Take.PART
        if said.startswith("echo:Unknown command"):
            self.session.fall_out_of_step()
            raise DeviceFault(
                f"does not know {line!r}",
                device=self._name,
                code="unknown command",
                hint="is the firmware built with this axis and code?",
            )
        return Take.PART if _PLACE.search(said) else Take.OTHER

    def _listing(self) -> Accept:
        """Takes the lines of ``M115`` up to their ``ok``; an earlier one is stale."""
        named = False

        def accept(frame: bytes) -> Take:
            nonlocal named
            said = text(frame).strip()
            if _OK.match(said):
                return Take.DONE if named else Take.OTHER
            named = named or said.startswith("FIRMWARE_NAME")
            known = said.startswith(("FIRMWARE_NAME", "Cap:"))
            return Take.PART if known else Take.OTHER

        return accept

    def _sync(self, ask: Ask) -> None:
        ask(b"M115\n", self._listing(), timeout_s=self._config.answer_s)

    # ------------------------------------------------------------ unasked

    def _pushed(self, frame: bytes) -> bool:
        """Everything that is no answer; on the reader's thread."""
        said = text(frame).strip()
        if said == "start":
            self._on_home_lost("the board restarted")
            if self._doing:
                raise DeviceFault(
                    "the board restarted; everything queued is lost",
                    device=self._name,
                    code="start",
                    hint="check its supply, then home it again",
                )
        if said.startswith("Error:") and "Last Line" not in said:
            self._fail(said)
        known = ("echo:", "start", "Error:", "//", "Cap:", "X:")
        return not said or said.startswith(known)

    def _fail(self, said: str) -> None:
        self._halted = said.removeprefix("Error:").strip()[:120]
        self._on_home_lost(self._halted)
        raise DeviceFault(
            f"the board has halted: {self._halted}",
            device=self._name,
            code=self._halted[:60],
            hint="look what it touched, switch it off and on, then home it again",
        )

    def _refuse_when_halted(self) -> None:
        if self._halted:
            raise DeviceFault(
                f"the board has halted: {self._halted}",
                device=self._name,
                code=self._halted[:60],
                hint="switch it off and on; `mvp-cell recover CELL` walks the way back",
            )

    def _person_restarts(self) -> str:
        self.session.close()
        identity = self.open()
        return f"{identity.version} answers; home it before anything else moves"


def numbered(number: int, line: str) -> bytes:
    """A line with its number and its checksum."""
    body = f"N{number} {line}".encode("ascii")
    check = 0
    for byte in body:
        check ^= byte
    return body + b"*%d\n" % check
