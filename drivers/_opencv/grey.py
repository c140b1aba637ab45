"""Pictures of any source as grey values that are linear in light."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

_BYTE = 255
_WORD = 65535


def as_grey(
    picture: NDArray[np.uint8] | NDArray[np.uint16], gamma: float
) -> tuple[NDArray[np.uint8] | NDArray[np.uint16], int]:
    """Grey picture (rows, columns) and the value of a saturated pixel.

    Args:
        picture: (rows, columns), or (rows, columns, 3 or 4) in blue, green, red.
        gamma: exponent that the grey values (0 to 1) are raised to.
    """
    import cv2

    full_scale = _WORD if picture.dtype == np.uint16 else _BYTE
    if picture.ndim == 3:
        code = cv2.COLOR_BGRA2GRAY if picture.shape[2] == 4 else cv2.COLOR_BGR2GRAY
        picture = _same_kind(np.asarray(cv2.cvtColor(picture, code)))
    if gamma == 1.0:
        return picture, full_scale
    levels = np.arange(full_scale + 1) / full_scale
    table = np.rint(levels**gamma * full_scale).astype(picture.dtype)
    return _same_kind(table[picture]), full_scale


def _same_kind(picture: NDArray[np.generic]) -> NDArray[np.uint8] | NDArray[np.uint16]:
    if picture.dtype == np.uint16:
        return picture.astype(np.uint16, copy=False)
    return picture.astype(np.uint8, copy=False)
