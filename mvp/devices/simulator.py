"""The far end of a wire, played by a program: what a simulated cell starts."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Protocol

if TYPE_CHECKING:
    from collections.abc import Mapping

    from mvp.devices.context import DeviceContext
    from mvp.fileedge import FileModel


class Simulator(Protocol):
    """One simulated device; it listens on this machine only."""

    @property
    def control_port(self) -> int:
        """Port of its private fault channel on 127.0.0.1; 0 when it is not running."""
        ...

    def start(self) -> Mapping[str, object]:
        """Begin to listen.

        Returns:
            Keys for the device's table in the cell file, for instance its port.

        Raises:
            DeviceError: it cannot listen, or what it needs is not installed.
        """
        ...

    def stop(self) -> None:
        """End, with everything it started; safe to repeat."""
        ...


class SimulatorClass(Protocol):
    """A class behind an entry point of the group ``mvp_cell.simulators``."""

    Config: ClassVar[type[FileModel]]

    def from_config(
        self, config: FileModel, context: DeviceContext, *, name: str
    ) -> Simulator:
        """Build the simulator; no I/O.

        Args:
            config: an instance of its ``Config``.
            context: clock, randomness, folder, and the world that it moves in.
            name: the role of the device that it stands for.
        """
        ...
