"""The way back from a stop, as steps that a person walks through.

Nothing here presses play: a program that was interrupted in a motion would go on with
it. The program is ended and loaded again instead.
"""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

from drivers._ur.codes import SAFETY_MODES, code_of, safety_trouble, trouble
from mvp.devices import RecoveryStep
from mvp.errors import DeviceTimeout, LinkLost

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from drivers._ur.session import Session
    from mvp.devices import Clock

_SAFE = ("NORMAL", "REDUCED")
_UNPOWERING = ("ROBOT_EMERGENCY_STOP", "SYSTEM_EMERGENCY_STOP")
_POWERING_S = 30.0
_UNLOCK_S = 12.0
_SEEN_TO_S = 5.0
_POLL_S = 0.2
_ONLY_HERE = "Only a person at the robot can see whether it is free and nobody is near."


def recover(
    session: Session,
    clock: Clock,
    *,
    close: Callable[[], None],
    open_: Callable[[], str],
) -> Iterator[RecoveryStep]:
    """Steps from where the robot is to a running control program.

    Args:
        session: knows the robot's address.
        clock: real time.
        close: ends the connection that the driver may still have.
        open_: connects anew and says what it found.

    Raises:
        DeviceError: the robot cannot be asked.
    """
    close()
    session.find_version()
    if session.has_dashboard:
        ways = _Ways(session, clock)
        yield from ways.remote()
        yield from ways.safety()
        yield from ways.program()
        yield from ways.power()
    else:
        yield RecoveryStep(
            "This controller can only be brought back at its pendant. Stop the program "
            "first: it would go on with its motion. Then clear what is shown, power the "
            "arm on and release its brakes, remote control on.",
            acknowledge=True,
            act=lambda: "seen to at the pendant",
        )
        yield RecoveryStep(
            "A program that is still there is ended now: one that only brakes takes its "
            "place. It may be what was interrupted, or somebody else's.",
            acknowledge=True,
            act=session.replace_program,
        )
    yield RecoveryStep(
        "Connect, load the control program, set tool and payload and read them back. "
        "Nothing moves.",
        acknowledge=False,
        act=open_,
    )


