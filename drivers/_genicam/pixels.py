"""Bytes of a stream as a grey picture, and numbers of frames as one long count."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Pixels = NDArray[np.uint8] | NDArray[np.uint16]

# PFNC code: bits of a grey value, stored in one byte or in two, low byte first.
MONO_BITS = {
    0x01080001: 8,
    0x01100003: 10,
    0x01100005: 12,
    0x01100025: 14,
    0x01100007: 16,
}
MONO_NAMES = ("Mono8", "Mono10", "Mono12", "Mono14", "Mono16")
_COUNTER_16 = 1 << 16


def grey_picture(
    data: bytes, *, width: int, height: int, pixel_code: int
) -> tuple[Pixels, int]:
    """Pixels (height, width) and the grey value of a saturated one.

    Raises:
        ValueError: a format that is not plain grey, or too few bytes.
    """
    bits = MONO_BITS.get(pixel_code)
    if bits is None:
        raise ValueError(f"pixel format 0x{pixel_code:08x} is not plain grey")
    count = width * height
    needed = count if bits == 8 else 2 * count
    if len(data) < needed:
        raise ValueError(f"{len(data)} bytes instead of {needed}")
    full_scale = (1 << bits) - 1
    if bits == 8:
        narrow = np.frombuffer(data, np.uint8, count)
        return narrow.reshape(height, width).copy(), full_scale
    wide = np.frombuffer(data, "<u2", count).astype(np.uint16)
    return wide.reshape(height, width), full_scale


def frames_between(last: int, now: int) -> int:
    """How far a frame counter went from ``last`` to ``now``; 0 when it did not.

    Counters of GigE Vision 1 have 16 bits and leave 0 out, others have 64; a wrapped
    16-bit counter may therefore seem to be one step further on than it is.
    """
    if now >= last:
        return now - last
    if last < _COUNTER_16:
        ahead = now + _COUNTER_16 - last
        if ahead < _COUNTER_16 // 2:
            return max(1, ahead - 1) if now > 0 else ahead
    return 0
