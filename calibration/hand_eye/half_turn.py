"""A symmetric board that was read from its other end in some of the views.

A board with equal ends looks the same after half a turn about its normal. The hand and the
camera turn by the same angle between two views; half a turn of the board in one of them
breaks this, and taking it back mends it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibration.verdict import Cause

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibration.poses import Poses
    from mvp.geometry import BoolArray, FloatArray

_BETTER = 4.0
_LEAST_VIEWS = 4
_HALF_TURN = np.diag([-1.0, -1.0, 1.0])


def half_turned(fixed_from_moving: Poses, camera_from_target: Poses) -> BoolArray:
    """Which views (n,) show the target half a turn off the others; the fewer ones.

    All false where that explains nothing.
    """
    count = len(fixed_from_moving)
    if count < _LEAST_VIEWS:
        return np.zeros(count, dtype=np.bool_)
    hand = _turns(fixed_from_moving.rotation)
    seen = camera_from_target.rotation
    alike = np.abs(hand - _turns(seen))
    other = np.abs(hand - _turns(seen, seen @ _HALF_TURN))
    apart = np.where(other < alike, 1.0, -1.0)
    np.fill_diagonal(apart, -1.0)
    side = np.linalg.eigh(-apart)[1][:, -1]
    turned = np.asarray(side < 0)
    if 2 * turned.sum() > count:
        turned = ~turned
    mixed = turned[:, None] != turned
    after = np.where(mixed, other, alike)
    off = ~np.eye(count, dtype=np.bool_)
    mended = _rms(after[off]) * _BETTER < _rms(alike[off])
    return turned if turned.any() and mended else np.zeros(count, dtype=np.bool_)


def causes(
    fixed_from_moving: Poses, camera_from_target: Poses, names: Sequence[str]
) -> tuple[Cause, ...]:
    """What speaks against the pictures of a symmetric board."""
    turned = half_turned(fixed_from_moving, camera_from_target)
    if not turned.any():
        return ()
    listed = ", ".join(name for name, is_it in zip(names, turned, strict=True) if is_it)
    return (
        Cause(
            "half-turned",
            "no-go",
            f"the target was read half a turn off in {listed}: it looks the same from "
            "both ends",
            "use a board with an odd and an even number of corners, or a ChArUco board; "
            "until then leave these views out",
        ),
    )


def _turns(rotation: FloatArray, other: FloatArray | None = None) -> FloatArray:
    """(n, n): angles between rotations i and j (of the other set), rad."""
    second = rotation if other is None else other
    trace = np.einsum("iab,jab->ij", rotation, second)
    return np.asarray(np.arccos(np.clip((trace - 1) / 2, -1, 1)))


def _rms(values: FloatArray) -> float:
    return float(np.sqrt((values**2).mean()))
