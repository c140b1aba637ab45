"""Ages of queued frames, exposure controls and replays of the OpenCV driver."""

from __future__ import annotations

import math
import socket
import threading
from http.server import BaseHTTPRequestHandler, HTTPServer
from typing import TYPE_CHECKING, ClassVar

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers._opencv import HttpExposure, V4l2Exposure, kind_of
from drivers._opencv.controls import in_force
from drivers._opencv.grey import as_grey
from drivers._opencv.reader import ArrivalBound
from drivers._opencv.replay import Replay
from drivers._opencv.source import keep_newest
from drivers.camera_opencv import OpencvCamera
from mvp.devices import DeviceContext
from mvp.errors import ConnectError, DeviceFault, LimitError, LinkLost, WireError
from mvp.testing import refuses
from tests.fuzzing import Mutants, fuzz

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_PERIOD_S = 0.1


@given(
    st.lists(st.floats(0.6, 3.0), min_size=3, max_size=60),
    st.lists(st.floats(0.0, 0.4), min_size=60, max_size=60),
    st.lists(st.one_of(st.just(0.0), st.floats(0, 8.0)), min_size=60, max_size=60),
)
def test_a_frame_never_arrived_before_its_bound(
    gaps: list[float], decoding: list[float], pauses: list[float]
) -> None:
    """A queue played through: frames come at their times, the reader when it can."""
    arrivals = np.cumsum(gaps) * _PERIOD_S
    bound = ArrivalBound(_PERIOD_S)
    now_s = 0.0
    for arrived_s, decode, pause in zip(arrivals, decoding, pauses, strict=False):
        began_s = now_s + pause * _PERIOD_S
        ended_s = max(began_s, float(arrived_s)) + decode * _PERIOD_S
        earliest_s = bound.of_grab(began_s, ended_s)
        # Decoding is part of what two periods of slack are for.
        assert earliest_s <= arrived_s + decode * _PERIOD_S + 1e-9
        now_s = ended_s


def test_an_idle_reader_knows_arrivals_exactly() -> None:
    bound = ArrivalBound(_PERIOD_S)
    moments = [bound.of_grab(k * 0.1, k * 0.1 + 0.099) for k in range(5)]
    assert moments[0] == -np.inf
    assert moments[1:] == pytest.approx([k * 0.1 + 0.099 for k in range(1, 5)])


@pytest.mark.parametrize(
    ("source", "kind"),
    [
        ("rtsp://10.0.0.3/stream", "stream"),
        ("http://127.0.0.1:8080/video", "stream"),
        ("/dev/video0", "v4l2"),
        ("/dev/v4l/by-id/usb-Maker_Camera-video-index0", "v4l2"),
        ("0", "v4l2"),
        ("film.avi", "file"),
        ("pictures", "folder"),
    ],
)
def test_an_address_says_what_it_is(tmp_path: Path, source: str, kind: str) -> None:
    (tmp_path / "pictures").mkdir()
    assert kind_of(source, tmp_path) == kind


def _camera(folder: Path, **settings: object) -> OpencvCamera:
    config = OpencvCamera.Config.model_validate(settings)
    return OpencvCamera.from_config(config, DeviceContext(folder=folder), name="camera")


def test_a_folder_is_replayed_in_order_and_ends_with_a_fault(tmp_path: Path) -> None:
    for level in (10, 20, 30):
        cv2.imwrite(str(tmp_path / f"{level}.png"), np.full((4, 6), level, np.uint8))
    (tmp_path / "notes.txt").write_text("no picture")
    with _camera(tmp_path, source=".", fixed_exposure_s=0.001) as camera:
        levels = [
            int(camera.capture(not_before_s=0, timeout_s=5).pixels[0, 0])
            for _ in range(3)
        ]
        error = refuses(
            DeviceFault, lambda: camera.capture(not_before_s=0, timeout_s=5)
        )
    assert levels == [10, 20, 30]
    assert error.code == "end"


