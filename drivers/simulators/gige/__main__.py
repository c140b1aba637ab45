"""The process of one simulated camera: ``python -m drivers.simulators.gige``.

It prints one line of JSON when it listens, ``{"ready": true, "address": "127.0.0.9",
"control_port": 40001, ...}``, and runs until it is told to end, or until its standard
input closes where it was started with ``--end-with-stdin``.
"""

from __future__ import annotations

import argparse
import logging
import os
import signal
import sys
import threading
from typing import TYPE_CHECKING

from drivers.simulators.control import ControlServer
from drivers.simulators.gige.address import CameraProblem, free_address
from drivers.simulators.gige.fake_camera import FakeCamera
from drivers.simulators.gige.painter import Painter
from drivers.simulators.process_main import say, watch_stdin, world_at

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivers.simulators.control import Verb


def main(arguments: list[str] | None = None) -> int:
    """Run until told to end."""
    options = _parser().parse_args(arguments)
    logging.basicConfig(level=options.log_level, stream=sys.stderr)
    ended = _end_event(with_stdin=options.end_with_stdin)
    try:
        _serve(options, ended)
    except (CameraProblem, OSError) as error:
        say({"ready": False, "message": str(error)})
        return 1
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m drivers.simulators.gige")
    add = parser.add_argument
    add("--host", default="auto", help="loopback address, or auto for a free one")
    add("--serial", default="SIM-GIGE-1")
    add("--columns", type=int, default=640, help="px, where no world says it")
    add("--rows", type=int, default=480, help="px, where no world says it")
    add("--gain-db-per-raw", type=float, default=1.0)
    add("--lost-per-thousand", type=float, default=0.0, help="stream packets")
    add("--wait", type=float, default=60.0, help="s until 127.0.0.1 is free to start")
    add("--control-port", type=int, default=0, help="of the fault channel")
    add("--world", default="", help="HOST:PORT of the world that the camera sees")
    add("--end-with-stdin", action="store_true")
    add("--log-level", default="WARNING")
    return parser


def _serve(options: argparse.Namespace, ended: threading.Event) -> None:
    """Appear, say so, and stay until told to end."""
    world = world_at(options.world)
    size = world.frame_size() if world else (options.columns, options.rows)
    painter = Painter(world, size, options.gain_db_per_raw)
    host = free_address() if options.host == "auto" else options.host
    camera = FakeCamera(host, options.serial, size, painter, wait_s=options.wait)
    camera.start()
    camera.lose(options.lost_per_thousand)
    faults = ControlServer(_verbs(camera, painter), port=options.control_port)
    faults.start()
    try:
        say(
            {
                "ready": True,
                "address": host,
                "serial": options.serial,
                "control_port": faults.port,
                "columns": size[0],
                "rows": size[1],
                "pid": os.getpid(),
            }
        )
        ended.wait()
    finally:
        faults.stop()
        painter.interrupt()
        camera.end()


def _verbs(camera: FakeCamera, painter: Painter) -> dict[str, Verb]:
    """Faults: what can happen to a camera on a network.

    ``kill``, ``silence``, ``restart`` (``serial``), ``lose`` (``per_thousand``),
    ``slow`` (``seconds`` more per frame) and ``state``.
    """

    def restart(asked: Mapping[str, object]) -> None:
        camera.serial = str(asked.get("serial", camera.serial))
        camera.start()

    def slow(asked: Mapping[str, object]) -> None:
        painter.delay_s = float(str(asked["seconds"]))

    return {
        "kill": lambda asked: camera.kill(),
        "silence": lambda asked: camera.silence(),
        "restart": restart,
        "lose": lambda asked: camera.lose(float(str(asked["per_thousand"]))),
        "slow": slow,
        "state": lambda asked: {
            "running": camera.running,
            "serial": camera.serial,
            "frames": painter.frames,
            "exposure_us": painter.last_exposure_us,
        },
    }


def _end_event(*, with_stdin: bool) -> threading.Event:
    """Set by a signal, or when the parent's pipe closes."""
    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())
    if with_stdin:
        watch_stdin(ended.set)
    return ended


if __name__ == "__main__":
    sys.exit(main())
