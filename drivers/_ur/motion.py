"""One motion, watched from outside: begun once, never again, and stopped when in doubt."""

from __future__ import annotations

import logging
import threading
from typing import TYPE_CHECKING

import numpy as np

from drivers._ur.codes import Trouble, motion_trouble, trouble, unended
from mvp.errors import DeviceError, DeviceFault, DeviceTimeout, LinkLost, MotionStopped

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivers._ur.process import Pending
    from drivers._ur.session import Session
    from drivers._ur.status import Status
    from mvp.devices import Clock, Link
    from mvp.geometry import FloatArray

_LOG = logging.getLogger(__name__)
_FRESH_S = 0.1
_PATIENCE_S = 1.0
_LAG_S = 0.3
_POLL_S = 0.01
_STANDS_FRAMES = 3


class Motions:
    """Carries out motions of one robot, one at a time.

    Args:
        session: the connection.
        link: knows whether somebody has called ``stop``.
        clock: real time.
    """

    def __init__(self, session: Session, link: Link, clock: Clock) -> None:
        self._session = session
        self._link = link
        self._clock = clock
        self._name = session.name
        self._config = session.config
        self._never = threading.Event()

    def ready(self) -> Status:
        """The state to start a motion from.

        Raises:
            LinkLost, DeviceTimeout: no current data.
            DeviceFault: the robot would not, or should not, move.
        """
        status = self._fresh()
        found = motion_trouble(status)
        if found is None and status.slider <= 0:
            found = trouble("speed-slider-zero")
        if found is None and self._session.payload_differs(status):
            found = trouble("tool-changed", "payload")
        if found is not None:
            raise found.fault(self._name)
        return status

    def carry_out(
        self,
        target: FloatArray,
        speed_rad_s: float,
        deadline_s: float,
        *,
        stopped: Callable[[], bool],
    ) -> Status:
        """Move, and return the state at the target.

        Args:
            target: (6,) joints, rad.
            speed_rad_s: of the leading axis.
            deadline_s: on the clock.
            stopped: whether a stop has come since the motion was asked for.

        Raises:
            MotionStopped, DeviceTimeout, DeviceFault, LinkLost: it is not there; it has
                been stopped by every way that is left.
        """
        asked = target.tolist()

        def begin() -> Pending:
            if stopped():
                raise MotionStopped("stopped before it moved", device=self._name)
            return self._session.move(asked, speed_rad_s)

        with self._link.busy(begin) as pending:
            try:
                self._follow(pending, deadline_s)
                return self._arrived(target)
            except (LinkLost, DeviceTimeout) as error:
                if self._session.alive:
                    raise
                raise self._lost(error) from error

    def _fresh(self) -> Status:
        """A state of the last 100 ms; after some patience a staler one, with a warning."""
        deadline_s = self._clock.now_s() + _PATIENCE_S
        while self._session.age_s() > _FRESH_S:
            if self._clock.now_s() > deadline_s:
                age_s = self._session.age_s()
                _LOG.warning("%s: data are %.0f ms old", self._name, 1000 * age_s)
                break
            self._pause()
        return self._session.status()

    def _follow(self, pending: Pending, deadline_s: float) -> None:
        """Watch a motion until it has ended by itself."""
        while not pending.arrived.wait(_POLL_S):
            if self._link.interrupted:
                self._end_stopped(pending)
            if found := motion_trouble(self._session.status()):
                raise self._given_up(found)
            if self._clock.now_s() > deadline_s:
                self._session.brake()
                self._wait_braked(pending)
                raise DeviceTimeout(
                    "did not arrive in time; it has been stopped",
                    device=self._name,
                    hint="is the speed slider very low, or does something block it?",
                )
        ended = self._ended(pending)
        if self._link.interrupted or ended == "stopped":
            self._end_stopped(pending)
        if ended == "retooled":
            raise trouble("tool-changed", "tool point").fault(self._name)
        if ended == "refused":
            raise self._given_up(self._trouble_soon() or trouble("refused"))

    def _ended(self, pending: Pending) -> str:
        """How it ended; a refusal by the library itself must not leave it going."""
        try:
            return self._session.ended(pending)
        except DeviceFault:
            self._session.abandon()
            raise

    def _end_stopped(self, pending: Pending) -> None:
        self._wait_braked(pending)
        raise MotionStopped("stopped while it moved", device=self._name)

    def _wait_braked(self, pending: Pending) -> None:
        """Wait for the end of a motion that was told to stop, and for rest."""
        deadline_s = self._clock.now_s() + self._ramp_s + _PATIENCE_S
        while not pending.arrived.wait(_POLL_S):
            self._session.status()
            if self._clock.now_s() > deadline_s:
                self._session.abandon()
                break
        self._wait_standing()

    def _arrived(self, target: FloatArray) -> Status:
        """The state at the target, or the fault that kept it from there."""
        status = self._wait_standing()
        if self._link.interrupted:
            raise MotionStopped("stopped while it moved", device=self._name)
        off_rad = float(np.abs(np.array(status.joints_rad) - target).max())
        if off_rad <= np.radians(self._config.arrival_tolerance_deg):
            return status
        away = f"{np.degrees(off_rad):.3f} deg away"
        raise self._given_up(self._trouble_soon() or trouble("not-arrived", away))

    def _wait_standing(self) -> Status:
        """Wait for some new frames in a row in which it stands."""
        deadline_s = self._clock.now_s() + self._ramp_s + _PATIENCE_S
        frames: set[float] = set()
        while True:
            status = self._session.status()
            frames = frames | {status.t_controller_s} if status.standing else set()
            if len(frames) >= _STANDS_FRAMES:
                return status
            if self._clock.now_s() > deadline_s:
                raise self._given_up(trouble("not-standing"))
            self._pause()

    @property
    def _ramp_s(self) -> float:
        """How long braking from full speed takes."""
        return self._config.speed_rad_s / self._config.stop_rad_s2

    def _trouble_soon(self) -> Trouble | None:
        """What the robot reports; the reason may come a little after the effect."""
        deadline_s = self._clock.now_s() + _LAG_S
        while self._clock.now_s() < deadline_s:
            if found := motion_trouble(self._session.status()):
                return found
            self._pause()
        return None

    def _given_up(self, found: Trouble) -> DeviceError:
        """The fault, after the motion was made unable to go on."""
        if not self._session.abandon():
            found = unended(found)
        return found.fault(self._name)

    def _lost(self, error: DeviceError) -> DeviceError:
        """The same error, with what was done about the motion."""
        try:
            done = self._session.brake()
        except LinkLost as worse:
            done = worse.message.removeprefix(f"{self._name}: ")
        what = error.message.removeprefix(f"{self._name}: ")
        return type(error)(f"{what}; {done}", device=self._name, hint=error.hint)

    def _pause(self) -> None:
        self._clock.wait(self._never, _POLL_S)
