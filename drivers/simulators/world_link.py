"""The world across processes: reports and pictures over TCP on 127.0.0.1.

One JSON line per request. Reports are not answered; a picture is answered by a JSON
line with its shape and number of bytes, followed by the raw grey values. Client and
server read the same monotonic clock of the same machine.
"""

from __future__ import annotations

import json
import socket
import threading
from typing import TYPE_CHECKING, cast

import numpy as np

from drivers.simulators.line_server import LOOPBACK, LineServer, Outlet

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from drivers.simulators.world_port import WorldPort

_LINE_MAX = 65536
_GREY = {"uint8": np.uint8, "uint16": np.uint16}


class WorldServer:
    """Offers a world to simulators that live in other processes."""

    def __init__(self, world: WorldPort) -> None:
        self._world = world
        self._server: LineServer | None = None

    @property
    def address(self) -> str:
        """``127.0.0.1:port``; the port is 0 when it does not listen."""
        return f"{LOOPBACK}:{self._server.port if self._server else 0}"

    def start(self) -> None:
        """Begin to answer."""
        self._server = LineServer(self._do, name="world-link")

    def stop(self) -> None:
        """Hang up on everybody."""
        server, self._server = self._server, None
        if server is not None:
            server.stop()

    def _do(self, line: bytes, out: Outlet) -> None:
        """One request; what the world refuses is answered only where it is asked."""
        asked, world = json.loads(line), self._world
        match asked["do"]:
            case "arm":
                world.report_arm(asked["t_s"], asked["joints"])
            case "lens":
                world.report_lens(asked["t_s"], asked["steps"])
            case "size":
                _say(out, {"size": world.frame_size()})
            case "frame":
                self._picture(asked, out)
            case other:
                _say(out, {"error": f"no request {other!r}"})

    def _picture(self, asked: dict[str, float], out: Outlet) -> None:
        grey = self._world.frame(
            asked["start_s"],
            asked["exposure_s"],
            gain=asked["gain"],
            index=int(asked["index"]),
        )
        shape, kind = list(grey.shape), grey.dtype.name
        _say(out, {"shape": shape, "dtype": kind, "bytes": grey.nbytes})
        out.write(grey.tobytes())


def _say(out: Outlet, message: dict[str, object]) -> None:
    out.write(json.dumps(message).encode() + b"\n")


class WorldClient:
    """A world on the other side of a loopback connection; a ``WorldPort``.

    Args:
        address: ``host:port`` of a ``WorldServer``.
        timeout_s: how long a picture may take.

    Raises:
        OSError: nobody answers there, now or later.
    """

    def __init__(self, address: str, *, timeout_s: float = 30.0) -> None:
        host, _, port = address.rpartition(":")
        self._address = (host, int(port))
        self._timeout_s = timeout_s
        self._reports = socket.create_connection(self._address, timeout_s)
        self._pictures = socket.create_connection(self._address, timeout_s)
        self._answers = self._pictures.makefile("rb")
        self._report_turn, self._picture_turn = threading.Lock(), threading.Lock()

    def report_arm(self, t_s: float, joints: Sequence[float]) -> None:
        """Say where the axes are, rad or mm."""
        self._report({"do": "arm", "t_s": t_s, "joints": [float(j) for j in joints]})

    def report_lens(self, t_s: float, steps: Mapping[str, float]) -> None:
        """Say where the motors are, steps."""
        places = {axis: float(value) for axis, value in steps.items()}
        self._report({"do": "lens", "t_s": t_s, "steps": places})

    def frame_size(self) -> tuple[int, int]:
        """Columns and rows of a picture."""
        with self._picture_turn:
            columns, rows = cast("list[int]", self._ask({"do": "size"})["size"])
        return columns, rows

    def frame(
        self, start_s: float, exposure_s: float, *, gain: float = 1.0, index: int = 0
    ) -> NDArray[np.uint8] | NDArray[np.uint16]:
        """What the sensor delivers for an exposure: (rows, columns)."""
        asked = {
            "do": "frame",
            "start_s": start_s,
            "exposure_s": exposure_s,
            "gain": gain,
            "index": index,
        }
        with self._picture_turn:
            said = self._ask(asked)
            raw = self._answers.read(cast("int", said["bytes"]))
        grey = np.frombuffer(raw, _GREY[str(said["dtype"])])
        return grey.reshape(cast("list[int]", said["shape"]))

    def close(self) -> None:
        """Hang up."""
        self._answers.close()
        self._reports.close()
        self._pictures.close()

    def _report(self, message: dict[str, object]) -> None:
        with self._report_turn:
            self._reports.sendall(json.dumps(message).encode() + b"\n")

    def _ask(self, message: dict[str, object]) -> dict[str, object]:
        self._pictures.sendall(json.dumps(message).encode() + b"\n")
        line = self._answers.readline(_LINE_MAX)
        if not line:
            raise ConnectionResetError("the world hung up")
        said: dict[str, object] = json.loads(line)
        if "error" in said:
            raise ConnectionError(f"the world refused: {said['error']}")
        return said
