"""Where to start a fit: a small Radon transform of the strip about a line."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from mvp.geometry import FloatArray
    from mvp.imaging.edge_samples import Line, Picture

_T_STEP_PX = 0.5
_SLOPES = np.linspace(-0.06, 0.06, 13)
_LARGEST_S_COUNT = 60
# A match at the border of the search must be this much stronger than one at its place.
_BORDER_WEIGHT = 0.6


@dataclass(frozen=True)
class Start:
    """A rough place: offset at the middle (px), slope, signed step, and its score."""

    offset_px: float
    slope: float
    step: float
    score: float


def find_start(
    picture: Picture, line: Line, search_px: float, blur_px: float
) -> Start | None:
    """The strongest straight step within ``search_px`` of the line."""
    width = 1.5 + blur_px / 2
    s = np.linspace(-0.38, 0.38, _s_count(line)) * line.length_px
    reach = search_px + width + 0.07 * 0.38 * line.length_px + 1
    t = np.arange(-reach, reach + _T_STEP_PX / 2, _T_STEP_PX)
    places = (
        line.middle_px + s[:, None, None] * line.along + t[None, :, None] * line.across
    )
    strip = picture.at(places)
    usable = np.isfinite(strip).all(axis=1)
    if usable.sum() < max(4, len(s) // 3):
        return None
    step = local_step(strip[usable], max(round(width / _T_STEP_PX), 2))
    return _strongest(step, s[usable], t, search_px)


def _s_count(line: Line) -> int:
    return int(np.clip(line.length_px * 0.76, 6, _LARGEST_S_COUNT))


def local_step(strip: FloatArray, count: int) -> FloatArray:
    """Mean grey of ``count`` samples after minus before every sample of a row."""
    padded = np.pad(np.cumsum(strip, axis=1), ((0, 0), (1, 0)))
    sums = padded[:, count:] - padded[:, :-count]
    step = np.zeros_like(strip)
    inner = (sums[:, count:] - sums[:, :-count]) / count
    step[:, count : count + inner.shape[1]] = inner
    return step


def _strongest(
    step: FloatArray, s: FloatArray, t: FloatArray, search_px: float
) -> Start:
    offsets = np.arange(-search_px, search_px + _T_STEP_PX / 2, _T_STEP_PX)
    centre = (
        offsets[None, :, None] + _SLOPES[:, None, None] * s[None, None, :] - t[0]
    ) / _T_STEP_PX
    index = np.clip(np.rint(centre).astype(np.int64), 0, step.shape[1] - 1)
    total = step[np.arange(len(s))[None, None, :], index].mean(axis=2)
    prior = 1 - (1 - _BORDER_WEIGHT) * (offsets / max(search_px, 1.0)) ** 2
    score = np.abs(total) * prior[None] * (1 - 1.5 * np.abs(_SLOPES))[:, None]
    best = np.unravel_index(int(score.argmax()), score.shape)
    return Start(
        float(offsets[best[1]]),
        float(_SLOPES[best[0]]),
        float(total[best]),
        float(score[best]),
    )
