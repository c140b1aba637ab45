"""The private fault channel of a simulator: JSON lines over TCP on 127.0.0.1.

``{"do": "stall", "axis": "zoom"}`` is answered by ``{"ok": true, ...}`` or by
``{"ok": false, "message": "..."}``. The verbs are the simulator's own; one of them is
``state``. Nothing of it exists on the simulated hardware.
"""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Self

from drivers.simulators.line_server import LOOPBACK, LineServer, Outlet

if TYPE_CHECKING:
    from types import TracebackType

Verb = Callable[[Mapping[str, object]], Mapping[str, object] | None]


class ControlRefused(Exception):
    """The simulator did not do what the fault channel asked."""


def answer(line: bytes, verbs: Mapping[str, Verb]) -> bytes:
    """Do what one line asks; the answering line, with its line feed.

    A verb gets the other keys of the line and returns what to add to the answer. Its
    LookupError, TypeError, ValueError or number out of bounds becomes the refusal's
    message.
    """
    try:
        asked = json.loads(line)
        name = asked.pop("do")
        if name not in verbs:
            raise ValueError(f"no verb {name!r}; there are: {', '.join(sorted(verbs))}")
        said = verbs[name](asked) or {}
        text = json.dumps({"ok": True, **said})
    except (
        ArithmeticError,
        AttributeError,
        LookupError,
        RecursionError,
        TypeError,
        ValueError,
    ) as error:
        text = json.dumps({"ok": False, "message": f"{type(error).__name__}: {error}"})
    return text.encode() + b"\n"


class ControlServer:
    """Serves the verbs from threads of its own, until closed.

    Verbs run one at a time; what they touch must still be safe against the thread
    that the simulator itself runs in.
    """

    def __init__(self, verbs: Mapping[str, Verb], *, port: int = 0) -> None:
        self._verbs = verbs
        self._asked_port = port
        self._turn = threading.Lock()
        self._server: LineServer | None = None

    @property
    def port(self) -> int:
        """Where it listens on 127.0.0.1; 0 when it does not."""
        return self._server.port if self._server else 0

    def start(self) -> None:
        """Listen.

        Raises:
            OSError: the port is taken.
        """
        self._server = LineServer(
            self._handle, name="simulator-control", port=self._asked_port
        )

    def stop(self) -> None:
        """Stop listening and close every connection."""
        server, self._server = self._server, None
        if server is not None:
            server.stop()

    def _handle(self, line: bytes, out: Outlet) -> None:
        with self._turn:
            said = answer(line, self._verbs)
        out.write(said)


class ControlClient:
    """One connection to a fault channel.

    Args:
        port: where the simulator listens on 127.0.0.1.
        timeout_s: how long one answer may take.
    """

    def __init__(self, port: int, *, timeout_s: float = 5.0) -> None:
        self._socket = socket.create_connection((LOOPBACK, port), timeout_s)
        self._lines = self._socket.makefile("rb")

    def do(self, verb: str, **arguments: object) -> dict[str, object]:
        """Ask for one thing and return the answer without its ``ok``.

        Raises:
            ControlRefused: the simulator says why it did not do it.
            OSError: it does not answer.
        """
        self._socket.sendall(json.dumps({"do": verb, **arguments}).encode() + b"\n")
        line = self._lines.readline()
        if not line:
            raise ConnectionResetError("the simulator hung up its fault channel")
        said = dict(json.loads(line))
        if not said.pop("ok"):
            raise ControlRefused(str(said.get("message")))
        return said

    def close(self) -> None:
        """Hang up."""
        self._lines.close()
        self._socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
