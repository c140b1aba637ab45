"""A byte machine as a simulator of a cell: its port, its fault channel, its world."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Protocol, TypeVar

import numpy as np
from pydantic import Field

from drivers.simulators.control import ControlServer
from drivers.simulators.host import Machine, SerialHost, tell
from drivers.simulators.noise import Noise
from mvp.errors import ConnectError
from mvp.fileedge import FileModel

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from drivers.simulators.control import Verb

_REPORT_S = 0.02
_NEVER = -np.inf


class LineSettings(FileModel):
    """Where a simulated serial device listens, and how good its line is.

    Attributes:
        listen: ``"pty"``, or ``"127.0.0.1:<port>"`` for ``socket://``; 0 takes any.
        baud: bits per second that bytes are paced with; 0 for no pacing.
        noise: of the line; the default is a perfect one.
    """

    listen: str = Field(default="pty", pattern=r"^(pty|127\.0\.0\.1:\d{1,5})$")
    baud: int = Field(default=0, ge=0)
    noise: Noise = Field(default_factory=Noise)


_Place = TypeVar("_Place", covariant=True)


class MovingMachine(Machine, Protocol[_Place]):
    """A machine whose motors can be asked where they truly are."""

    def places(self) -> _Place:
        """True places; equal when nothing has moved."""
        ...


class Reported(Machine):
    """A machine that tells the world where its motors are.

    Reports come at 50 Hz while something moves, one just before it starts, and one
    when it stands.

    Args:
        machine: what moves.
        report: of the world.
    """

    def __init__(
        self, machine: MovingMachine[_Place], report: Callable[[float, _Place], None]
    ) -> None:
        self._machine = machine
        self._report = report
        self._told: object = None
        self._told_s = _NEVER
        self._before: tuple[float, _Place] | None = None

    def opened(self, now_s: float) -> None:
        """Pass on that a host has opened the port."""
        tell(self._machine, "opened", now_s)

    def power_up(self, now_s: float) -> None:
        """Pass on that the power came on."""
        tell(self._machine, "power_up", now_s)

    def receive(self, data: bytes, now_s: float) -> None:
        """Pass on what the host sent."""
        self._machine.receive(data, now_s)

    def take_output(self) -> bytes:
        """What the machine said."""
        return self._machine.take_output()

    def tick(self, now_s: float) -> None:
        """Let time pass, and tell what has moved."""
        self._machine.tick(now_s)
        here = self._machine.places()
        before, self._before = self._before, (now_s, here)
        if here == self._told:
            return
        stands = before is not None and before[1] == here
        if before is not None and before[1] == self._told and before[0] > self._told_s:
            self._report(*before)  # it stood until then
            self._told_s = before[0]
        if stands or now_s - self._told_s >= _REPORT_S:
            self._report(now_s, here)
            self._told, self._told_s = here, now_s


class SerialSimulator:
    """A machine behind its port, with the fault channel beside it.

    Args:
        machine: what speaks and moves.
        line: where and how well it is heard.
        rng: of the noise.
        name: the role of the device it stands for.
        verbs: faults of its own, called with the machine at rest under the lock.
    """

    own_process: ClassVar[bool] = False

    def __init__(
        self,
        machine: Machine,
        line: LineSettings,
        *,
        rng: np.random.Generator,
        name: str,
        verbs: Mapping[str, Verb],
    ) -> None:
        self._name = name
        self.host = SerialHost(
            machine,
            listen=line.listen,
            noise=line.noise,
            rng=rng,
            baud=line.baud or None,
            name=name,
        )
        own = {verb: self.host.locked(do) for verb, do in verbs.items()}
        self._control = ControlServer({**self.host.verbs(), **own})

    @property
    def control_port(self) -> int:
        """Port of the fault channel on 127.0.0.1; 0 when it does not run."""
        return self._control.port

    def start(self) -> dict[str, object]:
        """Listen; the port for the device's table.

        Raises:
            ConnectError: no port is left.
        """
        try:
            self._control.start()
            return {"port": self.host.start()}
        except OSError as error:
            self.stop()
            raise ConnectError(
                f"the simulator cannot listen: {error}",
                device=self._name,
                hint="is another simulation running on that port?",
            ) from error

    def stop(self) -> None:
        """End; safe to repeat."""
        self._control.stop()
        self.host.stop()
