"""A network camera on 127.0.0.1: motion JPEG over HTTP, exposure set by a URL.

``GET /video`` is an endless ``multipart/x-mixed-replace`` of JPEG pictures, and
``GET /control?exposure_us=8000&gain=1`` sets both and answers with what is in force.
JPEG costs measurement: at quality 97 (95; 100) a grey value changes by 0.85 (0.95; 0.3)
of 255 levels and the place of an edge in one row by 0.09 (0.10; 0.03) px, one standard
deviation each, on steps of 140 levels with noise of one level; a line fitted through 256
rows moves by 0.005 px. For lossless pictures there is the simulator ``gige``.
"""

from __future__ import annotations

import contextlib
import json
import logging
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import TYPE_CHECKING, ClassVar, Self, cast
from urllib.parse import parse_qs, urlsplit

import numpy as np

from drivers.simulators.control import ControlServer
from drivers.simulators.line_server import LOOPBACK
from drivers.simulators.mjpeg_shutter import Faults, MjpegSimulatorConfig, Shutter
from mvp.errors import ConnectError

if TYPE_CHECKING:
    import socket
    from collections.abc import Mapping

    from drivers.simulators.control import Verb
    from drivers.simulators.world_port import WorldPort
    from mvp.devices import DeviceContext

_LOG = logging.getLogger(__name__)
_US = 1e6
_BOUNDARY = "frame"
_POLL_S = 0.02


class MjpegSimulator:
    """A network camera with its fault channel."""

    key: ClassVar[str] = "mjpeg"
    own_process: ClassVar[bool] = False
    Config = MjpegSimulatorConfig

    def __init__(
        self, config: MjpegSimulatorConfig, world: WorldPort | None, name: str
    ) -> None:
        self.name = name
        self._config = config
        self.shutter = Shutter(config, world)
        self._server: _Server | None = None
        self._thread: threading.Thread | None = None
        self._port = config.port
        self._control = ControlServer(self._verbs())

    @classmethod
    def from_config(
        cls, config: MjpegSimulatorConfig, context: DeviceContext, *, name: str
    ) -> Self:
        """Build it; starts nothing."""
        seen = context.world if hasattr(context.world, "frame_size") else None
        return cls(config, cast("WorldPort | None", seen), name)

    @property
    def control_port(self) -> int:
        """Of the fault channel on 127.0.0.1; 0 while it does not run."""
        return self._control.port

    def start(self) -> dict[str, object]:
        """Listen; the keys for the camera's table of the cell file.

        Raises:
            ConnectError: the port is taken.
        """
        if self._control.port == 0:
            self.shutter.start()
            try:
                self._listen()
            except OSError as error:
                self.stop()
                raise ConnectError(
                    f"the simulator cannot listen on port {self._config.port}: "
                    f"{error.strerror}",
                    device=self.name,
                    hint="give another port in [simulators.camera], or 0 for any",
                ) from error
            self._control.start()
        config, base = self._config, f"http://{LOOPBACK}:{self._port}"
        query = "exposure_us={exposure_us}&gain={gain}"
        return {
            "source": f"{base}/video",
            "control_url": f"{base}/control?{query}",
            "fps": config.fps,
            "period_s": max(1 / config.fps, config.latency_s),
            "exposure_min_s": config.exposure_min_s,
            "exposure_max_s": config.exposure_max_s,
            "read_timeout_s": max(2.0, 8 * config.latency_s),
            "serial": config.serial,
        }

    def stop(self) -> None:
        """Hang up on everybody; safe to repeat."""
        self._control.stop()
        self.shutter.stop()
        self._hang_up()
        self._port = self._config.port

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *exc: object) -> None:
        self.stop()

    def set_exposure(self, exposure_us: float, gain: float) -> None:
        """Take both over from the next exposure on.

        Raises:
            ValueError: out of range.
        """
        low, high = self._config.exposure_min_s, self._config.exposure_max_s
        exposure_s = exposure_us / _US
        if not low <= exposure_s <= high or not 0 < gain <= 64:
            raise ValueError("out of range")
        self.shutter.exposure_s, self.shutter.gain = exposure_s, gain

    def _listen(self) -> None:
        self._server = _Server(self, self._port)
        self._port = self._server.server_address[1]
        self._thread = threading.Thread(
            target=self._server.serve_forever,
            kwargs={"poll_interval": _POLL_S},
            name="mjpeg-server",
        )
        self._thread.start()

    def _hang_up(self) -> None:
        server, self._server = self._server, None
        if server is None or self._thread is None:
            return
        server.shutdown()
        server.hang_up()
        server.server_close()
        self._thread.join()

    def _verbs(self) -> dict[str, Verb]:
        """Faults: what network cameras do.

        ``stall`` (``on``), ``drop`` (``every``), ``garbage`` and ``half`` (``count`` of
        pictures), ``slow`` (``bytes_per_s``; 0 ends it), ``kill``, ``restart`` and
        ``state``.
        """
        faults = self.shutter.faults

        def put(name: str, key: str, kind: type) -> Verb:
            def verb(asked: Mapping[str, object]) -> None:
                setattr(faults, name, kind(asked[key]))

            return verb

        def restart(_asked: Mapping[str, object]) -> None:
            self._hang_up()
            self._listen()

        return {
            "stall": put("stalled", "on", bool),
            "drop": put("drop_every", "every", int),
            "garbage": put("garbage", "count", int),
            "half": put("half", "count", int),
            "slow": put("bytes_per_s", "bytes_per_s", float),
            "kill": lambda asked: self._hang_up(),
            "restart": restart,
            "state": lambda asked: {
                "frames": self.shutter.number,
                "dropped": self.shutter.dropped,
                "watchers": self.shutter.watchers,
                "exposure_us": self.shutter.exposure_s * _US,
                "gain": self.shutter.gain,
            },
        }


