"""The GenICam driver against Debian's GigE Vision camera, through both libraries."""

from __future__ import annotations

import itertools
import time
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np
import pytest

from drivers._genicam import installed_backends
from drivers.camera_genicam import GenicamCamera
from mvp.devices import DeviceContext, Frame
from mvp.errors import (
    ConnectError,
    DeviceError,
    DeviceFault,
    DeviceTimeout,
    LimitError,
    LinkLost,
)
from mvp.testing import refuses

if TYPE_CHECKING:
    from collections.abc import Callable

    from tests.conftest import GvCamera

_SIZE = (320, 240)
_UNIT_EXPOSURE_S = 0.01  # the camera's test pattern is not amplified at this one


@pytest.fixture
def driver(gv_camera: GvCamera, genicam_backend: str) -> Callable[..., GenicamCamera]:
    def build(**settings: object) -> GenicamCamera:
        config = GenicamCamera.Config.model_validate(
            {
                "address": gv_camera.host,
                "backend": genicam_backend,
                "width_px": _SIZE[0],
                "height_px": _SIZE[1],
                **settings,
            }
        )
        return GenicamCamera.from_config(config, DeviceContext(), name="camera")

    return build


def _now(camera: GenicamCamera, timeout_s: float = 30.0) -> Frame:
    return camera.capture(not_before_s=time.monotonic(), timeout_s=timeout_s)


def _pattern(first: int) -> np.ndarray:
    """The camera's own test pattern for a frame whose corner has this grey value."""
    columns, rows = _SIZE
    return (np.add.outer(np.arange(rows), np.arange(columns)) + first) % 255


def test_the_camera_is_found(gv_camera: GvCamera) -> None:
    problem = installed_backends()["aravis"]
    if problem:
        pytest.skip(f"only Aravis searches the loopback interface: {problem}")
    found = {camera.serial: camera for camera in GenicamCamera.find_cameras()}
    assert found[gv_camera.serial].address == gv_camera.host
    assert found[gv_camera.serial].driver == "genicam"
    assert "Aravis" in found[gv_camera.serial].model


def test_the_camera_is_opened_by_its_serial_number(
    gv_camera: GvCamera, driver: Callable[..., GenicamCamera], genicam_backend: str
) -> None:
    camera = driver(address=gv_camera.serial)
    if genicam_backend == "telegenicam":
        # It searches through network adapters only; there may be none.
        with suppress(ConnectError), camera:
            assert camera.info().serial == gv_camera.serial
        return
    with camera:
        assert camera.info().serial == gv_camera.serial


def test_the_record_names_library_buffers_and_camera(
    gv_camera: GvCamera, driver: Callable[..., GenicamCamera], genicam_backend: str
) -> None:
    with driver() as camera:
        info = camera.info()
    assert info.serial == gv_camera.serial
    assert info.extra["backend"].startswith(genicam_backend)
    assert info.extra["receive_buffer"] == str(16 << 20)
    assert int(info.extra["net.core.rmem_max"]) > 0


def test_another_serial_number_is_refused(
    driver: Callable[..., GenicamCamera],
) -> None:
    error = refuses(ConnectError, driver(serial="SOMEBODY-ELSE").open)
    assert "SOMEBODY-ELSE" in error.message


@pytest.mark.parametrize(
    ("key", "value", "named"),
    [
        ("width_px", 99999, "Width"),
        ("features", {"GainRaw": 11}, "GainRaw"),
        ("features", {"TriggerActivation": "LevelHigh"}, "TriggerActivation"),
        ("pixel_format", "Mono12", "PixelFormat"),
    ],
)
def test_what_the_camera_cannot_do_is_refused_by_name(
    driver: Callable[..., GenicamCamera], key: str, value: object, named: str
) -> None:
    error = refuses(LimitError, driver(**{key: value}).open)
    assert named in error.message
    assert error.hint


def test_unknown_features_are_a_fault_and_not_a_crash(
    driver: Callable[..., GenicamCamera],
) -> None:
    refuses(DeviceFault, driver(features={"NoSuchFeature": 1}).open)


def test_settings_reach_the_camera(driver: Callable[..., GenicamCamera]) -> None:
    with driver(features={"AcquisitionFrameRate": 50.0}, gain_db_per_raw=1.0) as camera:
        camera.configure(exposure_s=0.005, gain=2.0)
        frame = _now(camera)
    assert frame.exposure_s == pytest.approx(0.005)
    assert frame.gain == pytest.approx(2.0, rel=0.06)
    assert frame.pixels.shape == _SIZE[::-1]


def test_a_raw_gain_is_not_guessed(driver: Callable[..., GenicamCamera]) -> None:
    with driver() as camera:
        error = refuses(LimitError, lambda: camera.configure(exposure_s=0.01, gain=2.0))
    assert "gain_db_per_raw" in error.hint


