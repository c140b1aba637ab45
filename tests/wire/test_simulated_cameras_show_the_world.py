"""Pictures of the simulated cameras say when they were exposed; drivers must agree."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from drivers._genicam import installed_backends
from drivers.camera_genicam import GenicamCamera
from drivers.camera_opencv import OpencvCamera
from drivers.simulators.control import ControlClient
from drivers.simulators.gige import GigeSimulator, GigeSimulatorConfig
from drivers.simulators.mjpeg import MjpegSimulator, MjpegSimulatorConfig
from mvp.devices import DeviceContext, Frame
from mvp.errors import ConnectError, DeviceError, DeviceFault, LinkLost
from mvp.testing import refuses, wait_until

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from mvp.devices import Camera

_BITS, _SIDE = 48, 8
_US = 1e6
_GREY = 40


class StampWorld:
    """Writes the moment of its exposure into every picture, as black and white blocks."""

    def __init__(self) -> None:
        self.asked: list[tuple[float, float]] = []
        self.shown = np.zeros((0, 0), np.uint8)

    def report_arm(self, t_s: float, joints: Sequence[float]) -> None: ...

    def report_lens(self, t_s: float, steps: Mapping[str, float]) -> None: ...

    def frame_size(self) -> tuple[int, int]:
        return 8 * _SIDE * 2, _BITS // 8 * _SIDE + 32

    def frame(
        self, start_s: float, exposure_s: float, *, gain: float = 1.0, index: int = 0
    ) -> NDArray[np.uint8]:
        self.asked.append((exposure_s, gain))
        bits = (round(start_s * _US) >> np.arange(_BITS)) & 1
        blocks = np.kron(bits.reshape(-1, 8), np.ones((_SIDE, _SIDE), int)) * 255
        columns, rows = self.frame_size()
        picture = np.full((rows, columns), _GREY, np.uint8)
        picture[: blocks.shape[0], : blocks.shape[1]] = blocks
        self.shown = picture
        return picture


def exposed_s(frame: Frame) -> float:
    """When the picture itself says that its exposure began."""
    rows = np.arange(_BITS // 8) * _SIDE + _SIDE // 2
    columns = np.arange(8) * _SIDE + _SIDE // 2
    bits = (frame.pixels[np.ix_(rows, columns)] > 127).ravel().astype(int)
    return int((bits << np.arange(_BITS)).sum()) / _US


@contextmanager
def _gige(
    world: StampWorld | None, backend: str, slack_s: float = 1.0, **settings: object
) -> Iterator[Any]:
    problem = installed_backends()[backend]
    if problem:
        pytest.skip(problem)
    config = GigeSimulatorConfig.model_validate({"wait_s": 300, **settings})
    context = DeviceContext(world=world)
    simulator = GigeSimulator.from_config(config, context, name="camera")
    try:
        keys = simulator.start()
    except ConnectError as error:
        if "libaravis" in error.message:
            pytest.skip(error.message)
        raise
    try:
        full = GenicamCamera.Config.model_validate(
            {**keys, "backend": backend, "frame_slack_s": slack_s}
        )
        camera = GenicamCamera.from_config(full, DeviceContext(), name="camera")
        with camera, ControlClient(simulator.control_port) as faults:
            yield camera, faults, simulator
    finally:
        simulator.stop()


@contextmanager
def _mjpeg(world: StampWorld | None, **settings: object) -> Iterator[Any]:
    config = MjpegSimulatorConfig.model_validate(
        {"fps": 20, "latency_s": 0.15, **settings}
    )
    context = DeviceContext(world=world)
    with MjpegSimulator.from_config(config, context, name="camera") as simulator:
        keys = OpencvCamera.Config.model_validate(simulator.start())
        camera = OpencvCamera.from_config(keys, DeviceContext(), name="camera")
        with camera, ControlClient(simulator.control_port) as faults:
            yield camera, faults, simulator


def _age_is_kept(camera: Camera, asleep_s: float) -> None:
    """The picture's own stamp, not the driver's word, is what counts."""
    camera.configure(exposure_s=0.01)
    for pause_s in (0.0, asleep_s, 0.0, 0.05):
        time.sleep(pause_s)
        not_before_s = time.monotonic()
        frame = camera.capture(not_before_s=not_before_s, timeout_s=30)
        truly_s = exposed_s(frame)
        assert truly_s >= not_before_s - 1e-6
        assert frame.exposure_start_s <= truly_s + 1e-6
        assert truly_s + frame.exposure_s <= frame.received_s


def test_a_gige_frame_is_as_old_as_the_driver_says(genicam_backend: str) -> None:
    with _gige(StampWorld(), genicam_backend) as (camera, _, _simulator):
        _age_is_kept(camera, 1.0)


def test_a_picture_that_is_long_in_the_making_does_not_cost_the_link(
    genicam_backend: str,
) -> None:
    """A client gives a camera up that is silent for 3 s; this one goes on answering."""
    with _gige(StampWorld(), genicam_backend, slack_s=60.0) as (camera, faults, _):
        camera.configure(exposure_s=0.01)
        faults.do("slow", seconds=5.0)
        camera.capture(not_before_s=time.monotonic(), timeout_s=60)
        faults.do("slow", seconds=0.0)
        camera.capture(not_before_s=time.monotonic(), timeout_s=60)
        assert faults.do("state")["frames"] == 2


def test_a_streamed_frame_is_never_older_than_the_driver_says() -> None:
    with _mjpeg(StampWorld()) as (camera, _, _simulator):
        _age_is_kept(camera, 2.0)


def test_a_busy_computer_does_not_make_streamed_frames_older() -> None:
    ended = threading.Event()

    def busy() -> None:
        while not ended.is_set():
            sum(range(20000))

    worker = threading.Thread(target=busy)
    with _mjpeg(StampWorld()) as (camera, _, _simulator):
        worker.start()
        try:
            _age_is_kept(camera, 0.5)
        finally:
            ended.set()
            worker.join()


def test_the_gige_stream_carries_the_worlds_pixels_unchanged() -> None:
    world = StampWorld()
    with _gige(world, "telegenicam", gain_db_per_raw=2.0) as (camera, _, _simulator):
        camera.configure(exposure_s=0.02, gain=10 ** (6 / 20))
        frame = camera.capture(not_before_s=time.monotonic(), timeout_s=30)
    assert np.array_equal(frame.pixels, world.shown)
    exposure_s, gain = world.asked[-1]
    assert exposure_s == pytest.approx(0.02)
    assert gain == pytest.approx(10 ** (6 / 20))


def test_exposure_set_over_http_reaches_the_world() -> None:
    world = StampWorld()
    with _mjpeg(world) as (camera, _, _simulator):
        camera.configure(exposure_s=0.03, gain=1.5)
        frame = camera.capture(not_before_s=time.monotonic(), timeout_s=30)
    assert frame.exposure_s == pytest.approx(0.03)
    assert world.asked[-1] == (pytest.approx(0.03), pytest.approx(1.5))


def test_jpeg_at_its_default_quality_keeps_flat_grey() -> None:
    with _mjpeg(StampWorld()) as (camera, _, _simulator):
        frame = camera.capture(not_before_s=time.monotonic(), timeout_s=30)
    flat = frame.pixels[-16:, -16:].astype(float)
    assert np.abs(flat - _GREY).max() <= 1


@pytest.mark.parametrize(
    "verb", ["kill", pytest.param("silence", marks=pytest.mark.full)]
)
def test_a_gige_camera_that_is_gone_is_a_lost_link(verb: str) -> None:
    with _gige(None, "telegenicam") as (camera, faults, _simulator):
        camera.capture(not_before_s=time.monotonic(), timeout_s=30)
        faults.do(verb)
        capture = _capture(camera)
        refuses(LinkLost, capture)
        refuses(ConnectError, capture)
        faults.do("restart", serial="OTHER")
        refuses(ConnectError, capture)
        faults.do("restart", serial="SIM-GIGE-1")
        capture()


def test_lost_packets_never_reach_a_picture() -> None:
    with _gige(None, "telegenicam", rows=256, columns=512, packet_size=1400) as bench:
        camera, faults, _simulator = bench
        faults.do("lose", per_thousand=4)
        rows, columns = 256, 512
        ramp = np.add.outer(np.arange(rows), np.arange(columns))
        for _ in range(6):
            try:
                frame = _capture(camera)()
            except DeviceFault:
                continue
            first = int(frame.pixels[0, 0])
            assert np.array_equal(frame.pixels, (ramp + first) % 256)


@pytest.mark.parametrize(
    "fault",
    [
        {"verb": "half", "count": 1},
        {"verb": "stall", "on": True},
        {"verb": "kill"},
    ],
)
def test_a_broken_stream_is_a_lost_link_and_recovers(fault: dict[str, Any]) -> None:
    verb = fault["verb"]
    with _mjpeg(StampWorld()) as (camera, faults, _simulator):
        capture = _capture(camera)
        capture()
        faults.do(verb, **{key: v for key, v in fault.items() if key != "verb"})
        refuses((LinkLost, ConnectError), capture)  # type: ignore[arg-type]
        faults.do("stall", on=False)
        faults.do("restart")
        frame = _until_it_works(capture)
        assert set(np.unique(frame.pixels // 64)) <= {0, 3}


def test_garbage_in_the_stream_is_no_picture() -> None:
    with _mjpeg(StampWorld()) as (camera, faults, _simulator):
        capture = _capture(camera)
        capture()
        faults.do("garbage", count=3)
        frame = _until_it_works(capture)
        assert abs(exposed_s(frame) - frame.received_s) < 60


def test_dropped_pictures_only_cost_time() -> None:
    with _mjpeg(StampWorld()) as (camera, faults, _simulator):
        faults.do("drop", every=2)
        _age_is_kept(camera, 0.1)
        assert int(str(faults.do("state")["dropped"])) > 0


def test_a_gige_process_does_not_outlive_its_parent() -> None:
    script = (
        "import sys, time\n"
        "from drivers.simulators.gige import GigeSimulator, GigeSimulatorConfig\n"
        "simulator = GigeSimulator(GigeSimulatorConfig(wait_s=300), None, 'camera')\n"
        "simulator.start()\n"
        "sys.stdout.write(f'{simulator.pid}\\n')\n"
        "sys.stdout.flush()\n"
        "time.sleep(600)\n"
    )
    if installed_backends()["aravis"]:
        pytest.skip("libaravis is missing")
    with subprocess.Popen(
        [sys.executable, "-c", script], stdout=subprocess.PIPE, text=True
    ) as parent:
        assert parent.stdout is not None
        child = int(parent.stdout.readline())
        parent.send_signal(signal.SIGKILL)
    wait_until(lambda: not _alive(child), "the simulated camera ended")


def _alive(pid: int) -> bool:
    try:
        with open(f"/proc/{pid}/stat") as stat:
            return stat.read().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def _capture(camera: Camera) -> Any:
    return lambda: camera.capture(not_before_s=time.monotonic(), timeout_s=20)


def _until_it_works(capture: Any) -> Frame:
    for _ in range(5):
        try:
            frame: Frame = capture()
        except DeviceError:
            continue
        return frame
    raise AssertionError("it never worked again")


def test_two_simulated_cameras_live_side_by_side() -> None:
    with (
        _gige(None, "telegenicam", serial="ONE", columns=64) as (one, _, first),
        _gige(None, "telegenicam", serial="TWO", columns=96) as (two, _, second),
    ):
        assert first.host != second.host
        for camera, serial, columns in ((one, "ONE", 64), (two, "TWO", 96)):
            assert camera.info().serial == serial
            assert _capture(camera)().pixels.shape[1] == columns
