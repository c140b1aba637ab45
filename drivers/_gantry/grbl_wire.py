"""GRBL 1.1, grblHAL and FluidNC: one line, one answer; everything else unasked.

``ok`` means queued. Arrival is the answer to ``G4 P0``, which waits for the queue to be
empty, and a status report that says so. There is no checksum: where the axes stand is
compared with where they were sent.
"""

from __future__ import annotations

import logging
import re
import threading
from typing import TYPE_CHECKING

from drivers._gantry.codes import alarm_fault, line_error, loses_home
from drivers._gantry.grbl_report import ReportReader
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
    from contextlib import AbstractContextManager

    from drivers._gantry.config import GantryConfig
    from mvp.devices import Accept, Ask, DeviceContext

_LOG = logging.getLogger(__name__)
_HOLD, _HAL_HOLD, _RESET, _QUERY = b"!", b"\x82", b"\x18", b"?"
_VERSION = re.compile(r"\[VER:([^\]]*)\]")
_AXES = re.compile(r"\[AXS:\d+:([XYZABCUVW]+)\]")
_SETTING = re.compile(r"\$(\d{1,3})=(-?[\d.]+)")
_NOT_IDLE = 8
_BANNER_S = 5.0
_BRAKING_S = 5.0
_POLL_S = 0.03


