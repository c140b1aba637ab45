"""Programs sent as text: where there is no dashboard, the way to end another program."""

from __future__ import annotations

import contextlib
import socket

from mvp.errors import ConnectError

PORT = 30003
_CHUNK = 65536


def send_brake(
    host: str, deceleration_rad_s2: float, *, name: str, timeout_s: float = 1.0
) -> None:
    """Put a program that only brakes in the place of whatever runs; nothing begins.

    A controller that is stopped for safety may ignore it: whether it was taken up shows
    in the state of the robot alone.

    Raises:
        ConnectError: the controller does not take it.
    """
    program = f"def mvp_cell_stop():\n  stopj({deceleration_rad_s2:.3f})\nend\n"
    try:
        with socket.create_connection((host, PORT), timeout_s) as link:
            link.sendall(program.encode("ascii"))
            link.shutdown(socket.SHUT_WR)
            # Closed with its own stream unread, the line would be reset, and the
            # program lost on its way.
            with contextlib.suppress(TimeoutError):
                link.settimeout(timeout_s / 4)
                while link.recv(_CHUNK):
                    pass
    except OSError as error:
        raise ConnectError(
            f"no program can be sent to {host}:{PORT} ({error})",
            device=name,
            hint="stop the program on the pendant",
        ) from error