def test_a_reading_error_without_a_number_still_says_why(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def torn(*given: object) -> None:
        raise OSError("3 bytes of 7 read")

    cv2.imwrite(str(tmp_path / "a.png"), np.full((4, 6), 10, np.uint8))
    pictures = Replay(tmp_path, loop=True, device="camera")
    pictures.open()
    monkeypatch.setattr(np, "fromfile", torn)
    with pytest.raises(LinkLost, match="any more: 3 bytes of 7 read"):
        pictures.next()


def test_sixteen_bit_pictures_stay_sixteen_bit(tmp_path: Path) -> None:
    picture = np.arange(24, dtype=np.uint16).reshape(4, 6) * 2000
    cv2.imwrite(str(tmp_path / "a.png"), picture)
    with _camera(tmp_path, source=".", fixed_exposure_s=0.001) as camera:
        frame = camera.capture(not_before_s=0, timeout_s=5)
    assert np.array_equal(frame.pixels, picture)
    assert frame.full_scale == 65535


@pytest.mark.parametrize("source", ["nothing.avi", "/dev/video77", "empty"])
def test_what_is_not_there_does_not_open(tmp_path: Path, source: str) -> None:
    (tmp_path / "empty").mkdir()
    error = refuses(ConnectError, _camera(tmp_path, source=source).open)
    assert error.hint


def test_an_exposure_that_cannot_be_set_is_not_accepted(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((4, 6), np.uint8))
    with _camera(tmp_path, source=".", fixed_exposure_s=0.02) as camera:
        assert camera.exposure_range_s() == (0.02, 0.02)
        camera.configure(exposure_s=0.02)
        refuses(LimitError, lambda: camera.configure(exposure_s=0.021))
        refuses(LimitError, lambda: camera.configure(exposure_s=0.02, gain=2.0))


def test_gamma_makes_grey_linear_and_keeps_black_and_white() -> None:
    coded = np.arange(256, dtype=np.uint8).reshape(16, 16)
    grey, full = as_grey(coded, 2.2)
    assert full == 255
    assert (grey[0, 0], grey[-1, -1]) == (0, 255)
    assert abs(int(grey.ravel()[186]) - 127) <= 2


class _Answer(BaseHTTPRequestHandler):
    body: ClassVar[bytes] = b"{}"

    def do_GET(self) -> None:
        self.send_response(200)
        self.end_headers()
        self.wfile.write(self.body)

    def log_message(self, format: str, *values: object) -> None: ...


@pytest.fixture
def http_camera() -> Iterator[HttpExposure]:
    server = HTTPServer(("127.0.0.1", 0), _Answer)
    thread = threading.Thread(target=server.serve_forever, args=(0.01,))
    thread.start()
    url = f"http://127.0.0.1:{server.server_port}/?e={{exposure_us}}&g={{gain}}"
    yield HttpExposure(url, (1e-4, 0.5), 5.0, "camera")
    server.shutdown()
    server.server_close()
    thread.join()


def test_what_a_network_camera_answers_is_compared(http_camera: HttpExposure) -> None:
    _Answer.body = b'{"exposure_us": 8000, "gain": 1}'
    assert http_camera.apply(0.008, 1.0) == pytest.approx((0.008, 1.0))
    error = refuses(DeviceFault, lambda: http_camera.apply(0.009, 1.0))
    assert error.code == "read-back"
    refuses(LimitError, lambda: http_camera.apply(0.6, 1.0))


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"[1, 2]",
        b"{}",
        b'{"exposure_us": "x"}',
        b"\xff",
        b"[" * 30000,
        b'{"exposure_us": NaN, "gain": NaN}',
        b'{"exposure_us": 8000, "gain": Infinity}',
    ],
)
def test_nonsense_from_a_network_camera_is_a_wire_error(
    http_camera: HttpExposure, body: bytes
) -> None:
    _Answer.body = body
    error = refuses(WireError, lambda: http_camera.apply(0.008, 1.0))
    assert "8000" in error.message, "which question it was"
    _Answer.body = b'{"exposure_us": 8000, "gain": 1}'
    assert http_camera.apply(0.008, 1.0) == pytest.approx((0.008, 1.0))


def test_an_answer_that_is_not_http_is_a_wire_error() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:

        def answer() -> None:
            line, _ = server.accept()
            with line:
                line.recv(4096)
                line.sendall(b"220 welcome\r\n")

        thread = threading.Thread(target=answer)
        thread.start()
        url = f"http://127.0.0.1:{server.getsockname()[1]}/{{exposure_us}}/{{gain}}"
        camera = HttpExposure(url, (1e-4, 0.5), 5.0, "camera")
        error = refuses(WireError, lambda: camera.apply(0.008, 1.0))
        thread.join()
    assert "control_url" in error.hint


