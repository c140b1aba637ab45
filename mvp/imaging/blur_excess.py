"""Blur beyond prediction: the same in all directions, or along one only."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from mvp.geometry import FloatArray

_FLOOR_PX2 = 0.35
_MODEL_SHARE = 0.12
_ROUNDS = 6
_BOX_TO_DISC = 4 / 3
"""A path of length m blurs across its direction like a disc with b^2 = 4/3 m^2."""


@dataclass(frozen=True)
class BlurExcess:
    """b^2 = b_pred^2 + isotropic + directional cos^2(angle to the motion).

    Attributes:
        isotropic_px2: alone, when no direction is assumed.
        with_direction_px2: the isotropic part beside a direction.
        directional_px2: amplitude of the directional part, >= 0.
        direction_rad: of the motion in the picture.
        gain: robust cost of the isotropic model over that of the directional one.
    """

    isotropic_px2: float
    with_direction_px2: float
    directional_px2: float
    direction_rad: float
    gain: float

    @property
    def path_px(self) -> float:
        """Length of a straight motion that explains the directional part."""
        return float(np.sqrt(self.directional_px2 / _BOX_TO_DISC))


def blur_excess(
    q_px2: FloatArray, sd_px2: FloatArray, predicted_px2: FloatArray, angle: FloatArray
) -> BlurExcess | None:
    """Fit both models to all edges that were measured well.

    Args:
        q_px2: (n,) measured b^2.
        sd_px2: (n,) their standard deviations.
        predicted_px2: (n,) predicted b^2.
        angle: (n,) direction of the edge normals, rad.
    """
    if len(q_px2) < 2:
        return None
    excess = q_px2 - predicted_px2
    sd = np.sqrt(sd_px2**2 + _FLOOR_PX2**2 + (_MODEL_SHARE * np.abs(q_px2)) ** 2)
    isotropic, cost = _fitted(excess, sd, np.ones((len(excess), 1)))
    best = (cost, np.array([isotropic[0], 0.0]), 0.0)
    for turn in np.deg2rad(np.arange(0.0, 180.0, 5.0)):
        columns = np.stack([np.ones_like(angle), np.cos(angle - turn) ** 2], axis=1)
        both, with_turn = _fitted(excess, sd, columns)
        if with_turn < best[0]:
            best = (with_turn, both, float(turn))
    gain = (cost + 0.5) / (best[0] + 0.5)
    return BlurExcess(
        float(isotropic[0]), float(best[1][0]), float(best[1][1]), best[2], float(gain)
    )


def _fitted(
    excess: FloatArray, sd: FloatArray, columns: FloatArray
) -> tuple[FloatArray, float]:
    """Huber-weighted least squares; the second part may not be negative."""
    weight = 1 / sd
    value = np.zeros(columns.shape[1])
    for _ in range(_ROUNDS):
        value = _bounded(columns * weight[:, None], excess * weight)
        left = np.abs(excess - columns @ value) / sd
        weight = np.sqrt(1 / np.maximum(left / 1.5, 1.0)) / sd
    left = np.abs(excess - columns @ value) / sd
    cost = np.where(left < 1.5, left**2 / 2, 1.5 * left - 1.125)
    return value, float(cost.mean())


def _bounded(columns: FloatArray, right: FloatArray) -> FloatArray:
    gram = columns.T @ columns + 1e-9 * np.eye(columns.shape[1])
    value = np.linalg.solve(gram, columns.T @ right)
    if len(value) == 1:
        return np.asarray(value)
    first, second = columns.T @ right / np.diag(gram)
    if value[1] < 0:
        return np.array([first, 0.0])
    if value[0] < 0:
        # Blur below prediction cannot make room for a motion.
        return np.array([0.0, max(second, 0.0)])
    return np.asarray(value)
