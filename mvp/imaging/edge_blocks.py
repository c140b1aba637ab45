"""Is the step there all along? Amplitude and shift of a fitted step in short blocks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from mvp.geometry import BoolArray, FloatArray, IntArray
    from mvp.imaging.esf import SpreadValues

BLOCK_PX = 6.0
_FEWEST_PIXELS = 12
_SIGNIFICANT = 6.0
_AMPLITUDE = (0.5, 2.0)
_SHIFT_PX = 1.5
_SHIFT_PER_BLUR = 0.2
_RESIDUAL_IN_NOISE = 4.0
_RESIDUAL_IN_STEP = 0.25


@dataclass(frozen=True, eq=False)
class BlockSamples:
    """Pixels sorted into blocks, with the fitted step at each.

    Attributes:
        index: (n,) block of each pixel, 0 .. count - 1.
        count: how many blocks.
        contrast: (n,) fitted height of the step.
        spread: the fitted spread function at the pixels.
        above: (n,) grey above the lower level of the fit.
    """

    index: IntArray
    count: int
    contrast: FloatArray
    spread: SpreadValues
    above: FloatArray


def share_with_step(samples: BlockSamples, *, noise: float) -> float:
    """Share of the blocks that show any significant step of one sign at its place.

    ``contrast`` is 1 and ``above`` the plain grey here: nothing is known of the step.
    """
    columns = np.stack([np.ones_like(samples.above), samples.spread.edge], axis=1)
    gram = np.zeros((samples.count, 2, 2))
    right = np.zeros((samples.count, 2))
    np.add.at(gram, samples.index, columns[:, :, None] * columns[:, None, :])
    np.add.at(right, samples.index, columns * samples.above[:, None])
    inverse = np.linalg.inv(gram + np.eye(2) * 1e-9)
    found = np.einsum("kij,kj->ki", inverse, right)
    left = samples.above - (columns * found[samples.index]).sum(axis=1)
    number = np.bincount(samples.index, minlength=samples.count)
    square = np.bincount(samples.index, left**2, minlength=samples.count)
    rms = np.sqrt(square / np.maximum(number - 2, 1))
    significance = found[:, 1] / (noise * np.sqrt(np.maximum(inverse[:, 1, 1], 1e-12)))
    clear = (rms < 3 * noise) & (number >= _FEWEST_PIXELS)
    signs = [(clear & (sign * significance > _SIGNIFICANT)).sum() for sign in (-1, 1)]
    return float(max(signs) / samples.count)


def judge_blocks(
    samples: BlockSamples, *, noise: float, blur_px: float, height: float
) -> tuple[BoolArray, BoolArray]:
    """Which blocks can be judged (enough pixels), and which show the step.

    Every block is fitted as level + amplitude x step + shift x its slope.
    """
    slope = -samples.contrast * samples.spread.by_t
    step = samples.contrast * samples.spread.edge
    columns = np.stack([np.ones_like(step), step, slope], axis=1)
    gram = np.zeros((samples.count, 3, 3))
    right = np.zeros((samples.count, 3))
    np.add.at(gram, samples.index, columns[:, :, None] * columns[:, None, :])
    np.add.at(right, samples.index, columns * samples.above[:, None])
    number = np.bincount(samples.index, minlength=samples.count)
    found = np.linalg.solve(gram + np.eye(3) * 1e-9, right[..., None])[..., 0]
    left = samples.above - (columns * found[samples.index]).sum(axis=1)
    square = np.bincount(samples.index, left**2, minlength=samples.count)
    rms = np.sqrt(square / np.maximum(number, 1))
    amplitude = found[:, 1]
    shift = found[:, 2] / np.maximum(np.abs(amplitude), 0.2)
    good = (
        (amplitude > _AMPLITUDE[0])
        & (amplitude < _AMPLITUDE[1])
        & (np.abs(shift) < _SHIFT_PX + _SHIFT_PER_BLUR * blur_px)
        & (rms < max(_RESIDUAL_IN_NOISE * noise, _RESIDUAL_IN_STEP * height))
    )
    judged = number >= _FEWEST_PIXELS
    return np.asarray(judged), np.asarray(good & judged)
