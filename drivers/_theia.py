"""The Theia MCR's side of the wire: binary frames, cut by the length of their kind.

0D ends every frame and occurs inside frames, too. The board answers a motion when it
has ended and is deaf until then; the answer names neither the motion nor the motor.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from pydantic import Field, model_validator

from drivers._lens import LensConfig
from mvp.devices import Axis, DeviceContext, LengthFramer, Session, Take
from mvp.errors import ConnectError, DeviceError, DeviceFault, DeviceTimeout
from mvp.fileedge import FileModel

if TYPE_CHECKING:
    from collections.abc import Callable

    from mvp.devices import Ask

MOTOR_IDS: dict[Axis, int] = {"focus": 1, "zoom": 2, "iris": 3}
_END = 0x0D
_FIRMWARE, _SERIAL, _READ, _WRITE, _DONE = 0x76, 0x79, 0x67, 0x63, 0x74
_PLUS, _MINUS, _ABSOLUTE = 0x66, 0x62, 0x73
_ANSWERS = {_FIRMWARE: 7, _SERIAL: 8, _READ: 12, _WRITE: 3, _DONE: 3}
_START = 0x01
_STEPPER = 0x00
_OLDEST_FIRMWARE = 5


class TheiaMotor(FileModel):
    """One motor of the lens.

    Attributes:
        steps: of its whole travel.
        switch: step at which its light barrier is; None when it has none.
        speed: steps per second.
        min_speed: slowest that the board shall accept.
        max_speed: fastest that the board shall accept.
        plus_is_up: whether the board's ``+`` counts up; it turns zoom and focus
            towards the barrier and closes the iris.
    """

    steps: int = Field(gt=0, le=0xFFFF)
    switch: int | None = Field(default=None, gt=0)
    speed: int = Field(default=1200, gt=0, le=0xFFFF)
    min_speed: int = Field(default=100, gt=0, le=0xFFFF)
    max_speed: int = Field(default=1500, gt=0, le=0xFFFF)
    plus_is_up: bool = True

    @model_validator(mode="after")
    def _consistent(self) -> TheiaMotor:
        if not self.min_speed <= self.speed <= self.max_speed:
            raise ValueError("speed is outside min_speed .. max_speed")
        if self.switch is not None and self.switch > self.steps:
            raise ValueError("switch is beyond steps")
        if self.switch is not None and not self.plus_is_up:
            raise ValueError("a barrier is at the upper end, where + goes")
        return self

    @property
    def home_step(self) -> int:
        """Where it stands after homing: at its barrier, or at the end that + reaches."""
        if self.switch is not None:
            return self.switch
        return self.steps if self.plus_is_up else 0


class TheiaConfig(LensConfig):
    """Keys of ``[lens]`` for the Theia MCR, beside port and ranges.

    Attributes:
        zoom_motor: motor 2; the default is a TL1250.
        focus_motor: motor 1.
        iris_motor: motor 3.
        write_setup: let ``home`` write a motor's set-up into the board when it differs
            from the one here; the board keeps it without power.
        rest_s: between two motions.
    """

    zoom_motor: TheiaMotor = TheiaMotor(steps=3227, switch=3119)
    focus_motor: TheiaMotor = TheiaMotor(steps=8390, switch=7959)
    iris_motor: TheiaMotor = TheiaMotor(
        steps=75, speed=100, min_speed=10, max_speed=200, plus_is_up=False
    )
    write_setup: bool = True
    rest_s: float = Field(default=0.01, ge=0.01)

    def motors(self) -> dict[Axis, TheiaMotor]:
        """The three motors by axis."""
        return {
            "zoom": self.zoom_motor,
            "focus": self.focus_motor,
            "iris": self.iris_motor,
        }


@dataclass(frozen=True)
class Setup:
    """What the board keeps of a motor."""

    kind: int
    left: int
    right: int
    steps: int
    min_speed: int
    max_speed: int

    @classmethod
    def wanted(cls, motor: TheiaMotor) -> Setup:
        """What it must be for this motor: its barrier stops ``+`` motions."""
        return cls(
            _STEPPER,
            int(motor.switch is not None),
            0,
            motor.steps,
            motor.min_speed,
            motor.max_speed,
        )

    @classmethod
    def decode(cls, frame: bytes) -> Setup:
        """From an answer to 67."""
        return cls(*frame[2:5], *(_number(frame[i : i + 2]) for i in (5, 7, 9)))

    def encode(self, motor: int) -> bytes:
        """The request that writes it."""
        flags = bytes([_WRITE, motor, self.kind, self.left, self.right])
        words = (self.steps, self.min_speed, self.max_speed)
        return flags + b"".join(map(_word, words)) + bytes([_END])


def shift_frame(axis: Axis, steps: int, motor: TheiaMotor) -> bytes:
    """Relative motion by a signed number of steps of the lens table."""
    kind = _PLUS if (steps > 0) == motor.plus_is_up else _MINUS
    return _motion(kind, axis, abs(steps), motor.speed)


def to_switch_frame(axis: Axis, motor: TheiaMotor) -> bytes:
    """Absolute motion to the barrier."""
    return _motion(_ABSOLUTE, axis, 0, motor.speed)


def end_frame(axis: Axis, motor: TheiaMotor) -> bytes:
    """Motion over the whole travel against the end that ``+`` reaches."""
    return _motion(_PLUS, axis, motor.steps, motor.speed)


class TheiaWire:
    """Conversation with one board.

    Args:
        config: port and waiting times.
        context: clock, links, where traffic is written after a fault.
        name: of the device.
        on_lost: told when the link breaks.
        on_late: told when a motion ended that nobody waits for any more.
    """

    def __init__(
        self,
        config: TheiaConfig,
        context: DeviceContext,
        name: str,
        *,
        on_lost: Callable[[DeviceError], None],
        on_late: Callable[[], None],
    ) -> None:
        self.name = name
        self._config = config
        self._on_late = on_late
        motors = config.motors().values()
        self._unanswered = False  # a motion that may still go on
        self._longest_s = max(2.0 * motor.steps / motor.speed for motor in motors)
        self.session = Session(
            context.transports(config, name),
            LengthFramer(_ANSWERS, last=_END),
            clock=context.clock,
            on_push=self._unasked,
            sync=self._sync,
            on_lost=on_lost,
            strip_echo=config.strip_echo,
            quiet_s=config.quiet_s,
            dump_folder=context.dump_folder,
        )

    def open(self) -> tuple[str, str]:
        """Connect; firmware and serial number of who answers.

        Raises:
            ConnectError: no such port, in use, no MCR there, or a firmware too old.
            LinkLost: unplugged meanwhile.
        """
        self.session.open()
        try:
            (frame,) = self.session.request_until(
                bytes([_FIRMWARE, _END]),
                _is(_FIRMWARE),
                timeout_s=self._config.answer_s,
                patience_s=self._config.identify_s,
            )
        except DeviceTimeout as error:
            raise ConnectError(
                "no Theia MCR answers on this port",
                device=self.name,
                hint="is it switched on, this the right port, and its path set to USB?",
            ) from error
        firmware = ".".join(f"{digit:x}" for digit in frame[1:6])
        if frame[1] < _OLDEST_FIRMWARE:
            raise ConnectError(
                f"firmware {firmware} is too old",
                device=self.name,
                hint=f"boards from firmware {_OLDEST_FIRMWARE} on are understood",
            )
        digits = self._ask(bytes([_SERIAL, _END]), _SERIAL)[1:7].hex()
        return firmware, f"{digits[:3]}-{digits[-6:]}"

    def setup(self, axis: Axis) -> Setup:
        """What the board keeps of a motor.

        Raises:
            DeviceFault: it does not know that motor.
        """
        motor = MOTOR_IDS[axis]
        frame = self._ask(bytes([_READ, motor, _END]), _READ)
        if frame[1] != motor:
            raise self._unknown(axis)
        return Setup.decode(frame)

    def write_setup(self, axis: Axis, setup: Setup) -> None:
        """Let the board keep another set-up of a motor, and read it back.

        Raises:
            DeviceFault: it does not know that motor, or keeps something else.
        """
        if self._ask(setup.encode(MOTOR_IDS[axis]), _WRITE)[1] != 0:
            raise self._unknown(axis)
        kept = self.setup(axis)
        if kept != setup:
            raise DeviceFault(
                f"keeps {kept} of {axis} instead of {setup}",
                device=self.name,
                code="setup",
                hint="is the line disturbed?",
            )

    def move(self, frame: bytes, *, timeout_s: float) -> None:
        """One motion, to its end.

        Raises:
            DeviceFault: it did not end well.
            DeviceTimeout, LinkLost, ConnectError: see ``Session.request``.
        """
        self._unanswered = True
        (answer,) = self.session.request(frame, _is(_DONE), timeout_s=timeout_s)
        self._unanswered = False
        if answer[1] != 0:
            raise DeviceFault(
                "a motion ended badly",
                device=self.name,
                code=f"74 {answer[1]:02x}",
                hint="home it again",
            )

    def _ask(self, data: bytes, answer: int) -> bytes:
        (frame,) = self.session.request(
            data, _is(answer), timeout_s=self._config.answer_s
        )
        return frame

    def _sync(self, ask: Ask) -> None:
        """The question whose answer no motion gives; a motion may have to end first."""
        ask(
            bytes([_FIRMWARE, _END]),
            _is(_FIRMWARE),
            timeout_s=self._config.answer_s + self._unanswered * self._longest_s,
        )
        self._has_ended()

    def _unasked(self, frame: bytes) -> bool:
        """The board says nothing unasked: this is an answer that came too late."""
        if frame[0] == _DONE:
            self._has_ended()
        return False

    def _has_ended(self) -> None:
        self._unanswered = False
        self._on_late()

    def _unknown(self, axis: Axis) -> DeviceFault:
        return DeviceFault(
            f"does not know a motor for {axis}",
            device=self.name,
            code=f"motor {MOTOR_IDS[axis]}",
            hint="is this the board of a lens with zoom, focus and iris?",
        )


def _is(kind: int) -> Callable[[bytes], Take]:
    """Takes the first frame of a kind."""
    return lambda frame: Take.DONE if frame[0] == kind else Take.OTHER


def _motion(kind: int, axis: Axis, steps: int, speed: int) -> bytes:
    """The eight bytes of a motion."""
    head = bytes([kind, MOTOR_IDS[axis]])
    return head + _word(steps) + bytes([_START]) + _word(speed) + bytes([_END])


def _word(value: int) -> bytes:
    return value.to_bytes(2, "big")


def _number(data: bytes) -> int:
    return int.from_bytes(data, "big")
