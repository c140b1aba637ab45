"""How far the whole picture moved between two frames that should be the same.

Motion displaces grey along its gradient; light that flickers multiplies it and adds to
it. Both are fitted together by least squares, so that the one is not taken for the
other: second - first = -gradient . shift + gain first + offset, from coarse to fine.
Only places count whose gradient stands out of the noise, which is measured in the
pictures themselves.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.geometry import BoolArray, FloatArray
    from mvp.imaging.sensor_noise import FrameArray

_SATURATED = 0.98
_STANDS_OUT = 5.0  # gradient over its noise: attenuates a shift by 1 / 25 at most
_SMALLEST_PX = 24  # of the coarsest level: sides, px of that level
_STEPS = 3
_FINE_START = 2  # level: blocks of 4 px
_SHOWN = 10.0  # strength of a direction over that of mere noise
_FEWEST = 30
_CONTRAST = 3.0  # of the grey at those places over the noise; else they are outliers
_ROUNDING = 1e-6
_WARP_GRID = 32  # OpenCV displaces by whole steps of 1/32 px, whatever it is asked
_UNKNOWNS = 4
_SIGMAS = 3.0
_TILE_PX = 8
# Immerkaer 1996: blind to slopes, keeps the standard deviation of white noise.
_NOISE_MASK = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32) / 6
_QUANTISED = 1 / np.sqrt(12)

_Float32: TypeAlias = NDArray[np.float32]
_Level: TypeAlias = tuple[_Float32, _Float32, _Float32]


@dataclass(frozen=True, eq=False)
class PictureShift:
    """A displacement along its two principal directions.

    Attributes:
        shift_px: (2,) along each.
        sigma_px: (2,) one standard deviation of each, from the noise; inf where nothing
            shows it.
        likeness: correlation of what stands out in either picture, once they are laid
            on each other; far below 1 they show different things.
    """

    shift_px: FloatArray
    sigma_px: FloatArray
    likeness: float = 1.0

    def visible_px(self, within_px: float) -> tuple[float, float] | None:
        """Length and its standard deviation, of what the picture shows well enough.

        A direction counts when a third of ``within_px`` could be told from none; along
        a lone edge nothing can be seen to move. None: no direction counts.
        """
        seen = self.sigma_px * _SIGMAS <= within_px
        if not seen.any():
            return None
        length = float(np.linalg.norm(self.shift_px[seen]))
        return length, float(self.sigma_px[seen].max())

    def scaled(self, factor: float) -> Self:
        """The same in pixels that are so many times smaller."""
        return replace(
            self, shift_px=self.shift_px * factor, sigma_px=self.sigma_px * factor
        )


_UNSEEN = PictureShift(np.zeros(2), np.full(2, np.inf))


def picture_shift(
    first: FrameArray, second: FrameArray, full_scale: int
) -> PictureShift:
    """How far the second picture is displaced against the first one.

    Args:
        first: (rows, columns), grey.
        second: of the same size.
        full_scale: highest grey level; places that reach it are left out.

    Raises:
        ValueError: the two differ in size.
    """
    if first.shape != second.shape:
        raise ValueError("two pictures of different sizes cannot be compared")
    noise = max(_noise(first), _noise(second), _QUANTISED)
    levels = _levels(first, second, _SATURATED * full_scale)
    starts = sorted({len(levels), min(len(levels), _FINE_START)})
    found = [_down_from(start, levels, noise) for start in starts]
    return min(found, key=lambda one: one[0])[1]


def _down_from(
    start: int, levels: Sequence[_Level], noise: float
) -> tuple[float, PictureShift]:
    """From no shift at one level down to the finest; what it leaves unexplained first.

    Beginning coarse bridges a long way, and can be led astray by what repeats itself;
    beginning fine is right for short ways.
    """
    now = _Step(np.zeros(2), np.inf, _UNSEEN, 0)
    for number in range(start, 0, -1):
        for _ in range(_STEPS):
            now = _step(levels[number - 1], now.shift, noise / 2**number)
        now = replace(now, shift=2 * now.shift)
    return now.left, now.believed.scaled(2)


@dataclass(frozen=True, eq=False)
class _Step:
    """A better shift, px of its level.

    Attributes:
        shift: (2,), columns and rows.
        left: root mean square of what it leaves, grey.
        found: all that is known.
        places: that took part.
    """

    shift: FloatArray
    left: float
    found: PictureShift
    places: int

    @property
    def believed(self) -> PictureShift:
        """Without directions that are no stronger than noise of the size that is left.

        A picture may be noisier where it is bright than its middle tile says; what two
        frames leave, once laid on each other, tells. Of slopes that are nothing but that
        noise a shift would come out of the blue.
        """
        least = np.sqrt(8 / (_SHOWN * max(self.places, 1)))
        sigma = np.where(self.found.sigma_px < least, self.found.sigma_px, np.inf)
        return replace(self.found, sigma_px=sigma)


def _noise(picture: FrameArray) -> float:
    """Standard deviation of a pixel, grey: that of the middle one of many tiles."""
    response = cv2.filter2D(picture.astype(np.float32), -1, _NOISE_MASK)
    size = (-(-picture.shape[1] // _TILE_PX), -(-picture.shape[0] // _TILE_PX))
    squares = cv2.resize(response**2, size, interpolation=cv2.INTER_AREA)
    return float(np.sqrt(np.median(squares)))


def _levels(first: FrameArray, second: FrameArray, below: float) -> list[_Level]:
    """Both pictures and where both are valid, each level half the one before."""
    valid = ((first < below) & (second < below)).astype(np.float32)
    now = [first.astype(np.float32), second.astype(np.float32), valid]
    levels: list[_Level] = []
    while True:
        rows, columns = now[0].shape[0] // 2, now[0].shape[1] // 2
        if levels and min(rows, columns) < _SMALLEST_PX:
            return levels
        now = [
            cv2.resize(
                one[: 2 * rows, : 2 * columns],
                (columns, rows),
                interpolation=cv2.INTER_AREA,
            ).astype(np.float32)
            for one in now
        ]
        levels.append((now[0], now[1], now[2]))


def _step(level: _Level, shift: FloatArray, noise: float) -> _Step:
    """From a shift (2,) to a better one, px of this level."""
    first, second, valid = level
    shift = np.round(shift * _WARP_GRID) / _WARP_GRID
    move = np.array([[1, 0, shift[0]], [0, 1, shift[1]]])
    size = (first.shape[1], first.shape[0])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    moved = cv2.warpAffine(second, move, size, flags=flags).astype(np.float32)
    inside = cv2.warpAffine(valid, move, size, flags=flags)
    mean = ((first + moved) / 2).astype(np.float64)
    gradient = np.stack([*np.gradient(mean)][::-1], axis=-1)
    eroded = cv2.erode(np.minimum(valid, inside), np.ones((3, 3)))
    whole: BoolArray = np.asarray(eroded > 1 - _ROUNDING)
    slope_noise = noise / 2  # of a mean of two, between neighbours of neighbours
    whole[[0, -1]] = whole[:, [0, -1]] = False
    used = whole & (np.linalg.norm(gradient, axis=-1) > _STANDS_OUT * slope_noise)
    if used.sum() < _FEWEST or _contrast(first, moved, used) < _CONTRAST * noise:
        return _Step(shift, np.inf, _UNSEEN, 0)
    change = np.asarray(moved - first, np.float64)[used]
    ways, along, sigma, left = _fitted(-gradient[used], change, mean[used], slope_noise)
    shift = shift + ways @ np.where(sigma < 1, np.clip(along, -2, 2), 0.0)
    likeness = _likeness(first[used], moved[used])
    found = PictureShift(ways.T @ shift, sigma, likeness)
    return _Step(shift, left, found, int(used.sum()))


def _contrast(first: _Float32, second: _Float32, used: BoolArray) -> float:
    """Standard deviation of the grey at some places, in the clearer picture."""
    return max(float(first[used].std()), float(second[used].std()))


def _likeness(first: _Float32, second: _Float32) -> float:
    """Correlation (n,); 0 where one of them is all the same."""
    spreads = float(first.std()) * float(second.std())
    together = float(np.mean((first - first.mean()) * (second - second.mean())))
    return together / spreads if spreads else 0.0


def _fitted(
    slopes: FloatArray, change: FloatArray, mean: FloatArray, slope_noise: float
) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Shift, gain and offset by least squares; gain and offset are then forgotten.

    Returns:
        (2, 2) principal directions as columns; (2,) shift along each; (2,) standard
        deviation of each, inf where the slopes are hardly more than noise; the root
        mean square of what is left.
    """
    light = np.stack([mean, np.ones(len(mean))], axis=1)
    both = np.column_stack([slopes, change])
    both = both - light @ np.linalg.lstsq(light, both, rcond=None)[0]
    slopes, change = both[:, :2], both[:, 2]
    strengths, ways = np.linalg.eigh(slopes.T @ slopes)
    shown = strengths > _SHOWN * len(mean) * slope_noise**2
    strengths = np.where(shown, strengths, 1.0)
    along = np.where(shown, ways.T @ (slopes.T @ change) / strengths, 0.0)
    left = change - slopes @ (ways @ along)
    spread = float(np.sqrt(left @ left / (len(mean) - _UNKNOWNS)))
    sigma = np.where(shown, spread / np.sqrt(strengths), np.inf)
    return ways, along, sigma, spread
