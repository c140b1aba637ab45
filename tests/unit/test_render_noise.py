"""From light to grey levels."""

from __future__ import annotations

import numpy as np
import pytest

from mvp.geometry import Pose, TriangleMesh
from mvp.imaging import (
    Illumination,
    RenderBody,
    RenderedImage,
    SensorNoise,
    expose,
    exposure_for,
    render,
)
from mvp.optics import Intrinsics, Sensor


def flat_picture(grey: float, *, a_mm: float = 12.5 / 16) -> RenderedImage:
    """A wall that fills the frame."""
    corners = np.array([[-99, -99, 300], [99, -99, 300], [99, 99, 300], [-99, 99, 300]])
    mesh = TriangleMesh(
        corners.astype(float), np.array([[0, 1, 2], [0, 2, 3]]), np.zeros(2, np.int64)
    )
    return render(
        [RenderBody(mesh, 1.0)],
        Pose.identity("world", "camera"),
        d_mm=13.0,
        f_mm=12.5,
        a_mm=a_mm,
        intrinsics=Intrinsics(Sensor(200, 160, 0.005, 0.005), 99.5, 79.5),
        light=Illumination(ambient=grey, lamps=(), gloss=0.0),
    )


@pytest.mark.parametrize("share", [0.0005, 0.01, 0.3, 0.7])
@pytest.mark.parametrize("bits", [8, 12])
def test_noise_has_the_variance_of_shot_read_and_rounding(
    share: float, bits: int
) -> None:
    sensor = SensorNoise(full_well_e=5000.0, read_noise_e=9.0, bits=bits)
    image = flat_picture(0.5)
    exposure = exposure_for(image, target=share, sensor=sensor)
    levels = expose(image, exposure, sensor=sensor, rng=np.random.default_rng(0))
    per_e = sensor.white_level / sensor.full_well_e
    variance = (share * 5000.0 + 9.0**2) * per_e**2 + 1 / 12
    values = levels.astype(float)
    if share * sensor.white_level > 3 * np.sqrt(variance):
        assert values.mean() == pytest.approx(share * sensor.white_level, rel=0.01)
        assert values.var() == pytest.approx(variance, rel=0.05)
    else:
        assert values.min() == 0


def test_without_rng_the_frame_is_free_of_noise_and_linear() -> None:
    image = flat_picture(0.5)
    once = expose(image, 0.002, sensor=SensorNoise(bits=12))
    twice = expose(image, 0.004, sensor=SensorNoise(bits=12))
    assert np.ptp(once) == 0
    assert once.dtype == np.uint16
    assert twice[0, 0] == pytest.approx(2 * once[0, 0], abs=1)


def test_brightness_follows_the_square_of_the_aperture() -> None:
    wide, narrow = flat_picture(0.5, a_mm=1.0), flat_picture(0.5, a_mm=0.5)
    assert wide.brightness == pytest.approx(4 * narrow.brightness)
    assert exposure_for(narrow) == pytest.approx(4 * exposure_for(wide), rel=1e-6)


def test_too_much_light_saturates_at_the_white_level() -> None:
    image = flat_picture(0.5)
    exposure = exposure_for(image, target=3.0)
    frame = expose(image, exposure, rng=np.random.default_rng(1))
    assert frame.dtype == np.uint8
    assert (frame == 255).all()


def test_metering_puts_the_percentile_at_the_target() -> None:
    image = flat_picture(0.25)
    frame = expose(image, exposure_for(image, target=0.6))
    assert abs(int(frame[50, 50]) - 0.6 * 255) <= 0.5


def test_metering_refuses_a_black_picture_and_an_empty_mask() -> None:
    image = flat_picture(0.0)
    with pytest.raises(ValueError, match="nothing to meter"):
        exposure_for(image)
    with pytest.raises(ValueError, match="nothing to meter"):
        exposure_for(flat_picture(0.5), mask=np.zeros((160, 200), dtype=bool))


def test_the_same_seed_gives_the_same_frame() -> None:
    image = flat_picture(0.5)
    frames = [expose(image, 0.01, rng=np.random.default_rng(7)) for _ in range(2)]
    assert (frames[0] == frames[1]).all()


def test_an_odd_number_of_bits_is_refused() -> None:
    with pytest.raises(ValueError, match="8, 10 or 12"):
        SensorNoise(bits=9)
