"""What the process of a simulated device does alike: it speaks, sees, and is ended."""

from __future__ import annotations

import json
import os
import sys
import threading
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from drivers.simulators.world_port import WorldPort


def say(line: Mapping[str, object]) -> None:
    """One line of JSON for whoever started it."""
    sys.stdout.write(json.dumps(line) + "\n")
    sys.stdout.flush()


def world_at(address: str) -> WorldPort | None:
    """The world over its loopback link; None where no HOST:PORT was named."""
    if not address:
        return None
    from drivers.simulators.world_link import WorldClient

    return WorldClient(address)


def watch_stdin(end: Callable[[], object]) -> None:
    """Call ``end`` from a thread when the parent's pipe closes, as it does when it dies."""

    def watch() -> None:
        while os.read(sys.stdin.fileno(), 4096):
            pass
        end()

    threading.Thread(target=watch, name="parent-watch", daemon=True).start()
