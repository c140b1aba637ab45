"""The raw pixels of one edge, in coordinates along and across it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import cv2
import numpy as np

if TYPE_CHECKING:
    from mvp.geometry import BoolArray, FloatArray
    from mvp.imaging.expectation import DrawnEdges
    from mvp.imaging.measure_plane import ImagePlane

_BEND_PX = 2.0
_SAME_LINE_PX = 0.6
_SPREAD_PX = 1.5
_MAD = 1.4826
# Rounding to 8 bit alone.
_LEAST_NOISE = 1 / 255 / np.sqrt(12)


@dataclass(frozen=True, eq=False)
class Picture:
    """A linear picture as fractions of full scale, (rows, cols), and its geometry."""

    grey: FloatArray
    plane: ImagePlane

    @cached_property
    def noise(self) -> float:
        """Noise of one pixel from second differences along rows (robust)."""
        rows = self.grey[::3]
        second = rows[:, :-2] - 2 * rows[:, 1:-1] + rows[:, 2:]
        lit = (rows[:, 1:-1] > 0.02) & (rows[:, 1:-1] < 0.95)
        values = np.abs(second[lit]) if lit.sum() > 100 else np.abs(second)
        return float(max(_MAD * np.median(values) / np.sqrt(6), _LEAST_NOISE))

    @cached_property
    def single(self) -> FloatArray:
        """The picture in single precision, for quick interpolation."""
        return np.asarray(self.grey, dtype=np.float32)

    def at(self, ideal_px: FloatArray) -> FloatArray:
        """Bilinear grey at ideal places (..., 2); nan outside."""
        raw = self.plane.raw(ideal_px).astype(np.float32)
        values = cv2.remap(
            self.single,
            np.ascontiguousarray(raw[..., 0]),
            np.ascontiguousarray(raw[..., 1]),
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=float("nan"),
        )
        return np.asarray(values, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Line:
    """A directed line piece in ideal px."""

    start_px: FloatArray
    end_px: FloatArray

    @cached_property
    def length_px(self) -> float:
        """Length in row pitches."""
        return float(np.linalg.norm(self.end_px - self.start_px))

    @cached_property
    def along(self) -> FloatArray:
        """Unit direction (2,)."""
        return np.asarray((self.end_px - self.start_px) / max(self.length_px, 1e-9))

    @cached_property
    def across(self) -> FloatArray:
        """Unit normal (2,)."""
        return np.array([-self.along[1], self.along[0]])

    @cached_property
    def middle_px(self) -> FloatArray:
        """Midpoint (2,)."""
        return np.asarray((self.start_px + self.end_px) / 2)

    def place(self, ideal_px: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Coordinates along (from the middle) and across of points (..., 2)."""
        relative = ideal_px - self.middle_px
        return relative @ self.along, relative @ self.across


@dataclass(frozen=True, eq=False)
class Band:
    """Pixels within a band about a line.

    Attributes:
        s_px, t_px: (n,) along (from the middle) and across.
        grey: (n,) fractions of full scale.
        clear: (n,) not disturbed by another predicted line.
    """

    s_px: FloatArray
    t_px: FloatArray
    grey: FloatArray
    clear: BoolArray


def band_of(
    picture: Picture,
    line: Line,
    half_width_px: float,
    others: DrawnEdges,
    *,
    extra_blur_px: float = 0.0,
) -> Band:
    """All pixels whose ideal place is within the band."""
    raw = _raw_pixels(picture, line, half_width_px + _BEND_PX)
    ideal = picture.plane.ideal(raw.astype(np.float64))
    s, t = line.place(ideal)
    keep = (np.abs(t) <= half_width_px) & (np.abs(s) <= line.length_px / 2)
    raw, s, t = raw[keep], s[keep], t[keep]
    grey = picture.grey[raw[:, 1], raw[:, 0]]
    clear = ~disturbed(line, s, t, others, half_width_px, extra_blur_px)
    return Band(s, t, grey, clear)


