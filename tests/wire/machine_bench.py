"""A simulated controller without its port, on a clock that the test turns."""

from __future__ import annotations

from typing import Generic, TypeVar

from drivers.simulators.host import Machine

_TICK_S = 0.005
_Machine = TypeVar("_Machine", bound=Machine)


class MachineBench(Generic[_Machine]):
    """A machine and the time on its clock."""

    def __init__(self, machine: _Machine) -> None:
        self.machine = machine
        self.now_s = 10.0

    def say(self, data: bytes) -> bytes:
        """What it answers at once."""
        self.machine.receive(data, self.now_s)
        self.machine.tick(self.now_s)
        return self.machine.take_output()

    def wait(self, seconds: float) -> bytes:
        """What it says in the meantime."""
        said = b""
        for _ in range(max(round(seconds / _TICK_S), 1)):
            self.now_s += _TICK_S
            self.machine.tick(self.now_s)
            said += self.machine.take_output()
        return said
