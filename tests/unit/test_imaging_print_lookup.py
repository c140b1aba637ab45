"""The mean of a print over many places is the mean, wherever pixels are left out."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from mvp.geometry import Pose
from mvp.imaging import PlanarTexture
from mvp.imaging.print_lookup import averaged_lookup

PLACES = 32


def checked(rng: np.random.Generator) -> np.ndarray:
    """A chessboard with squares of 20 texels and soft borders."""
    dark = np.add.outer(np.arange(200) // 20, np.arange(240) // 20) % 2
    return np.asarray(0.05 + 0.8 * dark, np.float32)


def noisy(rng: np.random.Generator) -> np.ndarray:
    return rng.random((200, 240), dtype=np.float32)


def plain(rng: np.random.Generator) -> np.ndarray:
    return np.full((200, 240), 0.4, np.float32)


@pytest.mark.parametrize("print_", [checked, noisy, plain])
def test_the_mean_over_all_places_is_found_however_few_are_looked_up(print_) -> None:
    rng = np.random.default_rng(3)
    albedo = print_(rng)
    texture = PlanarTexture(albedo, Pose.identity("mesh", "texture"), 0.1)
    # A picture of 150 x 170 pixels that reaches beyond the print on all sides.
    x, y = np.meshgrid(np.linspace(-30, 270, 170), np.linspace(-30, 230, 150))
    centre = np.stack([x + 0.1 * y, y - 0.05 * x], axis=-1)
    ways = np.stack([centre, *rng.uniform(-2, 2, size=(4, *centre.shape))])
    shares = np.column_stack([np.ones(PLACES), rng.uniform(-0.6, 0.6, (PLACES, 4))])

    found = averaged_lookup(texture, ways.astype(np.float32), shares.astype(np.float32))

    places = np.tensordot(shares, ways, axes=1)
    seen = map_coordinates(
        albedo.astype(np.float64),
        [places[..., 1], places[..., 0]],
        order=1,
        mode="nearest",
    )
    # OpenCV rounds places to 1/32 of a texel.
    assert np.abs(found - seen.mean(axis=0)).max() < 0.8 / 32


def test_room_is_how_far_a_print_is_of_one_colour() -> None:
    albedo = np.zeros((30, 40), np.float32)
    albedo[:, 20:] = 1.0
    room = PlanarTexture(albedo, Pose.identity("mesh", "texture"), 0.1).room_texels
    assert room[15, 19] == 0
    assert room[15, 18] == 1
    assert room[0, 0] == 19