def test_sixteen_bit_pictures_have_sixteen_bits(
    driver: Callable[..., GenicamCamera],
) -> None:
    with driver(pixel_format="Mono16") as camera:
        frame = _now(camera)
    assert frame.pixels.dtype == np.uint16
    assert frame.full_scale == 65535


def _every_trigger_brings_its_own_frame(camera: GenicamCamera, count: int) -> None:
    camera.configure(exposure_s=_UNIT_EXPOSURE_S)
    frames = [_now(camera) for _ in range(count)]
    for before, after in itertools.pairwise(frames):
        assert after.frame_id == before.frame_id + 1 + after.dropped
        assert after.exposure_start_s >= before.received_s
    for frame in frames:
        assert np.array_equal(frame.pixels, _pattern(int(frame.pixels[0, 0])))


def test_every_trigger_brings_its_own_whole_frame(
    driver: Callable[..., GenicamCamera],
) -> None:
    with driver() as camera:
        _every_trigger_brings_its_own_frame(camera, 20)


@pytest.mark.full
def test_two_hundred_triggers_bring_two_hundred_whole_frames(
    driver: Callable[..., GenicamCamera],
) -> None:
    with driver(width_px=_SIZE[0]) as camera:
        _every_trigger_brings_its_own_frame(camera, 200)


def test_no_frame_with_holes_is_handed_out(
    gv_camera: GvCamera, driver: Callable[..., GenicamCamera]
) -> None:
    gv_camera.start(lost_per_thousand=5)
    whole = lost = 0
    with driver() as camera:
        camera.configure(exposure_s=_UNIT_EXPOSURE_S)
        for _ in range(8):
            try:
                frame = _now(camera)
            except DeviceFault:
                lost += 1
                continue
            whole += 1
            assert np.array_equal(frame.pixels, _pattern(int(frame.pixels[0, 0])))
    assert whole > 0, f"{lost} of 8 captures found no whole frame in three tries"


def test_a_hopeless_line_is_a_fault_after_three_tries(
    gv_camera: GvCamera, driver: Callable[..., GenicamCamera]
) -> None:
    gv_camera.start(lost_per_thousand=500)
    with driver() as camera:
        camera.configure(exposure_s=_UNIT_EXPOSURE_S)
        error = refuses(DeviceFault, lambda: _now(camera))
    assert "3 frames in a row" in error.message
    assert "rmem_max" in error.hint


def test_a_camera_that_came_back_has_its_settings_again(
    gv_camera: GvCamera, driver: Callable[..., GenicamCamera]
) -> None:
    with driver() as camera:
        camera.configure(exposure_s=0.006)
        _now(camera)
        gv_camera.kill()
        refuses(LinkLost, lambda: _now(camera))
        refuses(ConnectError, lambda: _now(camera))
        gv_camera.start()
        frame = _now(camera)
        assert frame.exposure_s == pytest.approx(0.006)
        assert frame.pixels.shape == _SIZE[::-1]
        assert camera.info().serial == gv_camera.serial


@pytest.mark.full
def test_a_different_camera_in_its_place_is_refused(
    gv_camera: GvCamera, driver: Callable[..., GenicamCamera]
) -> None:
    with driver() as camera:
        _now(camera)
        gv_camera.kill()
        refuses(LinkLost, lambda: _now(camera))
        gv_camera.start(serial="CHANGELING")
        error = refuses(ConnectError, lambda: _now(camera))
        assert "CHANGELING" in error.message
        gv_camera.start()
        _now(camera)


def test_a_frame_of_an_abandoned_trigger_is_not_taken_for_a_later_one(
    driver: Callable[..., GenicamCamera], caplog: pytest.LogCaptureFixture
) -> None:
    with driver() as camera:
        camera.configure(exposure_s=_UNIT_EXPOSURE_S)
        first = _now(camera)
        refuses(DeviceTimeout, lambda: _now(camera, timeout_s=1e-4))
        time.sleep(0.2)
        caplog.clear()
        frame = _now(camera)
    # The abandoned trigger's frame was made, and thrown away; every frame that came too
    # early to be believed was made once more, and said so.
    again = sum(": try " in record.getMessage() for record in caplog.records)
    made = (int(frame.pixels[0, 0]) - int(first.pixels[0, 0])) % 255
    assert made == 2 + again
    assert frame.received_s >= frame.exposure_start_s + frame.exposure_s


@pytest.mark.full
def test_a_second_program_cannot_take_the_camera(
    driver: Callable[..., GenicamCamera],
) -> None:
    with driver() as camera:
        _now(camera)
        refuses(DeviceError, driver().open)
        _now(camera)
