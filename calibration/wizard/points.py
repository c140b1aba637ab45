"""Residuals point by point, as a session's result keeps them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mvp.calibrated import PointResiduals

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.geometry import FloatArray
    from mvp.wizard import Sample

_DIGITS = 4


def points_of(
    samples: Sequence[Sample], errors_px: FloatArray
) -> tuple[PointResiduals, ...]:
    """Of target views; errors (m, 2), foretold less found, in the samples' order.

    Raises:
        ValueError: not one error for each point.
    """
    ends = np.cumsum([len(sample.ids) for sample in samples])
    if not len(ends) or ends[-1] != len(errors_px):
        raise ValueError("there must be one error for each point of the samples")
    blocks = np.split(errors_px, ends[:-1])
    return tuple(
        residuals(sample.name, [str(number) for number in sample.ids], block)
        for sample, block in zip(samples, blocks, strict=True)
    )


def residuals(view: str, ids: list[str], errors_px: FloatArray) -> PointResiduals:
    """Of one view; errors (m, 2)."""
    rounded = np.round(errors_px, _DIGITS)
    return PointResiduals(
        view=view, ids=ids, dx_px=rounded[:, 0].tolist(), dy_px=rounded[:, 1].tolist()
    )


def rms_px(points: Sequence[PointResiduals]) -> float:
    """Root mean square of the distance of a point."""
    squares = np.concatenate([np.square(p.dx_px) + np.square(p.dy_px) for p in points])
    return float(np.sqrt(squares.mean()))