class _Ways:
    """Each way ends when its trouble is over; each step waits for its effect."""

    def __init__(self, session: Session, clock: Clock) -> None:
        self._session = session
        self._clock = clock
        self._never = threading.Event()

    def remote(self) -> Iterator[RecoveryStep]:
        """Local mode: only the pendant changes it."""
        while not self._is_remote():
            yield RecoveryStep(
                "The robot is in local mode. Switch its pendant to Remote Control.",
                acknowledge=True,
                act=lambda: self._wait(self._is_remote, _SEEN_TO_S, "remote control"),
            )

    def safety(self) -> Iterator[RecoveryStep]:
        """Protective stop, guard, emergency stop, fault."""
        while (found := self._safety()) not in _SAFE:
            number = code_of(found, SAFETY_MODES)
            what = safety_trouble(number if number is not None else 0)
            message = what.message if what is not None else found
            yield self._safety_step(found, f"{message[0].upper()}{message[1:]}.")

    def program(self) -> Iterator[RecoveryStep]:
        """Whatever is loaded and runs or waits must end: it is not ours any more."""
        while not self._is_stopped():
            said = self._ask("programState")
            yield RecoveryStep(
                f"A program runs or is paused on the robot ({said}); it may be what was "
                "interrupted, or somebody else's. End it, without letting it go on.",
                acknowledge=True,
                act=self._end_program,
            )

    def power(self) -> Iterator[RecoveryStep]:
        """Power on, then brakes."""
        while (mode := self._mode()) != "RUNNING":
            if mode in ("IDLE", "POWER_ON"):
                yield self._effect(
                    f"Release the brakes; the arm may sag a little. {_ONLY_HERE}",
                    "brake release",
                    "RUNNING",
                )
            elif mode == "POWER_OFF":
                yield self._effect(
                    f"Power the arm on. {_ONLY_HERE}", "power on", "IDLE", "RUNNING"
                )
            else:
                yield RecoveryStep(
                    f"The robot is in mode {mode}; bring it out of it at the pendant, "
                    "or wait until it has started.",
                    acknowledge=True,
                    act=lambda: self._wait(self._is_powerable, _POWERING_S, "the mode"),
                )

    def _safety_step(self, found: str, what: str) -> RecoveryStep:
        if found == "PROTECTIVE_STOP":
            text = f"{what} Look what the arm met and free it; then it is unlocked."
            return RecoveryStep(f"{text} {_ONLY_HERE}", True, self._unlock)
        if found in ("FAULT", "VIOLATION"):
            text = f"{what} Find out why at the pendant; then the safety is restarted."
            return RecoveryStep(f"{text} {_ONLY_HERE}", True, self._restart_safety)
        return RecoveryStep(
            f"{what} Remove the cause, then release the button, close the guard or "
            f"leave the mode at the pendant. {_ONLY_HERE}",
            acknowledge=True,
            act=lambda: self._wait(
                lambda: self._is_over(found), _SEEN_TO_S, "the safety system"
            ),
        )

    def _effect(self, text: str, command: str, *modes: str) -> RecoveryStep:
        """A command whose answer says nothing; only the mode does."""

        def act() -> str:
            self._ask(command)
            return self._wait(
                lambda: self._mode() in modes, _POWERING_S, f"robot mode {modes[0]}"
            )

        return RecoveryStep(text, acknowledge=True, act=act)

    def _unlock(self) -> str:
        """The robot refuses to be unlocked for 5 s after the stop."""
        self._ask("close safety popup")
        return self._wait(self._unlocked, _UNLOCK_S, "unlocking")

    def _unlocked(self) -> bool:
        if self._safety() in _SAFE:
            return True
        self._ask("unlock protective stop")
        return False

    def _restart_safety(self) -> str:
        self._ask("close safety popup")
        self._ask("restart safety")
        return self._wait(
            lambda: self._safety() in _SAFE, _POWERING_S, "restarting the safety"
        )

    def _end_program(self) -> str:
        self._ask("stop")
        return self._wait(self._is_stopped, _SEEN_TO_S, "ending the program")

    def _ask(self, command: str) -> str:
        """On a connection of its own: one from local mode stays in local mode."""
        with self._session.dashboard() as dashboard:
            return dashboard.value(command)

    def _is_remote(self) -> bool:
        if self._session.identity.version[:2] < (5, 6):
            return True
        return "true" in self._ask("is in remote control").lower()

    def _safety(self) -> str:
        return self._ask("safetystatus")

    def _is_over(self, found: str) -> bool:
        """An emergency stop takes the power away a moment after the arm stands."""
        unpowered = found not in _UNPOWERING or self._mode() != "RUNNING"
        return self._safety() != found and unpowered

    def _is_stopped(self) -> bool:
        return self._ask("programState").upper().startswith("STOPPED")

    def _mode(self) -> str:
        return self._ask("robotmode")

    def _is_powerable(self) -> bool:
        return self._mode() in ("POWER_OFF", "POWER_ON", "IDLE", "RUNNING")

    def _wait(self, good: Callable[[], bool], seconds: float, what: str) -> str:
        """Wait for an effect; in words, that it is there.

        Raises:
            DeviceFault: it does not come.
        """
        deadline = self._clock.now_s() + seconds
        while not self._holds(good):
            if self._clock.now_s() > deadline:
                detail = f"{what}, waited {seconds:.0f} s"
                raise trouble("still-there", detail).fault(self._session.name)
            self._clock.wait(self._never, _POLL_S)
        return f"{what}: done"

    def _holds(self, good: Callable[[], bool]) -> bool:
        """A restarting safety system takes the dashboard away for a moment."""
        try:
            return good()
        except (LinkLost, DeviceTimeout):
            return False
