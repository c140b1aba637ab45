"""Starts and ends the process of a simulated GigE Vision camera."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, ClassVar, Self, cast

from pydantic import Field

from drivers.simulators.own_process import OwnProcess
from mvp.fileedge import FileModel

if TYPE_CHECKING:
    from drivers.simulators.world_port import WorldPort
    from mvp.devices import DeviceContext

_LOG = logging.getLogger(__name__)
_START_S = 20.0
# It renders while the driver waits, on whatever computer runs the simulation.
_PATIENCE_S = 10.0


class GigeSimulatorConfig(FileModel):
    """Keys of ``[simulators.camera]`` with ``kind = "gige"``.

    ``host`` is a loopback address, or "auto" for a free one.
    ``world`` is HOST:PORT of the world that the camera sees; empty: the cell's own, or
    a moving ramp where there is none.
    """

    host: str = Field(default="auto", pattern=r"^(auto|127\.\d+\.\d+\.\d+)$")
    serial: str = Field(default="SIM-GIGE-1", min_length=1, max_length=15)
    columns: int = Field(default=640, ge=1, le=8192)
    rows: int = Field(default=480, ge=1, le=8192)
    packet_size: int = Field(default=8192, ge=576, le=16000)
    gain_db_per_raw: float = Field(default=1.0, gt=0)
    lost_per_thousand: float = Field(default=0.0, ge=0, le=1000)
    wait_s: float = Field(default=60.0, ge=0)
    world: str = ""


class GigeSimulator:
    """Aravis' simulated camera in a process of its own, showing the world's frames.

    Its protocol and its stream are those of Aravis; only the pixels are ours.
    """

    key: ClassVar[str] = "gige"
    own_process: ClassVar[bool] = True
    Config = GigeSimulatorConfig

    def __init__(
        self, config: GigeSimulatorConfig, world: WorldPort | None, name: str
    ) -> None:
        self.name = name
        self._config = config
        self._world = world
        self._process: OwnProcess | None = None

    @classmethod
    def from_config(
        cls, config: GigeSimulatorConfig, context: DeviceContext, *, name: str
    ) -> Self:
        """Build it; starts nothing."""
        own = not config.world and hasattr(context.world, "frame_size")
        seen = context.world if own else None
        return cls(config, cast("WorldPort | None", seen), name)

    @property
    def control_port(self) -> int:
        """Of the fault channel on 127.0.0.1; 0 while it does not run."""
        return int(str(self._said("control_port", 0)))

    @property
    def host(self) -> str:
        """The address it answers on; empty while it does not run."""
        return str(self._said("address", ""))

    @property
    def pid(self) -> int:
        """Of its process; 0 while it does not run."""
        return self._process.pid if self._process else 0

    def start(self) -> dict[str, object]:
        """Start the process; the keys for the camera's table of the cell file.

        Raises:
            ConnectError: it did not come up.
        """
        config = self._config
        if self._process is None:
            self._process = OwnProcess(
                self._command(),
                name=self.name,
                ready_s=_START_S + config.wait_s,
                world=self._world,
            )
            _LOG.debug("%s: answers on %s", self.name, self.host)
        return {
            "address": self.host,
            "serial": config.serial,
            "packet_size": config.packet_size,
            "gain_db_per_raw": config.gain_db_per_raw,
            "frame_slack_s": _PATIENCE_S,
        }

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

    def _command(self) -> list[str]:
        config = self._config
        options: dict[str, object] = {
            "host": config.host,
            "serial": config.serial,
            "columns": config.columns,
            "rows": config.rows,
            "gain-db-per-raw": config.gain_db_per_raw,
            "lost-per-thousand": config.lost_per_thousand,
            "wait": config.wait_s,
        }
        command = ["drivers.simulators.gige"]
        command += [f"--{key}={value}" for key, value in options.items()]
        return command + ([f"--world={config.world}"] if config.world else [])

    def _said(self, key: str, otherwise: object) -> object:
        return self._process.ready[key] if self._process else otherwise
