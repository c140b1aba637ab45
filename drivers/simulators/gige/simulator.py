"""Starts and ends the process of a simulated GigE Vision camera."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Self, cast

from pydantic import Field

from drivers.simulators.process_simulator import ProcessSimulator
from mvp.fileedge import FileModel

if TYPE_CHECKING:
    from drivers.simulators.world_port import WorldPort
    from mvp.devices import DeviceContext

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


class GigeSimulator(ProcessSimulator):
    """Aravis' simulated camera in a process of its own, showing the world's frames.

    Its protocol and its stream are those of Aravis; only the pixels are ours.
    """

    key: ClassVar[str] = "gige"
    Config = GigeSimulatorConfig

    def __init__(
        self, config: GigeSimulatorConfig, world: WorldPort | None, name: str
    ) -> None:
        super().__init__(
            _command(config),
            name=name,
            address_key="address",
            keys={
                "serial": config.serial,
                "packet_size": config.packet_size,
                "gain_db_per_raw": config.gain_db_per_raw,
                "frame_slack_s": _PATIENCE_S,
            },
            ready_s=_START_S + config.wait_s,
            world=world,
        )

    @classmethod
    def from_config(
        cls, config: GigeSimulatorConfig, context: DeviceContext, *, name: str
    ) -> Self:
        """Build it; starts nothing."""
        own = not config.world and hasattr(context.world, "frame_size")
        seen = context.world if own else None
        return cls(config, cast("WorldPort | None", seen), name)


def _command(config: GigeSimulatorConfig) -> list[str]:
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