class _Server(ThreadingHTTPServer):
    daemon_threads = False
    allow_reuse_address = True

    def __init__(self, camera: MjpegSimulator, port: int) -> None:
        self.camera = camera
        self.turn = threading.Lock()
        self.connections: set[socket.socket] = set()
        self.ended = threading.Event()
        super().__init__((LOOPBACK, port), _Handler)

    def hang_up(self) -> None:
        """Let every connection's thread end."""
        self.ended.set()
        with self.turn:
            for connection in self.connections:
                with contextlib.suppress(OSError):
                    connection.shutdown(2)

    def handle_error(self, request: object, client_address: object) -> None:
        """Clients that leave are no news."""
        _LOG.debug("client %s left", client_address)


class _Handler(BaseHTTPRequestHandler):
    server: _Server

    def do_GET(self) -> None:
        """Serve the stream or the control page."""
        page = urlsplit(self.path)
        with self.server.turn:
            self.server.connections.add(self.connection)
        try:
            if page.path == "/video":
                self._video()
            elif page.path == "/control":
                self._control(parse_qs(page.query))
            else:
                self.send_error(404)
        finally:
            with self.server.turn:
                self.server.connections.discard(self.connection)

    def log_message(self, format: str, *values: object) -> None:
        """Requests are for the debug log."""
        _LOG.debug(format, *values)

    def _control(self, query: dict[str, list[str]]) -> None:
        camera = self.server.camera
        try:
            camera.set_exposure(float(query["exposure_us"][0]), float(query["gain"][0]))
        except (KeyError, ValueError) as error:
            self.send_error(400, str(error))
            return
        shutter = camera.shutter
        said = {"exposure_us": shutter.exposure_s * _US, "gain": shutter.gain}
        body = json.dumps(said).encode()
        self.send_response(200)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def _video(self) -> None:
        self.send_response(200)
        kind = f"multipart/x-mixed-replace; boundary={_BOUNDARY}"
        self.send_header("Content-Type", kind)
        self.end_headers()
        shutter = self.server.camera.shutter
        with self.server.turn:
            shutter.watchers += 1
        try:
            self._pictures(shutter)
        except OSError:
            _LOG.debug("a watcher left")
        finally:
            with self.server.turn:
                shutter.watchers -= 1

    def _pictures(self, shutter: Shutter) -> None:
        seen = shutter.number
        while not (shutter.ending or self.server.ended.is_set()):
            new = shutter.wait(seen)
            if new is None:
                seen = shutter.number
                continue
            seen, jpeg = new
            if shutter.faults.take("garbage"):
                jpeg = bytes(np.random.default_rng(seen).bytes(len(jpeg)))
            if not self._send(jpeg, shutter.faults):
                return

    def _send(self, jpeg: bytes, faults: Faults) -> bool:
        """One part of the stream; False when it broke off in the middle."""
        head = (
            f"--{_BOUNDARY}\r\nContent-Type: image/jpeg\r\n"
            f"Content-Length: {len(jpeg)}\r\n\r\n"
        )
        self.wfile.write(head.encode())
        if faults.take("half"):
            self.wfile.write(jpeg[: len(jpeg) // 2])
            return False
        step = 4096 if faults.bytes_per_s else len(jpeg)
        for begin in range(0, len(jpeg), step):
            self.wfile.write(jpeg[begin : begin + step])
            if faults.bytes_per_s and self.server.ended.wait(step / faults.bytes_per_s):
                return False
        self.wfile.write(b"\r\n")
        return True