def _raw_pixels(picture: Picture, line: Line, half_width_px: float) -> FloatArray:
    """Integer column, row (n, 2) of pixels near the line, generously."""
    plane = picture.plane
    share = np.linspace(0, 1, 9)[:, None]
    centre = plane.raw(line.start_px * (1 - share) + line.end_px * share)
    wide = half_width_px * np.array([1 / plane.optics.pixel_x_px, 1.0]) * 1.1
    rows, columns = picture.grey.shape
    low = np.maximum(np.floor(centre.min(axis=0) - wide), 0).astype(int)
    high = np.minimum(
        np.ceil(centre.max(axis=0) + wide), [columns - 1, rows - 1]
    ).astype(int)
    if (high < low).any():
        return np.zeros((0, 2), dtype=np.int64)
    x, y = np.meshgrid(np.arange(low[0], high[0] + 1), np.arange(low[1], high[1] + 1))
    pixels = np.stack([x.ravel(), y.ravel()], axis=1)
    square = np.array([plane.optics.pixel_x_px, 1.0])
    a, b = centre[0] * square, centre[-1] * square
    direction = (b - a) / max(float(np.linalg.norm(b - a)), 1e-9)
    relative = pixels * square - a
    off = np.abs(relative @ np.array([-direction[1], direction[0]]))
    bend = np.abs((centre * square - a) @ np.array([-direction[1], direction[0]])).max()
    return np.asarray(pixels[off <= half_width_px * 1.1 + bend])


def disturbed(
    line: Line,
    s_px: FloatArray,
    t_px: FloatArray,
    others: DrawnEdges,
    half_width_px: float,
    extra_blur_px: float,
) -> BoolArray:
    """Pixels that belong to, or lie beyond, another predicted line.

    A pixel is beyond when the other line separates it from this one: it shows a third
    face.
    """
    s1, t1 = line.place(others.start_px)
    s2, t2 = line.place(others.end_px)
    half = line.length_px / 2
    near = (
        (
            (np.minimum(np.abs(t1), np.abs(t2)) < half_width_px + 6 + others.blur_px)
            | (np.sign(t1) != np.sign(t2))
        )
        & (np.maximum(s1, s2) > -half - 8)
        & (np.minimum(s1, s2) < half + 8)
    )
    near &= ~_own(s1, t1, s2, t2)
    out = np.zeros(len(s_px), dtype=np.bool_)
    for k in np.flatnonzero(near):
        guard = _SPREAD_PX + (others.blur_px[k] + extra_blur_px) / 2
        out |= _touched(s_px, t_px, (s1[k], t1[k]), (s2[k], t2[k]), guard)
    return out


def _own(s1: FloatArray, t1: FloatArray, s2: FloatArray, t2: FloatArray) -> BoolArray:
    """Pieces of the line itself."""
    flat = np.abs(t2 - t1) < 0.02 * np.abs(s2 - s1) + 0.3
    return np.asarray((np.maximum(np.abs(t1), np.abs(t2)) < _SAME_LINE_PX) & flat)


def _touched(
    s: FloatArray,
    t: FloatArray,
    first: tuple[float, float],
    last: tuple[float, float],
    guard_px: float,
) -> BoolArray:
    a, along = np.array(first), np.array(last) - np.array(first)
    relative = np.stack([s, t], axis=1) - a
    place = np.clip(relative @ along / max(float(along @ along), 1e-9), 0, 1)
    close = np.linalg.norm(relative - place[:, None] * along, axis=1) < guard_px
    if abs(along[0]) < 1e-6:
        return np.asarray(close)
    share = (s - a[0]) / along[0]
    there = a[1] + share * along[1]
    between = (share >= 0) & (share <= 1) & (t * there > 0)
    return np.asarray(close | (between & (np.abs(t) > np.abs(there) - guard_px)))
