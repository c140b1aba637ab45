"""GRBL 1.1, grblHAL and FluidNC: one line, one answer; everything else unasked.

``ok`` means queued. Arrival is the answer to ``G4 P0``, which waits for the queue to be
empty, and a status report that says so. There is no checksum: where the axes stand is
compared with where they were sent.
"""

from __future__ import annotations

import logging
import threading
from typing import TYPE_CHECKING

from drivers._gantry.arrivals import Arrivals
from drivers._gantry.codes import alarm_fault, loses_home
from drivers._gantry.grbl_identity import (
    error_number,
    identity_of,
    listing,
)
from drivers._gantry.grbl_orders import GrblOrders
from drivers._gantry.grbl_report import ReportReader
from drivers._gantry.grbl_settings import settings_doubts
from drivers._gantry.homing import beside_slides
from drivers._gantry.wire import Activity, Identity, Report
from mvp.devices import LineFramer, Session, text
from mvp.errors import (
    ConnectError,
    DeviceError,
    DeviceFault,
    DeviceTimeout,
    MotionStopped,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivers._gantry.config import GantryConfig
    from mvp.devices import Ask, DeviceContext, Finding

_LOG = logging.getLogger(__name__)
_HOLD, _HAL_HOLD, _RESET, _QUERY, _HAL_FULL = b"!", b"\x82", b"\x18", b"?", b"\x87"
_BANNER_S = 5.0
_GREETING_S = 2.0
_BRAKING_S = 5.0
_POLL_S = 0.03


class GrblWire:
    """Conversation with one controller.

    Attributes:
        doubts: what about its settings somebody should look at.

    Args:
        config: port, dialect, axes.
        context: clock, links, where traffic is written after a fault.
        name: of the device.
        on_home_lost: told when the position is not known any more.
        stopping: set while a motion shall end; no further line of it is sent then.
    """

    def __init__(
        self,
        config: GantryConfig,
        context: DeviceContext,
        name: str,
        *,
        on_home_lost: Callable[[str], None],
        stopping: threading.Event,
    ) -> None:
        self.doubts: tuple[Finding, ...] = ()
        self._name = name
        self._stopping = stopping
        self._config = config
        self._clock = context.clock
        self._on_home_lost = on_home_lost
        self._reader = ReportReader("")
        self._came = Arrivals(context.clock)
        self._never = threading.Event()
        self._alarm: int | None = None
        self._doing = ""
        self._ended: DeviceError | None = None
        self._expects_banner = False
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
        self._orders = GrblOrders(self.session, config, name)

    can_stop = "yes"

    @property
    def alarm(self) -> DeviceFault | None:
        """The alarm that stands; None for none that was seen to come."""
        if self._alarm is None:
            return None
        return alarm_fault(self._alarm, self._config.firmware, self._name)

    def open(self) -> Identity:
        """Connect, ask who is there and which axes it has. Moves nothing.

        Raises:
            ConnectError: nobody answers, or the machine is another one.
        """
        self._alarm = None
        self._doing = ""
        self._came.forget()
        self._reader = ReportReader("")
        self._expects_banner = True
        self.session.open()
        try:
            self._greet()
            self._let_go()
            lines = self.session.request_until(
                b"$I\n",
                listing("[VER", self._name),
                timeout_s=min(self._config.answer_s, _GREETING_S),
                patience_s=self._config.identify_s,
            )
            found = identity_of(lines, self._config, self._name)
            self._reader = ReportReader(found.letters)
            self.doubts = settings_doubts(
                self.session, self._config, found.letters, self._name
            )
        except DeviceTimeout as error:
            raise ConnectError(
                "no GRBL answers on this port",
                device=self._name,
                hint="is it switched on, and is this the right port and speed?",
            ) from error
        finally:
            self._expects_banner = False
        self._ask_homed()
        self.report()
        return Identity(self._config.firmware, found.version, found.user_text)

    def _greet(self) -> None:
        """Boards that restart when the port opens say so; others answer at once."""
        self._came.next_sign(lambda: self.session.send(_QUERY), _GREETING_S)

    def _let_go(self) -> None:
        """Give up a motion that was held when an earlier connection ended.

        A controller in a feed hold answers no line, not even who it is. It stands: a
        reset moves nothing and keeps the position, and nobody can resume that motion.
        """
        last = self._came.last
        if last is None or not last.state.startswith("Hold"):
            return
        if not self._stands() or not self._reset():
            raise ConnectError(
                f"the controller is in a feed hold ({last.state}) and does not leave it",
                device=self._name,
                hint="release the hold button if it has one, or switch it off and on",
            )
        _LOG.warning(
            "%s: it was held in a motion, whose rest is given up; nothing moved",
            self._name,
        )

    def report(self) -> Report:
        """Where it is now; asked past whatever waits for its answer.

        Raises:
            DeviceFault: an alarm stands and it does not answer.
            DeviceTimeout, LinkLost, ConnectError: no report.
        """
        report = self._came.next_report(
            lambda: self.session.send(_QUERY),
            lambda: self.session.is_lost,
            self._config.answer_s,
        )
        if report is not None:
            return report
        if alarm := self.alarm:
            raise alarm
        raise DeviceTimeout(
            f"no status within {self._config.answer_s:g} s",
            device=self._name,
            hint="is it homing, or switched off?",
        )

    def home(self, *, timeout_s: float) -> None:
        """``$H``: long silence, then ``ok``; it may mean X, Y and Z only.

        Axes beside these are homed one by one: the answer then speaks of that axis.

        Raises:
            DeviceFault: an alarm stands, or a switch was not found.
            MotionStopped: ``halt`` was called; the position is lost.
        """
        self._begin()
        end_s = self._clock.now_s() + timeout_s
        self._reader.forget_homed()
        for letter in ("", *beside_slides(self._config.axes)):
            left_s = max(end_s - self._clock.now_s(), 0.0)
            self._motion("homing", f"$H{letter}", left_s)
        self._ask_homed()

    def _ask_homed(self) -> None:
        """GrblHAL says in its full report which axes it has homed, else when it changes."""
        if self._config.firmware == "grblhal":
            self.session.send(_HAL_FULL)

    def move(self, words: str, *, feed_min: float, timeout_s: float) -> None:
        """One straight move in machine coordinates.

        Raises:
            DeviceFault, LimitError: refused, or ended by an alarm.
            DeviceTimeout: it still moves.
            MotionStopped: ``halt`` was called.
        """
        self._begin()
        self._orders.give("G21 G90 G94")
        self._motion("moving", f"G53 G1 {words} F{feed_min:.1f}")
        self._motion("moving", "G4 P0", timeout_s)

    def halt(self) -> None:
        """Feed hold, or a reset where a hold does nothing; one byte, from any thread."""
        if self._doing == "homing":
            self.session.send(_RESET)
        else:
            hal = self._config.firmware == "grblhal"
            self.session.send(_HAL_HOLD if hal else _HOLD)
        self.session.abort(self._stopped(), in_step=False)

    def settle_halt(self) -> bool:
        """Wait until it stands, then reset, which keeps the position."""
        stands = self._stands()
        self._doing = ""
        if not stands:
            return False
        last = self._came.last
        if last is not None and last.activity is Activity.HELD:
            self._reset()
        self.session.fall_out_of_step()
        return self._alarm is None or not loses_home(self._alarm)

    def reset_steps(self) -> list[tuple[str, Callable[[], str]]]:
        """A reset, when an alarm stands or it is held; nothing moves by it."""
        if self._alarm is None and self._quiet_state() not in ("alarm", "held"):
            return []
        known = alarm_fault(self._alarm or 0, self._config.firmware, self._name)
        what = f"It is stopped ({known.code})." if self._alarm else "It is locked."
        return [
            (
                f"{what} Look what it touched and free it by hand if need be. The "
                "controller is reset then; nothing moves.",
                self._person_resets,
            )
        ]

    # ------------------------------------------------------------ asking

    def _motion(self, doing: str, line: str, timeout_s: float | None = None) -> None:
        """A line of a motion, unless that shall end.

        A stop that came between two lines was one byte to a machine at rest: it is
        told again, now that the line has been read. An alarm between two lines failed
        no command: it explains why the next one was refused.
        """
        if self._stopping.is_set():
            raise self._stopped()
        self._doing = doing
        try:
            self._orders.give(line, timeout_s)
            if self._stopping.is_set():
                self.halt()
                raise self._stopped()
        except DeviceError as error:
            if self._ended is None or error is self._ended:
                raise
            raise self._ended from error
        self._doing = ""  # after an error ``settle_halt`` still has to know

    def _stopped(self) -> MotionStopped:
        return MotionStopped("stopped while it moved", device=self._name)

    def _sync(self, ask: Ask) -> None:
        ask(b"$I\n", listing("[VER", self._name), timeout_s=self._config.answer_s)

    # ------------------------------------------------------------ unasked

    def _pushed(self, frame: bytes) -> bool:
        """Everything that is no answer; on the reader's thread."""
        said = text(frame).strip()
        report = self._reader.read(said)
        if report is not None:
            self._came.report(report)
        if said.startswith("<") or said.lower().startswith("grbl"):
            self._came.sign()  # whoever waits for it finds the report
        if report is not None:
            return True
        if said.startswith("ALARM:"):
            self._alarmed(error_number(said))
        if said.lower().startswith("grbl"):
            self._restarted(said)
        return not said or said[0] in "[>$" or said.lower().startswith("grbl")

    def _alarmed(self, number: int) -> None:
        self._alarm = number
        if loses_home(number):
            self._on_home_lost(f"alarm {number}")
        raise self._end(alarm_fault(number, self._config.firmware, self._name))

    def _end(self, fault: DeviceFault) -> DeviceError:
        """What ended the motion; nothing but the stop, when that was asked for."""
        if self._ended is None:
            self._ended = self._stopped() if self._stopping.is_set() else fault
        return self._ended

    def _restarted(self, said: str) -> None:
        """The banner: everything queued is lost."""
        self._reader.forget()
        self._alarm = None
        expected = self._expects_banner
        self._came.banner()
        if expected:
            return
        self._on_home_lost("the controller restarted")
        raise self._end(
            DeviceFault(
                "the controller restarted; everything queued is lost",
                device=self._name,
                code=said[:40],
                hint="check its supply, then home it again",
            )
        )

    # ------------------------------------------------------------ stopping

    def _begin(self) -> None:
        """A new motion, unless an alarm stands."""
        self._ended = None
        if alarm := self.alarm:
            raise alarm

    def _stands(self) -> bool:
        """Wait for the end of the braking; False when it cannot be seen."""
        until = self._clock.now_s() + _BRAKING_S
        while self._clock.now_s() < until:
            try:
                if self.report().activity is not Activity.MOVES:
                    return True
            except DeviceError as error:
                _LOG.warning("%s: %s", self._name, error.detail)
                return False
            self._clock.wait(self._never, _POLL_S)
        return False

    def _reset(self) -> bool:
        """Byte 18, and wait for the banner."""
        before, self._expects_banner = self._expects_banner, True
        try:
            return self._came.next_banner(lambda: self.session.send(_RESET), _BANNER_S)
        finally:
            self._expects_banner = before

    def _quiet_state(self) -> str:
        try:
            return self.report().activity.value
        except DeviceFault:
            return "alarm"

    def _person_resets(self) -> str:
        came = self._reset()
        if not came:
            raise DeviceTimeout(
                "did not restart",
                device=self._name,
                hint="switch it off and on",
            )
        self._alarm = None
        self.session.fall_out_of_step()
        self._on_home_lost("it was reset")
        return "the controller was reset; home it before anything else moves"
