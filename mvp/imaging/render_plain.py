"""One ray per pixel, shaded block by block.

Light varies slowly over a plane. A block of pixels that shows a single plane is shaded
at its four corners and filled bilinearly (1e-4 of the grey at most); pixels of mixed
blocks are shaded one by one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from mvp.geometry import BoolArray, FloatArray, IntArray
    from mvp.imaging.light import Float32Array
    from mvp.imaging.render_view import CameraView

_BLOCK = 8


def plain_picture(view: CameraView) -> Float32Array:
    """(rows, columns) grey under each pixel's centre, prints left out."""
    rows, columns = view.shape
    grey = np.empty((rows, columns), dtype=np.float32)
    tall, wide = rows // _BLOCK * _BLOCK, columns // _BLOCK * _BLOCK
    whole = _whole_blocks(view, tall, wide)
    blocks = grey[:tall, :wide].reshape(tall // _BLOCK, _BLOCK, wide // _BLOCK, _BLOCK)
    at_row, at_column = np.nonzero(whole)
    blocks[at_row, :, at_column, :] = _filled(view, at_row, at_column)
    rest = np.ones((rows, columns), dtype=bool)
    mixed = ~np.repeat(np.repeat(whole, _BLOCK, axis=0), _BLOCK, axis=1)
    rest[:tall, :wide] = mixed
    pixels = np.flatnonzero(rest)
    grey.reshape(-1)[pixels] = _shaded(view, pixels, view.triangles.reshape(-1)[pixels])
    return grey


def _whole_blocks(view: CameraView, tall: int, wide: int) -> BoolArray:
    """(block rows, block columns) which blocks show one plane only."""
    planes = view.plane_ids[:tall, :wide]
    blocks = planes.reshape(tall // _BLOCK, _BLOCK, wide // _BLOCK, _BLOCK)
    first = blocks[:, :1, :, :1]
    return np.asarray((blocks == first).all(axis=(1, 3)))


def _filled(view: CameraView, at_row: IntArray, at_column: IntArray) -> Float32Array:
    """(n, block, block) grey of whole blocks."""
    columns, last = view.shape[1], _BLOCK - 1
    origin = at_row * _BLOCK * columns + at_column * _BLOCK
    corners = origin[:, None] + np.array(
        [0, last, last * columns, last * (columns + 1)]
    )
    # One triangle for all corners: its plane is the block's plane.
    triangles = np.repeat(view.triangles.reshape(-1)[origin], 4)
    grey = _shaded(view, corners.reshape(-1), triangles).reshape(-1, 4)
    filled = grey @ _bilinear_weights().astype(np.float32)
    return filled.reshape(-1, _BLOCK, _BLOCK)


def _bilinear_weights() -> FloatArray:
    """(4, block * block): corner values to the pixels of a block."""
    far = np.linspace(0.0, 1.0, _BLOCK)
    pair = np.stack([1 - far, far])
    return np.asarray(np.einsum("ay,bx->abyx", pair, pair).reshape(4, -1))


def _shaded(view: CameraView, pixels: IntArray, triangles: IntArray) -> Float32Array:
    directions = view.rays.directions.reshape(-1, 3)[pixels]
    depth = view.depths(triangles, directions)
    points = directions * np.where(triangles < 0, np.float32(1), depth)[:, None]
    return view.shade(triangles, points)