ANSWERS = [b'{"exposure_us": 8000, "gain": 1}', b'{"gain": "2.5", "exposure_us": 1e3}']
MEANT = [b'"', b"{", b"}", b"[", b":", b",", b"null", b"true", b"\\u0000", b"e9"]


def _read(answer: bytes) -> None:
    try:
        exposure_s, gain = in_force(answer)
    except ValueError:
        return
    assert math.isfinite(exposure_s)
    assert math.isfinite(gain)


def test_any_answer_gives_finite_numbers_or_its_own_error() -> None:
    fuzz(_read, Mutants(ANSWERS, MEANT), count=2000)


@pytest.mark.full
def test_a_hundred_thousand_answers_give_finite_numbers_or_their_own_error() -> None:
    fuzz(_read, Mutants(ANSWERS, MEANT))


def test_a_network_camera_that_is_gone_is_a_lost_link() -> None:
    gone = HttpExposure("http://127.0.0.1:9/{exposure_us}/{gain}", (0, 1), 1, "camera")
    error = refuses(LinkLost, lambda: gone.apply(0.008, 1.0))
    assert "http://127.0.0.1:9/8000" in error.message
    assert "control_url" in error.hint


class _Controls:
    """A capture with controls that may not obey."""

    def __init__(self, stuck: dict[int, float] | None = None) -> None:
        self.values: dict[int, float] = {}
        self.stuck = stuck or {}

    def set(self, key: int, value: float) -> bool:
        self.values[key] = value
        return True

    def get(self, key: int) -> float:
        return self.stuck.get(key, self.values.get(key, -1.0))


def _v4l2(controls: _Controls, *, allow: bool = False) -> V4l2Exposure:
    return V4l2Exposure(controls, (1e-4, 0.5), allow, "camera")  # type: ignore[arg-type]


def test_a_usb_exposure_is_set_in_its_own_ticks_and_read_back() -> None:
    controls = _Controls()
    exposure_s, gain = _v4l2(controls).apply(0.00812, 1.0)
    assert controls.values[cv2.CAP_PROP_EXPOSURE] == 81
    assert (exposure_s, gain) == (pytest.approx(0.0081), 1.0)
    stuck = _Controls({cv2.CAP_PROP_EXPOSURE: 50})
    refuses(DeviceFault, lambda: _v4l2(stuck).apply(0.008, 1.0))


def test_a_gain_that_changes_by_itself_is_refused() -> None:
    controls = _Controls()
    controls.set(cv2.CAP_PROP_GAIN, 16)
    camera = _v4l2(controls)
    camera.switch_off_automatic()
    camera.apply(0.008, 1.0)
    controls.set(cv2.CAP_PROP_GAIN, 24)
    error = refuses(DeviceFault, lambda: camera.apply(0.008, 1.0))
    assert "gain" in error.message
    assert error.code == "automatic"


def test_automatic_exposure_that_stays_on_is_refused_or_said_aloud(
    caplog: pytest.LogCaptureFixture,
) -> None:
    stuck = _Controls({cv2.CAP_PROP_AUTO_EXPOSURE: 3})
    refuses(DeviceFault, _v4l2(stuck).switch_off_automatic)
    _v4l2(stuck, allow=True).switch_off_automatic()
    assert "automatic exposure stays on" in caplog.text


@pytest.mark.parametrize(
    ("kept", "said"), [(1.0, ""), (4.0, "reads back as 4"), (-1.0, "as unknown")]
)
def test_a_queue_that_stays_longer_than_asked_is_said_aloud(
    kept: float, said: str, caplog: pytest.LogCaptureFixture
) -> None:
    controls = _Controls({cv2.CAP_PROP_BUFFERSIZE: kept})
    keep_newest(controls, "camera")  # type: ignore[arg-type]
    assert controls.values[cv2.CAP_PROP_BUFFERSIZE] == 1
    assert said in caplog.text
    assert bool(caplog.text) == bool(said)