class GrblWire:
    """Conversation with one controller.

    Args:
        config: port, dialect, axes.
        context: clock, links, where traffic is written after a fault.
        name: of the device.
        on_home_lost: told when the position is not known any more.
    """

    def __init__(
        self,
        config: GantryConfig,
        context: DeviceContext,
        name: str,
        *,
        on_home_lost: Callable[[str], None],
    ) -> None:
        self._name = name
        self._config = config
        self._clock = context.clock
        self._on_home_lost = on_home_lost
        self._reader = ReportReader("XYZ")
        self._changed = threading.Condition()
        self._never = threading.Event()
        self._last: Report | None = None
        self._reports = 0
        self._banners = 0
        self._alarm: int | None = None
        self._doing = ""
        self._expects_banner = False
        self._session = Session(
            context.transports(config, name),
            LineFramer(),
            clock=context.clock,
            on_push=self._pushed,
            sync=self._sync,
            on_lost=lambda error: on_home_lost("the link was lost"),
            strip_echo=config.strip_echo,
            dump_folder=context.dump_folder,
        )

    @property
    def address(self) -> str:
        """Where the link leads."""
        return self._session.address

    @property
    def is_lost(self) -> bool:
        """Whether the link has broken."""
        return self._session.is_lost

    def open(self) -> Identity:
        """Connect, ask who is there and which axes it has. Moves nothing.

        Raises:
            ConnectError: nobody answers, or the machine is another one.
        """
        self._alarm, self._last = None, None
        self._expects_banner = True
        self._session.open()
        try:
            lines = self._session.request_until(
                b"$I\n",
                self._listing("[VER"),
                timeout_s=self._config.answer_s,
                patience_s=self._config.identify_s,
            )
            version = self._understood([text(line) for line in lines])
            self._check_settings()
        except DeviceTimeout as error:
            raise ConnectError(
                "no GRBL answers on this port",
                device=self._name,
                hint="is it switched on, and is this the right port and speed?",
            ) from error
        finally:
            self._expects_banner = False
        self.report()
        return Identity(self._config.firmware, version)

    def close(self) -> None:
        """Disconnect."""
        self._session.close()

    def report(self) -> Report:
        """Where it is now; asked past whatever waits for its answer.

        Raises:
            DeviceFault: an alarm stands and it does not answer.
            DeviceTimeout, LinkLost, ConnectError: no report.
        """
        with self._changed:
            before = self._reports
        self._session.send(_QUERY)
        with self._changed:
            self._changed.wait_for(
                lambda: self._reports != before or self._session.is_lost,
                timeout=self._config.answer_s,
            )
            if self._reports != before and self._last is not None:
                return self._last
        if self._alarm is not None:
            raise alarm_fault(self._alarm, self._config.firmware, self._name)
        raise DeviceTimeout(
            f"no status within {self._config.answer_s:g} s",
            device=self._name,
            hint="is it homing, or switched off?",
        )

    def home(self, *, timeout_s: float) -> None:
        """``$H``: long silence, then ``ok``.

        Raises:
            DeviceFault: an alarm stands, or a switch was not found.
            MotionStopped: ``halt`` was called; the position is lost.
        """
        self._refuse_in_alarm()
        self._during("homing", "$H", timeout_s)

    def move(self, words: str, *, feed_min: float, timeout_s: float) -> None:
        """One straight move in machine coordinates.

        Raises:
            DeviceFault, LimitError: refused, or ended by an alarm.
            DeviceTimeout: it still moves.
            MotionStopped: ``halt`` was called.
        """
        self._refuse_in_alarm()
        self._order("G21 G90 G94")
        self._doing = "moving"
        try:
            self._order(f"G53 G1 {words} F{feed_min:.1f}")
            self._order("G4 P0", timeout_s)
        finally:
            self._doing = ""

    def halt(self) -> None:
        """Feed hold, or a reset where a hold does nothing; one byte, from any thread."""
        if self._doing == "homing":
            self._session.send(_RESET)
        else:
            hal = self._config.firmware == "grblhal"
            self._session.send(_HAL_HOLD if hal else _HOLD)
        stopped = MotionStopped("stopped while it moved", device=self._name)
        self._session.abort(stopped, in_step=False)

    def settle_halt(self) -> bool:
        """Wait until it stands, then reset, which keeps the position."""
        if not self._stands():
            return False
        if self._last is not None and self._last.activity is Activity.HELD:
            self._reset()
        self._session.fall_out_of_step()
        return self._alarm is None

    def dumping(self) -> AbstractContextManager[None]:
        """Write the traffic down when a device error passes."""
        return self._session.dumping()

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

    def _during(self, doing: str, line: str, timeout_s: float) -> None:
        self._doing = doing
        try:
            self._order(line, timeout_s)
        finally:
            self._doing = ""

    def _order(self, line: str, timeout_s: float | None = None) -> None:
        """Send a line and wait for its ``ok``."""
        try:
            self._session.request(
                f"{line}\n".encode("ascii"),
                lambda frame: self._is_ok(line, frame),
                timeout_s=self._config.answer_s if timeout_s is None else timeout_s,
            )
        except DeviceError:
            if self._config.firmware == "grblhal" and self._refused:
                self._clear_refusal()
            raise

    _refused = False

    def _clear_refusal(self) -> None:
        """GrblHAL refuses every G-code after an error, until an empty line."""
        self._refused = False
        try:
            self._session.request(
                b"\n", lambda f: self._is_ok("", f), timeout_s=self._config.answer_s
            )
        except DeviceError as error:
            _LOG.warning("%s: %s", self._name, error.message)

    def _is_ok(self, line: str, frame: bytes) -> Take:
        said = text(frame).strip()
        if said == "ok":
            return Take.DONE
        if said.startswith("error:"):
            self._refused = True
            raise line_error(_number(said), line, self._name)
        return Take.OTHER

    def _listing(self, head: str) -> Accept:
        """Takes lines up to their ``ok``; one before the first line is stale."""
        begun = False

        def accept(frame: bytes) -> Take:
            nonlocal begun
            said = text(frame).strip()
            if said.startswith("error:"):
                raise self._no_listing(said)
            if said == "ok":
                return Take.DONE if begun else Take.OTHER
            begun = begun or said.startswith(head)
            known = said.startswith(("[VER", "[OPT", "[AXS", "$"))
            return Take.PART if known else Take.OTHER

        return accept

    def _no_listing(self, said: str) -> DeviceError:
        if _number(said) != _NOT_IDLE:
            return WireError(f"answers {said} to a question", device=self._name)
        return ConnectError(
            "it is moving or held already",
            device=self._name,
            hint="wait until it stands, or stop whatever else drives it",
        )

    def _sync(self, ask: Ask) -> None:
        ask(b"$I\n", self._listing("[VER"), timeout_s=self._config.answer_s)

    def _understood(self, lines: list[str]) -> str:
        """The version; the axes must be those that are configured.

        Raises:
            ConnectError: an axis is missing, or there is no version.
        """
        versions = [m[1] for line in lines if (m := _VERSION.search(line))]
        if not versions:
            raise ConnectError(
                "it gives no version: this is no GRBL",
                device=self._name,
                hint="check port and firmware",
            )
        letters = next((m[1] for x in lines if (m := _AXES.search(x))), "XYZ")
        missing = [a.letter for a in self._config.axes if a.letter not in letters]
        if missing:
            raise ConnectError(
                f"it has the axes {letters}; {', '.join(missing)} of the "
                "configuration is not among them",
                device=self._name,
                hint="correct [[arm.axes]], or use a firmware with that axis",
            )
        self._reader = ReportReader(letters)
        return versions[0].strip(":")

    def _check_settings(self) -> None:
        """Inches would be taken for millimetres."""
        lines = self._session.request_until(
            b"$$\n", self._listing("$"), timeout_s=self._config.answer_s, tries=3
        )
        found = dict(
            m.groups() for line in lines if (m := _SETTING.match(text(line).strip()))
        )
        if float(found.get("13") or 0) != 0:
            raise ConnectError(
                "it reports in inches ($13=1)",
                device=self._name,
                hint="set $13=0 on the machine; this program writes no settings",
            )

    # ------------------------------------------------------------ unasked

    def _pushed(self, frame: bytes) -> bool:
        """Everything that is no answer; on the reader's thread."""
        said = text(frame).strip()
        report = self._reader.read(said)
        if report is not None:
            self._keep(report)
            return True
        if said.startswith("ALARM:"):
            self._alarmed(_number(said))
        if said.lower().startswith("grbl"):
            self._restarted(said)
        return not said or said[0] in "[>$" or said.lower().startswith("grbl")

    def _keep(self, report: Report) -> None:
        with self._changed:
            self._last = report
            self._reports += 1
            self._changed.notify_all()

    def _alarmed(self, number: int) -> None:
        with self._changed:
            self._alarm = number
            self._changed.notify_all()
        if loses_home(number):
            self._on_home_lost(f"alarm {number}")
        raise alarm_fault(number, self._config.firmware, self._name)

    def _restarted(self, said: str) -> None:
        """The banner: everything queued is lost."""
        self._reader.forget()
        with self._changed:
            self._banners += 1
            expected = self._expects_banner
            self._changed.notify_all()
        if expected:
            return
        self._on_home_lost("the controller restarted")
        raise DeviceFault(
            "the controller restarted; everything queued is lost",
            device=self._name,
            code=said[:40],
            hint="check its supply, then home it again",
        )

    # ------------------------------------------------------------ stopping

    def _refuse_in_alarm(self) -> None:
        if self._alarm is not None:
            raise alarm_fault(self._alarm, self._config.firmware, self._name)

    def _stands(self) -> bool:
        """Wait for the end of the braking; False when it cannot be seen."""
        until = self._clock.now_s() + _BRAKING_S
        while self._clock.now_s() < until:
            try:
                if self.report().activity is not Activity.MOVES:
                    return True
            except DeviceError as error:
                _LOG.warning("%s: %s", self._name, error.message)
                return False
            self._clock.wait(self._never, _POLL_S)
        return False

    def _reset(self) -> bool:
        """Byte 18, and wait for the banner."""
        with self._changed:
            before = self._banners
            self._expects_banner = True
        try:
            self._session.send(_RESET)
            with self._changed:
                came = self._changed.wait_for(
                    lambda: self._banners != before, timeout=_BANNER_S
                )
        finally:
            self._expects_banner = False
        return came

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
        self._session.fall_out_of_step()
        self._on_home_lost("it was reset")
        return "the controller was reset; home it before anything else moves"


def _number(said: str) -> int:
    digits = re.search(r":\s*(\d{1,4})", said)
    return int(digits[1]) if digits else 0
