"""A command left in the controller for a program that cannot obey it now.

A program that a safety stop has paused goes on with its motion once the stop is over, and
where there is no dashboard nobody can end it before. Its command register is read in
every cycle: what was left there ends it in the first one, with nobody connected.
"""

from __future__ import annotations

import contextlib
import socket
import struct
import threading
from typing import TYPE_CHECKING

from drivers._ur.version import PORT, Question
from mvp.errors import DeviceError

if TYPE_CHECKING:
    from mvp.devices import Clock

_PROTOCOL, _INPUTS, _DATA = 86, 73, 85
_END_OF_PROGRAM = 255
_TYPE = b"INT32"
_UPPER = 24
_CONNECT_S = 0.5
_TRY_AGAIN_S = 0.05


def leave_end_of_program(
    host: str, *, name: str, clock: Clock, upper: bool, timeout_s: float = 1.0
) -> bool:
    """Leave the command that ends our control program; whether it was taken.

    Nothing moves by it. The connection that owned the register may need a moment to be
    gone, so it is tried until ``timeout_s``.

    Args:
        host: of the controller.
        name: of the device, for errors.
        clock: real time.
        upper: the program reads the upper range of registers.
        timeout_s: for everything.
    """
    register = f"input_int_register_{_UPPER if upper else 0}".encode()
    until_s, never = clock.now_s() + timeout_s, threading.Event()
    while clock.now_s() < until_s:
        with (
            contextlib.suppress(DeviceError, OSError),
            socket.create_connection((host, PORT), _CONNECT_S) as link,
        ):
            _tell(Question(link, clock, until_s, name), register)
            return True
        clock.wait(never, _TRY_AGAIN_S)
    return False


def _tell(asking: Question, register: bytes) -> None:
    """Take the register and write to it; an owner elsewhere makes the answer another."""
    asking.ask(_PROTOCOL, struct.pack(">H", 2), answer_bytes=1)
    answer = asking.ask(_INPUTS, register, answer_bytes=1 + len(_TYPE))
    asking.send(_DATA, struct.pack(">Bi", answer[0], _END_OF_PROGRAM))
    asking.link.shutdown(socket.SHUT_WR)
    # The controller hangs up in its turn, once it has read what was sent.
    with contextlib.suppress(OSError):
        asking.link.recv(1)
