"""The process that hosts the client library: ``python -m drivers._ur.worker``.

Reads requests from stdin, writes answers to stdout (see ``messages``). Ends at the end
of stdin, and at once when the link breaks: the library would reconnect for ever,
restarting the robot's program each time, until it crashes.
"""

from __future__ import annotations

import os
import queue
import signal
import sys
import threading
import time
from typing import TYPE_CHECKING, BinaryIO, Literal, NoReturn, cast

from drivers._ur.codes import PLAYING, STOPPED
from drivers._ur.messages import LONGEST, STARTED_AGAIN, Message, decode, encode
from drivers._ur.robot import Listener, Mover
from drivers._ur.status import Implausible, Status

if TYPE_CHECKING:
    from collections.abc import Mapping

_WATCH_S = 0.004
_REPORT_S = 0.008
_POLL_S = 0.01
_LOST = 3
_ENDING_S = 0.5
_SAME_TOOL = 1e-6  # m and rad


class Worker:
    """Carries out requests one after the other; a stop overtakes a motion."""

    def __init__(self, output: BinaryIO) -> None:
        self._output = output
        self._writing = threading.Lock()
        self._requests: queue.Queue[Message] = queue.Queue()
        self._listener: Listener | None = None
        self._mover: Mover | None = None
        self._silent_s = 0.0
        self._tool_point: list[float] = []
        self._program: Literal["starts", "runs", "ended"] = "starts"
        self._does = {
            "listen": self._listen,
            "control": self._control,
            "tool": self._tool,
            "move": self._move,
            "stop": self._stop,
            "leave": self._leave,
        }

    def serve(self, lines: BinaryIO) -> None:
        """Take requests until the driver hangs up, then leave the robot standing."""
        self._say({"hello": os.getpid()})
        threading.Thread(target=self._work, name="control", daemon=True).start()
        while line := lines.readline(LONGEST):
            self._requests.put(decode(line))
        self._requests.put({"id": 0, "do": "leave"})
        time.sleep(_LOST)
        os._exit(_LOST)

    def _say(self, message: Mapping[str, object]) -> None:
        with self._writing:
            self._output.write(encode(message))
            self._output.flush()

    def _answer(self, request: Message, **result: object) -> None:
        self._say({"id": request["id"], "ok": True, **result})

    def _work(self) -> None:
        while True:
            request = self._requests.get()
            try:
                self._does[str(request["do"])](request)
            except Exception as error:
                kind = type(error).__name__
                refusal = {"ok": False, "kind": kind, "message": str(error)}
                self._say({"id": request["id"], **refusal})

    def _lose(self, why: str) -> NoReturn:
        """Say why and end without any destructor: theirs block, or crash."""
        self._say({"lost": why})
        os._exit(_LOST)

    def _listen(self, request: Message) -> None:
        self._silent_s = _number(request["silent_s"])
        listener = Listener(
            str(request["host"]),
            _number(request["frequency_hz"]),
            payload=bool(request["payload"]),
        )
        self._listener = listener
        status = listener.status()
        self._answer(request, status=status.to_wire())
        threading.Thread(target=self._watch, name="watch", daemon=True).start()

    def _control(self, request: Message) -> None:
        flags = cast("list[str]", request["flags"])
        self._mover = Mover(
            str(request["host"]), _number(request["frequency_hz"]), flags
        )
        self._answer(request)

    def _tool(self, request: Message) -> None:
        found = self._moving().set_tool(
            _numbers(request["tcp_m_rad"]),
            _number(request["payload_kg"]),
            _numbers(request["payload_cog_m"]),
        )
        self._tool_point = found
        self._answer(request, tcp_m_rad=found)

    def _move(self, request: Message) -> None:
        """One motion; the answer comes when it has ended, in whatever way."""
        mover = self._moving()
        unfit = self._tool_unfit(mover)
        if unfit:
            self._answer(request, ended=unfit)
            return
        if self._overtaken(mover):
            self._answer(request, ended="stopped")
            return
        taken = mover.begin(
            _numbers(request["target_rad"]),
            _number(request["speed_rad_s"]),
            _number(request["acceleration_rad_s2"]),
        )
        if not taken:
            self._answer(request, ended="refused")
            return
        while mover.moving():
            if self._overtaken(mover, wait_s=_POLL_S):
                self._answer(request, ended="stopped")
                return
        self._answer(request, ended="finished")

    def _tool_unfit(self, mover: Mover) -> str:
        """Why nothing may move with the tool that is set now; empty for as it was set."""
        try:
            found = mover.tool()
        except RuntimeError:
            return "refused"
        off = [abs(a - b) for a, b in zip(found, self._tool_point, strict=False)]
        same = len(off) == len(found) == len(self._tool_point)
        return "" if same and max(off, default=0.0) <= _SAME_TOOL else "retooled"

    def _overtaken(self, mover: Mover, *, wait_s: float = 0.0) -> bool:
        """Whether a stop came in; it has been carried out then."""
        try:
            other = self._requests.get(timeout=wait_s) if wait_s else self._next()
        except queue.Empty:
            return False
        if other["do"] == "leave":
            self._leave(other)
        if other["do"] != "stop":
            refusal = {"ok": False, "kind": "Busy", "message": "a motion is running"}
            self._say({"id": other["id"], **refusal})
            return False
        self._stop(other)
        return True

    def _next(self) -> Message:
        return self._requests.get_nowait()

    def _stop(self, request: Message) -> None:
        """Answered when it is handed over, not when it stands."""
        self._answer(request)
        if self._mover is not None:
            self._mover.brake(_number(request["deceleration_rad_s2"]))

    def _leave(self, request: Message) -> NoReturn:
        """Leave the robot standing, without a program, and end."""
        mover = self._mover
        if mover is not None and self._playing():
            mover.brake(_number(request.get("deceleration_rad_s2", 2.0)))
            mover.end_program()
        if request["id"]:
            self._answer(request, over=self._ended())
        os._exit(0)

    def _moving(self) -> Mover:
        if self._mover is None:
            raise RuntimeError("not connected for control")
        return self._mover

    def _playing(self) -> bool:
        listener = self._listener
        return listener is not None and listener.status().runtime_state == PLAYING

    def _ended(self) -> bool:
        """Whether no program is left, not even one that waits; seen within half a second."""
        listener = self._listener
        end = time.monotonic() + _ENDING_S
        while listener is not None and time.monotonic() < end:
            if listener.status().runtime_state == STOPPED:
                return True
            time.sleep(_POLL_S)
        return listener is None

    def _watch(self) -> None:
        """Report every new frame; end the process when the link is no longer sound."""
        stamp_s, seen_s, said_s = 0.0, time.monotonic(), 0.0
        while True:
            time.sleep(_WATCH_S)
            listener, mover = self._listener, self._mover
            if listener is None:
                continue
            if not listener.connected:
                self._lose("the robot closed the data connection")
            if mover is not None and not mover.connected:
                self._lose("the robot closed the control connection")
            now = time.monotonic()
            if listener.timestamp_s() != stamp_s:
                seen_s = now
            elif now - seen_s > self._silent_s:
                self._lose(f"no data for {now - seen_s:.1f} s")
            if listener.timestamp_s() != stamp_s and now - said_s > _REPORT_S:
                status = self._sound(listener)
                stamp_s, said_s = status.t_controller_s, now
                self._note_program(status)
                self._say({"status": status.to_wire()})

    def _sound(self, listener: Listener) -> Status:
        try:
            return listener.status()
        except Implausible as error:
            self._lose(f"the robot's data make no sense: {error}")

    def _note_program(self, status: Status) -> None:
        """Our program may end, once; whoever starts it again may start its motion."""
        if self._mover is None:
            return
        playing = status.runtime_state == PLAYING
        if self._program == "ended" and playing:
            self._lose(STARTED_AGAIN)
        if playing:
            self._program = "runs"
        elif self._program == "runs" and status.runtime_state == STOPPED:
            self._program = "ended"


def _number(value: object) -> float:
    return float(cast("float", value))


def _numbers(values: object) -> list[float]:
    return [float(value) for value in cast("list[float]", values)]


def main() -> None:
    """Serve the driver that started this process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    # The library talks on stdout too; answers get a descriptor of their own.
    output = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    Worker(output).serve(sys.stdin.buffer)


if __name__ == "__main__":
    main()
