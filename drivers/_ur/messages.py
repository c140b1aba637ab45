"""Lines between the driver and its worker: one JSON object each.

Driver to worker: ``{"id": 7, "do": "move", ...}``. Worker to driver: the answer
``{"id": 7, "ok": true, ...}`` or ``{"id": 7, "ok": false, "kind", "message"}``; in
between ``{"status": {...}}``, and ``{"lost": "why"}`` as the last words of a worker.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Mapping

Message: TypeAlias = dict[str, object]
STARTED_AGAIN = "the program on the robot was started again by somebody else"
LONGEST = 65536


class Unreadable(ValueError):
    """A line that is no message."""


def encode(message: Mapping[str, object]) -> bytes:
    """One line. NaN is spelled as Python does; both ends are Python."""
    return json.dumps(message, separators=(",", ":")).encode() + b"\n"


def decode(line: bytes) -> Message:
    """The message of one line.

    Raises:
        Unreadable: it is none.
    """
    try:
        found = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise Unreadable(f"no JSON: {line[:80]!r}") from error
    if not isinstance(found, dict):
        raise Unreadable(f"no object: {line[:80]!r}")
    return found
