"""A simulator in a process of its own: started, heard ready, ended with its parent.

The process prints one line of JSON when it listens and ends when its standard input
closes, which also happens when this process dies.
"""

from __future__ import annotations

import json
import queue
import subprocess
import sys
import threading
from typing import TYPE_CHECKING

from drivers.simulators.world_link import WorldServer
from mvp.errors import ConnectError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivers.simulators.world_port import WorldPort

_END_S = 5.0


class OwnProcess:
    """One ``python -m`` that answers ``{"ready": true, ...}``, or says why not.

    Args:
        command: module and its options.
        name: the device that it stands for.
        ready_s: how long it may take to come up.
        world: served to it over loopback as ``--world=HOST:PORT``; None: it sees none.
    """

    def __init__(
        self,
        command: Sequence[str],
        *,
        name: str,
        ready_s: float,
        world: WorldPort | None,
    ) -> None:
        self._name = name
        self._server = _serve(world)
        served = [f"--world={self._server.address}"] if self._server else []
        self._process = subprocess.Popen(
            [sys.executable, "-m", *command, "--end-with-stdin", *served],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,  # Ctrl-C is for whoever started it
        )
        self.ready = self._first_line(ready_s)

    @property
    def pid(self) -> int:
        """Of the process."""
        return self._process.pid

    def end(self) -> None:
        """Close its input and wait; kill it when that is not enough."""
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()
        try:
            self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if self._server is not None:
            self._server.stop()

    def _first_line(self, ready_s: float) -> dict[str, object]:
        """What it says when it is ready.

        Raises:
            ConnectError: nothing in time, or that it could not start.
        """
        lines: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        stdout = self._process.stdout
        if stdout is None:
            raise ValueError("the process has no standard output")
        threading.Thread(
            target=lambda: lines.put(stdout.readline()), daemon=True
        ).start()
        try:
            said = json.loads(lines.get(timeout=ready_s))
        except (queue.Empty, ValueError):
            said = {"message": "it ended, or said nothing in time"}
        if not said.get("ready"):
            self._process.kill()
            self.end()
            raise ConnectError(
                f"the simulator does not start: {said.get('message')}",
                device=self._name,
                hint=str(said.get("hint", "")),
            )
        return dict(said)


def _serve(world: WorldPort | None) -> WorldServer | None:
    """The world on a loopback port of this process."""
    if world is None:
        return None
    server = WorldServer(world)
    server.start()
    return server
