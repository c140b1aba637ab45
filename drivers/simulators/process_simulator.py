"""A simulated device in a process of its own: started, asked where it is, ended."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, ClassVar, Self

from drivers.simulators.own_process import OwnProcess

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from drivers.simulators.world_port import WorldPort

_LOG = logging.getLogger(__name__)


class ProcessSimulator:
    """One device behind a loopback address, in a process that ``start`` begins.

    Args:
        command: module and its options.
        name: role of the device that it stands for.
        address_key: under which the process says where it answers, and under which
            the device's table wants to know it.
        keys: the others of that table.
        ready_s: how long it may take to come up.
        world: that it sees or moves in; None for none, or for one that ``command`` names.
    """

    own_process: ClassVar[bool] = True

    def __init__(
        self,
        command: Sequence[str],
        *,
        name: str,
        address_key: str,
        keys: Mapping[str, object],
        ready_s: float,
        world: WorldPort | None,
    ) -> None:
        self.name = name
        self._command = command
        self._address_key = address_key
        self._keys = keys
        self._ready_s = ready_s
        self._world = world
        self._process: OwnProcess | None = None

    @property
    def control_port(self) -> int:
        """Of the fault channel on 127.0.0.1; 0 while it does not run."""
        return int(str(self._said("control_port", 0)))

    @property
    def host(self) -> str:
        """The address it answers on; empty while it does not run."""
        return str(self._said(self._address_key, ""))

    @property
    def pid(self) -> int:
        """Of its process; 0 while it does not run."""
        return self._process.pid if self._process else 0

    def start(self) -> dict[str, object]:
        """Start the process; the keys for the device's table of the cell file.

        Raises:
            ConnectError: it did not come up.
        """
        if self._process is None:
            self._process = OwnProcess(
                self._command, name=self.name, ready_s=self._ready_s, world=self._world
            )
            _LOG.debug("%s: answers on %s", self.name, self.host)
        return {self._address_key: self.host, **self._keys}

    def stop(self) -> None:
        """End the process; more than once is allowed."""
        process, self._process = self._process, None
        if process is not None:
            process.end()

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *exc: object) -> None:
        self.stop()

    def _said(self, key: str, otherwise: object) -> object:
        return self._process.ready[key] if self._process else otherwise
