"""The process of one simulated controller: ``python -m drivers.simulators.ur``.

It prints one line of JSON when it listens, ``{"ready": true, "host": "127.0.0.2",
"control_port": 40001, ...}``, and runs until it is told to end, or until its standard
input closes where it was started with ``--end-with-stdin``.
"""

from __future__ import annotations

import argparse
import asyncio
import logging
import os
import signal
import sys

from drivers.simulators.process_main import say, watch_stdin, world_at
from drivers.simulators.ur.faults import serve
from drivers.simulators.ur.profiles import DEFAULT_PROFILE, PROFILES
from drivers.simulators.ur.robot import HOME, Robot, RobotSettings
from drivers.simulators.ur.server import Controller, listen_somewhere
from mvp.kinematics import ARM_MODELS

_MODELS = [name for name in ARM_MODELS if name.startswith("ur")]
_LAST_HOST = 254


def main(arguments: list[str] | None = None) -> int:
    """Run until told to end."""
    options = _parser().parse_args(arguments)
    logging.basicConfig(level=options.log_level, stream=sys.stderr)
    try:
        asyncio.run(_serve(options))
    except OSError as error:
        hint = "is the address in use? host = 'auto' takes a free one"
        say({"ready": False, "message": str(error), "hint": hint})
        return 1
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m drivers.simulators.ur")
    add = parser.add_argument
    add("--host", default="auto", help="loopback address, or auto for a free one")
    add("--profile", default=DEFAULT_PROFILE, choices=sorted(PROFILES))
    add("--model", default="ur5e", choices=_MODELS)
    add("--joints", type=float, nargs=6, default=HOME, help="rad, at the start")
    add("--speed-scale", type=float, default=1.0)
    add("--serial", default="20225500123")
    add("--on-protective-stop", default="pause", choices=("pause", "stop"))
    add("--unlock-delay", type=float, default=5.0, help="s")
    add("--script-start", type=float, default=0.05, help="s from upload to program")
    add("--local", action="store_true", help="start in local mode")
    add("--control-port", type=int, default=0, help="of the fault channel")
    add("--world", default="", help="HOST:PORT of the world that sees the arm")
    add("--end-with-stdin", action="store_true")
    add("--log-level", default="WARNING")
    return parser


def _robot(options: argparse.Namespace) -> Robot:
    return Robot(
        RobotSettings(
            model=options.model,
            profile=options.profile,
            joints_rad=tuple(options.joints),
            speed_scale=options.speed_scale,
            serial=options.serial,
            on_protective_stop=options.on_protective_stop,
            unlock_delay_s=options.unlock_delay,
            script_start_s=options.script_start,
            remote=not options.local,
        )
    )


async def _serve(options: argparse.Namespace) -> None:
    """Listen, say so, and keep the cycle until told to end."""
    controller = Controller(_robot(options), "", world_at(options.world))
    try:
        await listen_somewhere(controller, _hosts(options.host))
        faults = await serve(controller, options.control_port)
        ended = _end_event(with_stdin=options.end_with_stdin)
        cycle = asyncio.create_task(controller.run())
        say(
            {
                "ready": True,
                "host": controller.host,
                "control_port": faults.sockets[0].getsockname()[1],
                "profile": options.profile,
                "model": options.model,
                "pid": os.getpid(),
            }
        )
        await asyncio.wait(
            [cycle, asyncio.create_task(ended.wait())],
            return_when=asyncio.FIRST_COMPLETED,
        )
        faults.close()
        if cycle.done():
            cycle.result()
        cycle.cancel()
    finally:
        controller.close()


def _hosts(host: str) -> list[str]:
    """Addresses to try; an automatic choice begins where others hardly do."""
    if host != "auto":
        return [host]
    count = _LAST_HOST - 1
    first = os.getpid() % count
    return [f"127.0.0.{2 + (first + k) % count}" for k in range(count)] + ["127.0.0.1"]


def _end_event(*, with_stdin: bool) -> asyncio.Event:
    """Set by a signal, or when the parent's pipe closes."""
    ended = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, ended.set)
    if with_stdin:
        watch_stdin(lambda: loop.call_soon_threadsafe(ended.set))
    return ended


if __name__ == "__main__":
    sys.exit(main())
