"""Starts and ends the process of a simulated Universal Robots controller."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, Self, cast

from pydantic import Field

from drivers.simulators.process_simulator import ProcessSimulator
from drivers.simulators.ur.profiles import DEFAULT_PROFILE, PROFILES
from mvp.errors import ConfigError
from mvp.fileedge import FileModel

if TYPE_CHECKING:
    from drivers.simulators.world_port import WorldPort
    from mvp.devices import DeviceContext, WorldBelief

_START_S = 30.0
_MODEL = "ur5e"
_Six = tuple[float, float, float, float, float, float]


class UrSimulatorConfig(FileModel):
    """Keys of ``[simulators.arm]`` with ``kind = "ur"``.

    ``model`` and ``joints_rad`` are those of the cell's world where there is one.
    ``world`` is HOST:PORT of another world that sees the arm.
    """

    host: str = "auto"
    profile: str = DEFAULT_PROFILE
    model: str | None = None
    joints_rad: _Six | None = None
    speed_scale: float = Field(default=1.0, gt=0)
    serial: str = Field(default="20225500123", pattern=r"^\d+$")
    on_protective_stop: Literal["pause", "stop"] = "pause"
    unlock_delay_s: float = Field(default=5.0, ge=0)
    script_start_s: float = Field(default=0.05, ge=0)
    remote: bool = True
    world: str = ""


class UrSimulator(ProcessSimulator):
    """One controller in a process of its own.

    The constructors of the client library block with the interpreter locked, so a
    thread of the same process could never answer them.
    """

    key: ClassVar[str] = "ur"
    Config = UrSimulatorConfig

    def __init__(
        self, config: UrSimulatorConfig, name: str, world: WorldPort | None = None
    ) -> None:
        super().__init__(
            _command(config),
            name=name,
            address_key="host",
            keys={},
            ready_s=_START_S,
            world=world,
        )

    @classmethod
    def from_config(
        cls, config: UrSimulatorConfig, context: DeviceContext, *, name: str
    ) -> Self:
        """Build it; starts nothing.

        Raises:
            ConfigError: no such profile.
        """
        if config.profile not in PROFILES:
            raise ConfigError(
                f"{name}: there is no profile {config.profile!r}",
                hint=f"there are: {', '.join(PROFILES)}",
            )
        sees = not config.world and hasattr(context.world, "report_arm")
        world = cast("WorldPort | None", context.world if sees else None)
        return cls(_as_in(context.world, config), name, world)


def _command(config: UrSimulatorConfig) -> list[str]:
    options: dict[str, object] = {
        "host": config.host,
        "profile": config.profile,
        "model": config.model or _MODEL,
        "speed-scale": config.speed_scale,
        "serial": config.serial,
        "on-protective-stop": config.on_protective_stop,
        "unlock-delay": config.unlock_delay_s,
        "script-start": config.script_start_s,
    }
    command = ["drivers.simulators.ur"]
    command += [f"--{key}={value}" for key, value in options.items()]
    command += [f"--world={config.world}"] if config.world else []
    command += [] if config.remote else ["--local"]
    joints = config.joints_rad
    return command + (["--joints", *map(repr, joints)] if joints else [])


def _as_in(world: object, config: UrSimulatorConfig) -> UrSimulatorConfig:
    """The configuration with the arm of the world where it names none."""
    belief = cast("WorldBelief | None", getattr(world, "belief", None))
    if belief is None:
        return config
    return config.model_copy(
        update={
            "model": config.model or belief.arm_model,
            "joints_rad": config.joints_rad or belief.start_joints,
        }
    )
