"""The SCF4's side of the wire: lines out, one line back to each."""

from __future__ import annotations

import logging
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

from pydantic import Field, model_validator

from drivers._lens import LensConfig, Steps, stopped
from mvp.devices import Axis, DeviceContext, LineFramer, Session, Take, text
from mvp.errors import ConnectError, DeviceError, DeviceFault, DeviceTimeout, WireError
from mvp.fileedge import FileModel

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from mvp.devices import Ask

_LOG = logging.getLogger(__name__)
COUNTER = 1 << 16
_POLL_TRIES = 3
_STATUS = re.compile(r"(-?\d{1,9} *, *){8}-?\d{1,9}", re.ASCII)
_IDENTITY = re.compile(r"([^,]+,){3}[^,]+")


Letter: TypeAlias = Literal["A", "B", "C"]
# A to C set an output's lower threshold or value, E to G its upper threshold.
UPPER: dict[Letter, str] = {"A": "E", "B": "F", "C": "G"}


class Scf4Motor(FileModel):
    """One motor output. The controller forgets all of it when it restarts.

    Attributes:
        letter: of the axis on the controller.
        home: ``sensor`` looks for the edge of the photo-interrupter, ``stop`` drives
            against the lower end of travel.
        home_step: what the counter is set to there.
        run_current: 0 to 255, while moving.
        idle_current: 0 to 255, while standing.
        sensor_low: comparator threshold, 0 to 4095.
        sensor_high: comparator threshold, 0 to 4095.
    """

    letter: Letter
    home: Literal["sensor", "stop"] = "sensor"
    home_step: int = Field(default=32000, ge=0, lt=COUNTER)
    run_current: int = Field(default=190, ge=0, le=255)
    idle_current: int = Field(default=120, ge=0, le=255)
    sensor_low: int = Field(default=400, ge=0, le=4095)
    sensor_high: int = Field(default=700, ge=0, le=4095)


class Scf4Config(LensConfig):
    """Keys of ``[lens]`` for the SCF4, beside port and ranges.

    Attributes:
        zoom_motor: output of the zoom axis.
        focus_motor: output of the focus axis.
        iris_motor: output of the iris axis.
        home_order: axes in the order in which they are homed.
        stop_current: current for driving against an end of travel, 0 to 255.
        step_period: time between steps in the controller's unit; larger is slower.
        micro_steps: argument of M243, of axis C's driver; None leaves it.
        settle_s: wait after the controller reports the end of a motion.
    """

    zoom_motor: Scf4Motor = Scf4Motor(letter="A")
    focus_motor: Scf4Motor = Scf4Motor(letter="B")
    iris_motor: Scf4Motor = Scf4Motor(letter="C", home="stop", home_step=0)
    home_order: tuple[Axis, Axis, Axis] = ("zoom", "focus", "iris")
    stop_current: int = Field(default=60, ge=0, le=255)
    step_period: int = Field(default=600, ge=400, le=5000)
    micro_steps: int | None = Field(default=6, ge=0, le=8)
    settle_s: float = Field(default=0.1, ge=0)

    @model_validator(mode="after")
    def _complete(self) -> Scf4Config:
        motors = (self.zoom_motor, self.focus_motor, self.iris_motor)
        if len({motor.letter for motor in motors}) < 3:
            raise ValueError("two motors have the same letter")
        if len(set(self.home_order)) < 3:
            raise ValueError("home_order must name every axis once")
        return self


@dataclass(frozen=True)
class Scf4Status:
    """An answer to ``!1``, by axis of the lens."""

    steps: Steps
    sensor: dict[Axis, bool]
    moving: dict[Axis, bool]

    @property
    def standing(self) -> bool:
        """Whether no motor moves."""
        return not any(self.moving.values())


