"""The mean of a print over many places around every pixel, without looking twice.

Most pixels of a printed target lie within one colour: all their places show the same,
and one is enough. The others are looked up tile by tile, so that the piece of the print
that a tile shows stays in the processor's cache from one place to the next.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import cv2
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mvp.geometry import BoolArray, IntArray
    from mvp.imaging.light import Float32Array
    from mvp.imaging.render_body import PlanarTexture

_TILE, _CHUNK = 64, 8192  # pixels along a side, pixels at a time
_NEIGHBOUR = (
    1.5  # texels: rounding to the nearest one, and the second of a bilinear pair
)


def averaged_lookup(
    texture: PlanarTexture, ways: Float32Array, shares: Float32Array
) -> Float32Array:
    """Reflectance (h, w): the mean over n places around every pixel.

    Args:
        texture: the print.
        ways: (k, h, w, 2) texel coordinates; the first are those of the pixels' centres,
            the others what one unit of each way adds to them.
        shares: (n, k) how much of each way leads to each place; the first column is 1.
    """
    found = _looked_up(texture.albedo, ways[0])
    rows, columns = _by_tile(~_of_one_colour(texture, ways, shares))
    own = ways[:, rows, columns]
    places = np.empty((len(shares), 2 * _CHUNK), dtype=np.float32)
    for start in range(0, len(rows), _CHUNK):
        part = slice(start, start + _CHUNK)
        some = own[:, part].reshape(len(ways), -1)
        there = np.matmul(shares, some, out=places[:, : some.shape[1]])
        seen = _looked_up(texture.albedo, there.reshape(len(shares), -1, 2))
        found[rows[part], columns[part]] = seen.mean(axis=0)
    return found


def _by_tile(chosen: BoolArray) -> tuple[IntArray, IntArray]:
    """Rows and columns of the chosen pixels, neighbours close together."""
    rows, columns = np.nonzero(chosen)
    order = np.lexsort((columns // _TILE, rows // _TILE))
    return rows[order], columns[order]


def _of_one_colour(
    texture: PlanarTexture, ways: Float32Array, shares: Float32Array
) -> BoolArray:
    """(h, w) pixels whose places all lie where the print does not change."""
    most = np.abs(shares[:, 1:]).max(axis=0)
    far = np.abs(ways[1:])
    reach = np.tensordot(most, np.maximum(far[..., 0], far[..., 1]), axes=1)
    rows, columns = texture.albedo.shape
    # No places at all, or ones at infinity, count as changing.
    column, row = _nearest(ways[0, ..., 0], columns), _nearest(ways[0, ..., 1], rows)
    room = texture.room_texels[row, column]
    return np.asarray(reach + _NEIGHBOUR <= room)


def _nearest(place: Float32Array, count: int) -> NDArray[np.int32]:
    """Whole texels (h, w) within a side of the print."""
    inside = np.nan_to_num(place, nan=0.0, posinf=0.0, neginf=0.0)
    np.clip(inside, np.float32(0), np.float32(count - 1), out=inside)
    return np.rint(inside, out=inside).astype(np.int32)


def _looked_up(albedo: Float32Array, texels: Float32Array) -> Float32Array:
    """Bilinear lookup (h, w) at texel coordinates (h, w, 2), edge texels repeated."""
    found = cv2.remap(
        albedo,
        texels,
        cast("Float32Array", None),
        interpolation=cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return np.asarray(found, dtype=np.float32).reshape(texels.shape[:2])
