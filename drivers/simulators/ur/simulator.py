"""Starts and ends the process of a simulated Universal Robots controller."""

from __future__ import annotations

import json
import logging
import queue
import subprocess
import sys
import threading
from typing import TYPE_CHECKING, ClassVar, Literal, Self

from pydantic import Field

from drivers.simulators.ur.profiles import DEFAULT_PROFILE, PROFILES
from mvp.errors import ConfigError, ConnectError
from mvp.fileedge import FileModel

if TYPE_CHECKING:
    from mvp.devices import DeviceContext

_LOG = logging.getLogger(__name__)
_READY_S = 30.0
_END_S = 5.0


class UrSimulatorConfig(FileModel):
    """Keys of ``[simulators.arm]`` with ``kind = "ur"``.

    ``world`` is HOST:PORT of the world that sees the arm; empty: nobody does.
    """

    host: str = "auto"
    profile: str = DEFAULT_PROFILE
    model: str = "ur5e"
    joints_rad: tuple[float, float, float, float, float, float] = (
        0.0,
        -1.57,
        1.57,
        -1.57,
        -1.57,
        0.0,
    )
    speed_scale: float = Field(default=1.0, gt=0)
    serial: str = Field(default="20225500123", pattern=r"^\d+$")
    on_protective_stop: Literal["pause", "stop"] = "pause"
    unlock_delay_s: float = Field(default=5.0, ge=0)
    script_start_s: float = Field(default=0.05, ge=0)
    remote: bool = True
    world: str = ""


class UrSimulator:
    """One controller in a process of its own.

    The constructors of the client library block with the interpreter locked, so a
    thread of the same process could never answer them.
    """

    key: ClassVar[str] = "ur"
    own_process: ClassVar[bool] = True
    Config = UrSimulatorConfig

    def __init__(self, config: UrSimulatorConfig, name: str) -> None:
        self.name = name
        self._config = config
        self._process: subprocess.Popen[bytes] | None = None
        self._ready: dict[str, object] = {}

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
        return cls(config, name)

    @property
    def control_port(self) -> int:
        """Of the fault channel on 127.0.0.1; 0 while it does not run."""
        return int(str(self._ready.get("control_port", 0)))

    @property
    def host(self) -> str:
        """The address it listens on; empty while it does not run."""
        return str(self._ready.get("host", ""))

    @property
    def pid(self) -> int:
        """Of its process; 0 while it does not run."""
        return self._process.pid if self._process else 0

    def start(self) -> dict[str, object]:
        """Start the process; the keys for the arm's table of the cell file.

        Raises:
            ConnectError: it did not come up.
        """
        if self._process is None:
            self._process = subprocess.Popen(
                self._command(), stdin=subprocess.PIPE, stdout=subprocess.PIPE
            )
            self._ready = self._first_line(self._process)
            _LOG.debug("%s: listens on %s", self.name, self.host)
        return {"host": self.host}

    def stop(self) -> None:
        """End the process; more than once is allowed."""
        process, self._process = self._process, None
        self._ready = {}
        if process is None:
            return
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                pipe.close()
        try:
            process.wait(_END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *exc: object) -> None:
        self.stop()

    def _command(self) -> list[str]:
        config = self._config
        options: dict[str, object] = {
            "host": config.host,
            "profile": config.profile,
            "model": config.model,
            "speed-scale": config.speed_scale,
            "serial": config.serial,
            "on-protective-stop": config.on_protective_stop,
            "unlock-delay": config.unlock_delay_s,
            "script-start": config.script_start_s,
        }
        command = [sys.executable, "-m", "drivers.simulators.ur", "--end-with-stdin"]
        command += [f"--{key}={value}" for key, value in options.items()]
        command += [f"--world={config.world}"] if config.world else []
        command += [] if config.remote else ["--local"]
        return [*command, "--joints", *map(repr, config.joints_rad)]

    def _first_line(self, process: subprocess.Popen[bytes]) -> dict[str, object]:
        """What it says when it is ready.

        Raises:
            ConnectError: nothing in time, or that it could not start.
        """
        lines: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        stdout = process.stdout
        if stdout is None:
            raise ValueError("the process has no standard output")
        threading.Thread(
            target=lambda: lines.put(stdout.readline()), daemon=True
        ).start()
        try:
            said = json.loads(lines.get(timeout=_READY_S))
        except (queue.Empty, ValueError):
            said = {"message": "it ended, or said nothing in time"}
        if not said.get("ready"):
            self.stop()
            raise ConnectError(
                f"the simulated controller does not start: {said.get('message')}",
                device=self.name,
                hint="is the address in use? host = 'auto' takes a free one",
            )
        return dict(said)