class Scf4Wire:
    """Conversation with one controller.

    Args:
        config: port, outputs and waiting times.
        context: clock, links, where traffic is written after a fault.
        name: of the device.
        on_lost: told when the link breaks.
    """

    def __init__(
        self,
        config: Scf4Config,
        context: DeviceContext,
        name: str,
        *,
        on_lost: Callable[[DeviceError], None],
    ) -> None:
        self.name = name
        self._config = config
        self._outputs: dict[Axis, int] = {
            "zoom": "ABC".index(config.zoom_motor.letter),
            "focus": "ABC".index(config.focus_motor.letter),
            "iris": "ABC".index(config.iris_motor.letter),
        }
        self.session = Session(
            context.transports(config, name),
            LineFramer(),
            clock=context.clock,
            sync=self._ask_identity,
            on_lost=on_lost,
            strip_echo=config.strip_echo,
            quiet_s=config.quiet_s,
            dump_folder=context.dump_folder,
        )

    def open(self) -> tuple[str, str, str, str]:
        """Connect; firmware, board, brand and serial number of who answers.

        Raises:
            ConnectError: no such port, in use, or no SCF4 there.
            LinkLost: unplugged meanwhile.
        """
        self.session.open()
        try:
            (line,) = self.session.request_until(
                b"$S\n",
                _is_identity,
                timeout_s=self._config.answer_s,
                patience_s=self._config.identify_s,
            )
        except DeviceTimeout as error:
            raise ConnectError(
                "no SCF4 answers on this port",
                device=self.name,
                hint="is it switched on, and is this the right port?",
            ) from error
        firmware, board, brand, serial = (p.strip() for p in text(line).split(","))
        return firmware, board, brand, serial

    def order(self, *lines: str) -> None:
        """Commands that must be answered by OK, one at a time.

        Raises:
            DeviceFault: another answer.
            DeviceTimeout, LinkLost, ConnectError: see ``Session.request``.
        """
        for line in lines:
            self._order(line)

    def stop_now(self) -> None:
        """``M0`` past a command that waits, which ends; its own answer is not awaited.

        Raises:
            LinkLost, ConnectError, DeviceTimeout: it cannot be sent.
        """
        self.session.send(b"M0\n")
        self.session.abort(stopped(self.name), in_step=False)
        self.session.fall_out_of_step()

    def status(self) -> Scf4Status:
        """Positions, sensors and motion; asked again when the answer was disturbed.

        Raises:
            WireError: disturbed again and again.
            DeviceTimeout, LinkLost, ConnectError: see ``Session.request``.
        """
        (frame,) = self.session.request_until(
            b"!1\n",
            self._is_status,
            timeout_s=self._config.answer_s,
            tries=_POLL_TRIES,
        )
        values = [int(part) for part in _line(frame).split(",")]
        return Scf4Status(
            {axis: values[i] for axis, i in self._outputs.items()},
            {axis: values[3 + i] != 0 for axis, i in self._outputs.items()},
            {axis: values[6 + i] != 0 for axis, i in self._outputs.items()},
        )

    def _ask_identity(self, ask: Ask) -> None:
        """The question whose answer cannot be taken for another one's."""
        ask(b"$S\n", _is_identity, timeout_s=self._config.answer_s)

    def _order(self, command: str) -> None:
        self.session.request(
            f"{command}\n".encode("ascii"),
            lambda frame: self._is_ok(command, frame),
            timeout_s=self._config.answer_s,
        )

    def _is_ok(self, command: str, frame: bytes) -> Take:
        line = _line(frame)
        if line == "OK":
            return Take.DONE
        if not line:
            return Take.OTHER
        # The OK itself may follow, or this may be the answer to something else.
        self.session.fall_out_of_step()
        raise DeviceFault(
            f"answers {line!r} to {command}",
            device=self.name,
            code=line,
            hint="is the line disturbed? nothing more was sent",
        )

    def _is_status(self, frame: bytes) -> Take:
        line = _line(frame)
        if not line:
            return Take.OTHER
        if _STATUS.fullmatch(line):
            return Take.DONE
        self.session.fall_out_of_step()
        raise WireError(
            f"answers {line!r} instead of nine whole numbers", device=self.name
        )


def words(code: str, values: Mapping[Letter, int] | Mapping[str, int]) -> str:
    """A command with one number for each letter."""
    return " ".join([code, *(f"{letter}{value}" for letter, value in values.items())])


def _line(frame: bytes) -> str:
    return text(frame).strip(" \t")


def _is_identity(frame: bytes) -> Take:
    return Take.DONE if _IDENTITY.fullmatch(_line(frame)) else Take.OTHER
