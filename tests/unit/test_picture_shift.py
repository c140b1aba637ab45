"""Shifts that were put into pictures are found again; light and noise are not shifts."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from mvp.imaging import picture_shift

SIZE = (480, 384)  # columns, rows
LIMIT_PX = 1.35
NOISE = 1.5


def part() -> NDArray[np.float32]:
    """Twice as fine as a picture of it."""
    scene = np.full((768, 960), 40.0, np.float32)
    corners = np.array([[230, 190], [720, 240], [680, 590], [190, 540]])
    cv2.fillPoly(scene, [corners], 130.0)
    cv2.circle(scene, (450, 390), 70, 70.0, -1)
    return cv2.GaussianBlur(scene, (0, 0), 2.5).astype(np.float32)


def edge() -> NDArray[np.float32]:
    scene = np.full((768, 960), 40.0, np.float32)
    scene[:, 480:] = 130.0
    return cv2.GaussianBlur(scene, (0, 0), 2.5).astype(np.float32)


def slots() -> NDArray[np.float32]:
    """Repeats itself every 48 px."""
    column = 85 + 45 * np.sign(np.sin(2 * np.pi * np.arange(960) / 96))
    row = 85 + 45 * np.sign(np.sin(2 * np.pi * np.arange(768) / 96))
    scene = np.minimum(row[:, None], column[None])
    return cv2.GaussianBlur(scene, (0, 0), 2.5).astype(np.float32)


def taken(
    scene: NDArray[np.float32],
    seed: int,
    *,
    shift: tuple[float, float] = (0, 0),
    light: NDArray[np.float64] | float = 1.0,
) -> NDArray[np.uint8]:
    """A noisy picture, displaced by ``shift`` px."""
    way = np.array([[2.0, 0, -2 * shift[0]], [0, 2.0, -2 * shift[1]]])
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    border = cv2.BORDER_REFLECT
    grey = cv2.warpAffine(scene, way, SIZE, flags=flags, borderMode=border) * light
    noise = np.random.default_rng(seed).normal(0, NOISE, grey.shape)
    return np.clip(np.round(grey + noise), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("scene", [part, slots])
@pytest.mark.parametrize("shift", [(0.4, 0.3), (1.5, -1.0), (-5.0, 3.0)])
def test_a_shift_is_found_again(scene, shift):
    first, second = taken(scene(), 1), taken(scene(), 2, shift=shift)
    seen = picture_shift(first, second, 255).visible_px(LIMIT_PX)
    assert seen is not None
    assert seen[0] == pytest.approx(np.hypot(*shift), rel=0.03, abs=0.05)


def test_a_way_much_longer_than_an_edge_is_wide_is_found():
    first, second = taken(part(), 1), taken(part(), 2, shift=(40.0, -25.0))
    seen = picture_shift(first, second, 255).visible_px(LIMIT_PX)
    assert seen is not None
    assert seen[0] == pytest.approx(np.hypot(40, 25), rel=0.05)


@pytest.mark.parametrize("scene", [part, slots, edge])
@pytest.mark.parametrize("light", ["same", "brighter", "darker", "bands"])
def test_light_that_flickers_is_no_motion(scene, light):
    rows = np.arange(SIZE[1])[:, None]
    lights = {
        "same": 1.0,
        "brighter": 1.25,
        "darker": 0.8,
        "bands": 1 + 0.04 * np.sin(2 * np.pi * rows / 150),  # rolling shutter
    }
    second = taken(scene(), 2, light=lights[light])
    seen = picture_shift(taken(scene(), 1), second, 255).visible_px(LIMIT_PX)
    assert seen is not None
    assert seen[0] < LIMIT_PX / 6


def test_along_a_lone_edge_nothing_is_seen_and_across_it_everything():
    first = taken(edge(), 1)
    along = picture_shift(first, taken(edge(), 2, shift=(0, 6)), 255)
    across = picture_shift(first, taken(edge(), 3, shift=(2, 6)), 255)
    assert sorted(np.isfinite(along.sigma_px)) == [False, True]
    assert along.visible_px(LIMIT_PX)[0] < 0.1
    assert across.visible_px(LIMIT_PX)[0] == pytest.approx(2, abs=0.06)


def shot(
    scene: NDArray[np.float32], seed: int, full_scale: int, full_well_e: float
) -> NDArray[np.uint16]:
    """As a sensor sees it: noisier where it is bright."""
    rng = np.random.default_rng(seed)
    small = cv2.resize(scene, SIZE, interpolation=cv2.INTER_AREA)
    electrons = rng.poisson(small * full_well_e) + rng.normal(0, 8, small.shape)
    grey = np.clip(electrons / full_well_e, 0, 1) * full_scale
    return np.round(grey).astype(np.uint16)


@pytest.mark.parametrize("bright", [0.2, 0.45])
@pytest.mark.parametrize(("full_scale", "full_well_e"), [(255, 1e4), (4095, 3e4)])
def test_a_bright_strip_in_the_dark_stands_still(bright, full_scale, full_well_e):
    """The middle tile is dark and knows nothing of the noise along the edge."""
    scene = np.full((768, 960), 0.01, np.float32)
    scene[:, : round(960 * bright)] = 0.7
    scene = cv2.GaussianBlur(scene, (0, 0), 2.5).astype(np.float32)
    for seed in range(2):
        one, other = (
            shot(scene, 2 * seed + k, full_scale, full_well_e) for k in (0, 1)
        )
        seen = picture_shift(one, other, full_scale).visible_px(LIMIT_PX)
        assert seen is not None
        assert seen[0] < 0.05


@pytest.mark.parametrize("grey", [0.0, 80.0, 255.0])
def test_of_an_empty_picture_nothing_is_claimed(grey):
    empty = np.full((768, 960), grey, np.float32)
    found = picture_shift(taken(empty, 1), taken(empty, 2), 255)
    assert found.visible_px(LIMIT_PX) is None


def test_what_is_saturated_tells_nothing():
    """A bright face that clips harder would look as if its edges had moved."""
    first, second = taken(part(), 1, light=1.7), taken(part(), 2, light=2.4)
    seen = picture_shift(first, second, 255).visible_px(LIMIT_PX)
    assert seen is not None
    assert seen[0] < LIMIT_PX / 6


def test_the_stated_deviation_is_that_of_the_noise():
    scene = part()
    found = [
        picture_shift(taken(scene, 2 * k), taken(scene, 2 * k + 1), 255)
        for k in range(12)
    ]
    stated = np.mean([one.sigma_px for one in found], axis=0)
    spread = np.sqrt(np.mean([one.shift_px**2 for one in found], axis=0))
    assert np.all(spread < 3 * stated)
    assert np.all(stated < 0.02)


def test_a_picture_that_went_dark_is_not_like_the_one_before():
    dark = np.full((SIZE[1], SIZE[0]), 3, np.uint8)
    assert picture_shift(taken(part(), 1), dark, 255).likeness < 0.1
    assert picture_shift(taken(part(), 1), taken(part(), 2), 255).likeness > 0.9


def test_pictures_of_different_sizes_are_refused():
    first = taken(part(), 1)
    with pytest.raises(ValueError, match="different sizes"):
        picture_shift(first, first[:-1], 255)
