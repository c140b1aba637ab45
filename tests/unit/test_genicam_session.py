"""Settings that are proved, on a camera that exists only in memory."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers._genicam import (
    BackendLost,
    BackendRefused,
    Delivery,
    FoundBy,
    Health,
    Identity,
    Session,
    SessionSettings,
    StreamSettings,
    Value,
)
from drivers._genicam.pixels import frames_between, grey_picture
from drivers.camera_genicam import GenicamCamera
from mvp.devices import DeviceContext, Frame
from mvp.errors import ConnectError, DeviceFault, LimitError, LinkLost
from mvp.testing import refuses

if TYPE_CHECKING:
    from collections.abc import Iterator

_STREAM = StreamSettings(1400, 16 << 20, 4, True)
_TRIGGERED = {"TriggerMode": "On", "TriggerSource": "Software"}


@dataclass
class MemoryCamera:
    """A backend with features in a dictionary; it can lie, and it can die."""

    features: dict[str, Value]
    limits: dict[str, tuple[float, float]] = field(default_factory=dict)
    entries: dict[str, tuple[str, ...]] = field(default_factory=dict)
    stuck: dict[str, Value] = field(default_factory=dict)
    serial: str = "M1"
    lost: bool = False
    armed: int = 0
    name: str = "memory"
    version: str = "1"

    def discover(self) -> tuple[FoundBy, ...]:
        return ()

    def open(self, address: str) -> Identity:
        self._check()
        return Identity("maker", "model", self.serial, "1")

    def has(self, feature: str) -> bool:
        return feature in self.features

    def get(self, feature: str, kind: str) -> Value:
        self._check()
        return self.stuck.get(feature, self.features[feature])

    def set(self, feature: str, value: Value) -> None:
        self._check()
        if feature not in self.features:
            raise BackendRefused(f"no feature {feature}")
        self.features[feature] = value

    def bounds(self, feature: str, kind: str) -> tuple[float, float]:
        return self.limits.get(feature, (-math.inf, math.inf))

    def choices(self, feature: str) -> tuple[str, ...]:
        return self.entries.get(feature, (str(self.features.get(feature)),))

    def arm(self, settings: StreamSettings) -> None:
        self._check()
        self.armed += 1

    def trigger(self) -> None:
        self._check()

    def drain(self) -> int:
        return 0

    def wait(self, timeout_s: float) -> Delivery | None:
        self._check()
        return None

    def disarm(self) -> None: ...

    def health(self) -> Health:
        return Health(not self.lost)

    def close(self) -> None: ...

    def _check(self) -> None:
        if self.lost:
            raise BackendLost("gone")


def _modern(**more: Value) -> MemoryCamera:
    """A camera with the names of the standard (SFNC)."""
    return MemoryCamera(
        {
            "AcquisitionMode": "Continuous",
            "TriggerSelector": "FrameStart",
            "TriggerMode": "Off",
            "TriggerSource": "Line1",
            "ExposureAuto": "Continuous",
            "GainAuto": "Once",
            "ExposureTime": 5000.0,
            "Gain": 0.0,
            "GainRaw": 7,
            **more,
        },
        limits={"ExposureTime": (20.0, 1e6), "Gain": (0.0, 24.0)},
        entries={
            "TriggerMode": ("Off", "On"),
            "TriggerSource": ("Line1", "Software"),
            "ExposureAuto": ("Off", "Continuous"),
            "GainAuto": ("Off", "Once"),
        },
    )


def _session(camera: MemoryCamera, **changes: object) -> Session:
    settings: dict[str, object] = {
        "address": "a name",
        "serial": "",
        "features": {},
        "stream": _STREAM,
        "gain_db_per_raw": None,
        "gain_floor": 0.0,
        **changes,
    }
    return Session(camera, SessionSettings(**settings), "camera")  # type: ignore[arg-type]


def test_connecting_switches_everything_automatic_off_and_waits_for_triggers() -> None:
    camera = _modern()
    _session(camera).connect()
    for feature in ("ExposureAuto", "GainAuto"):
        assert camera.features[feature] == "Off"
    assert {key: camera.features[key] for key in _TRIGGERED} == _TRIGGERED
    assert camera.armed == 1


def test_the_standard_name_wins_over_older_ones() -> None:
    camera = _modern()
    session = _session(camera)
    session.connect()
    session.configure(0.004, 2.0)
    assert camera.features["ExposureTime"] == pytest.approx(4000.0)
    assert camera.features["Gain"] == pytest.approx(20 * math.log10(2))
    assert camera.features["GainRaw"] == 7
    assert session.gain == pytest.approx(2.0)


def test_a_camera_that_keeps_its_automatic_exposure_is_refused() -> None:
    camera = _modern()
    camera.stuck["ExposureAuto"] = "Continuous"
    refuses(DeviceFault, _session(camera).connect)
    camera = _modern()
    camera.entries["ExposureAuto"] = ("Continuous",)
    error = refuses(DeviceFault, _session(camera).connect)
    assert "ExposureAuto" in error.message


def test_a_value_that_reads_back_differently_is_a_fault() -> None:
    camera = _modern()
    session = _session(camera)
    session.connect()
    camera.stuck["ExposureTime"] = 4100.0
    error = refuses(DeviceFault, lambda: session.configure(0.004, 1.0))
    assert error.code == "read-back"


def test_rounding_by_the_camera_is_accepted_and_reported() -> None:
    camera = _modern()
    session = _session(camera)
    session.connect()
    camera.stuck["ExposureTime"] = 4003.2
    session.configure(0.004, 1.0)
    assert session.exposure_s == pytest.approx(0.0040032)


def test_a_whole_number_must_read_back_exactly() -> None:
    camera = _modern(Width=640)
    camera.stuck["Width"] = 632
    session = _session(camera, features={"Width": 635})
    error = refuses(DeviceFault, session.connect)
    assert error.code == "read-back"
    assert "Width" in error.message
    assert not session.connected


def test_after_a_loss_the_same_camera_gets_its_settings_again() -> None:
    camera = _modern()
    session = _session(camera)
    session.connect()
    session.configure(0.004, 2.0)
    camera.lost = True
    refuses(LinkLost, session.trigger)
    assert not session.connected
    refuses(ConnectError, session.connect)
    camera.lost = False
    camera.features.update({"ExposureTime": 1.0, "TriggerMode": "Off"})
    session.connect()
    assert camera.features["ExposureTime"] == pytest.approx(4000.0)
    assert camera.features["TriggerMode"] == "On"


def test_after_a_loss_another_camera_is_refused() -> None:
    camera = _modern()
    session = _session(camera)
    session.connect()
    camera.serial = "M2"
    error = refuses(ConnectError, session.connect)
    assert "'M2'" in error.message
    assert "'M1'" in error.message


def test_a_camera_without_a_known_exposure_setting_is_refused() -> None:
    camera = _modern()
    del camera.features["ExposureTime"]
    session = _session(camera)
    error = refuses(DeviceFault, session.connect)
    assert "xposure" in error.message
    assert not session.connected
    assert camera.armed == 0


def test_a_gain_below_the_cameras_range_is_refused_and_nothing_is_set() -> None:
    camera = _modern()
    session = _session(camera)
    session.connect()
    before = dict(camera.features)
    refuses(LimitError, lambda: session.configure(0.004, 0.5))
    refuses(LimitError, lambda: session.configure(0.004, 0.0))
    assert camera.features == before


@given(st.integers(1, 65535), st.integers(0, 1000))
def test_a_sixteen_bit_counter_that_wraps_is_followed(last: int, steps: int) -> None:
    def after(number: int) -> int:
        return (number - 1 + steps) % 65535 + 1  # 0 is left out

    advance = frames_between(last, after(last))
    assert advance == steps


@given(st.integers(0, 1 << 63), st.integers(0, 1 << 20))
def test_a_long_counter_is_followed(last: int, steps: int) -> None:
    assert frames_between(last, last + steps) == steps


def test_a_long_counter_that_goes_back_is_no_advance() -> None:
    assert frames_between(1 << 20, 5) == 0
    assert frames_between(100, 99) == 0


@given(st.integers(1, 7), st.integers(1, 9), st.sampled_from([8, 10, 12, 14, 16]))
def test_packed_grey_values_come_back(width: int, height: int, bits: int) -> None:
    codes = {8: 0x01080001, 10: 0x01100003, 12: 0x01100005, 14: 0x01100025}
    rng = np.random.default_rng(width * height)
    picture = rng.integers(0, 1 << bits, (height, width))
    kind = np.uint8 if bits == 8 else np.uint16
    data = picture.astype(np.uint8 if bits == 8 else "<u2").tobytes()
    code = codes.get(bits, 0x01100007)
    pixels, full = grey_picture(data, width=width, height=height, pixel_code=code)
    assert pixels.dtype == kind
    assert full == (1 << bits) - 1
    assert np.array_equal(pixels, picture)


@given(st.binary(max_size=64), st.integers(0, 1 << 32))
def test_short_or_foreign_pictures_are_refused(data: bytes, code: int) -> None:
    with pytest.raises(ValueError, match=r"pixel format|bytes instead"):
        grey_picture(data, width=9, height=9, pixel_code=code)


def _whole(frame_id: int) -> Delivery:
    return Delivery(True, "SUCCESS", frame_id, 2, 1, 0x01080001, b"ab", 0)


def _holed(frame_id: int) -> Delivery:
    return Delivery(False, "MISSING_PACKETS", frame_id, 0, 0, 0, b"", 0)


class ScriptedCamera(MemoryCamera):
    """Answers each trigger with what is planned; None means nothing at all."""

    def plan(self, *answers: Delivery | None, stale: tuple[int, ...] = ()) -> None:
        self.answers = list(answers)
        self.stale = list(stale)
        self.triggers = 0
        self.delay_s = 0.01
        self.waiting: list[Delivery | None] = []

    def trigger(self) -> None:
        self.triggers += 1
        self.waiting.append(self.answers.pop(0))

    def drain(self) -> int:
        return self.stale.pop(0) if self.stale else 0

    def wait(self, timeout_s: float) -> Delivery | None:
        time.sleep(min(self.delay_s, timeout_s))
        return self.waiting.pop() if self.waiting else None


def _driver(camera: MemoryCamera) -> GenicamCamera:
    config = GenicamCamera.Config(address="a name", readout_s=0.0, frame_slack_s=0.02)
    return GenicamCamera(
        config, DeviceContext(), "camera", new_backend=lambda name: camera
    )


@pytest.fixture
def scripted() -> Iterator[tuple[ScriptedCamera, GenicamCamera]]:
    modern = _modern(Width=2, Height=1, PixelFormat="Mono8")
    camera = ScriptedCamera(modern.features, modern.limits, modern.entries)
    camera.plan()
    with _driver(camera) as driver:
        driver.configure(exposure_s=0.001)
        yield camera, driver


def _capture(driver: GenicamCamera) -> Frame:
    return driver.capture(not_before_s=time.monotonic(), timeout_s=10)


@pytest.mark.parametrize(
    ("bad", "streams"), [(_holed(1), 1), (None, 3)], ids=["holes", "nothing"]
)
def test_a_bad_frame_is_asked_for_again_and_on_a_new_stream_when_none_came(
    scripted: tuple[ScriptedCamera, GenicamCamera], bad: Delivery | None, streams: int
) -> None:
    camera, driver = scripted
    camera.plan(bad, bad, _whole(3))
    assert _capture(driver).pixels.tolist() == [[97, 98]]
    assert camera.triggers == 3
    assert camera.armed == streams


def test_three_bad_frames_in_a_row_are_a_fault(
    scripted: tuple[ScriptedCamera, GenicamCamera],
) -> None:
    camera, driver = scripted
    camera.plan(_holed(1), None, _holed(3), _whole(4))
    error = refuses(DeviceFault, lambda: _capture(driver))
    assert error.code == "MISSING_PACKETS"
    assert camera.triggers == 3


def test_frames_that_nobody_triggered_are_thrown_away(
    scripted: tuple[ScriptedCamera, GenicamCamera],
) -> None:
    camera, driver = scripted
    camera.plan(_whole(9), stale=(4, 0))
    _capture(driver)
    assert camera.armed == 2
    camera.plan(stale=(1, 2, 3))
    error = refuses(DeviceFault, lambda: _capture(driver))
    assert "nobody triggered" in error.message
    assert camera.triggers == 0


def test_a_frame_that_comes_before_its_exposure_can_have_ended_is_not_believed(
    scripted: tuple[ScriptedCamera, GenicamCamera],
) -> None:
    camera, driver = scripted
    driver.configure(exposure_s=0.015)
    camera.plan(_whole(1), _whole(2), _whole(3))
    frame = _capture(driver)
    assert camera.triggers == 2
    assert frame.received_s - frame.exposure_start_s >= frame.exposure_s
    # One of two triggers may still be answered: the next frame needs a new stream.
    before = camera.armed
    camera.delay_s = 0.02
    _capture(driver)
    assert camera.armed == before + 1


def test_a_counter_that_stands_is_a_fault_and_gaps_are_counted(
    scripted: tuple[ScriptedCamera, GenicamCamera],
) -> None:
    camera, driver = scripted
    camera.plan(_whole(5), _whole(8), _whole(8), _whole(9))
    first, second = _capture(driver), _capture(driver)
    assert (second.dropped, second.frame_id - first.frame_id) == (2, 3)
    error = refuses(DeviceFault, lambda: _capture(driver))
    assert error.code == "frame-id"
    assert _capture(driver).frame_id > second.frame_id
