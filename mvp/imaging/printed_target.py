"""A printed calibration target, drawn as the picture of what is on the paper.

Everything is drawn from edges in millimetres: a texel holds the part of it that is
dark, so that an edge lies where it should, wherever the texels are. The target frame is
x to the right, y down, z into the board for somebody who looks at it; a ChArUco board's
origin is its outer corner, that of the others their first point.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from mvp.errors import ConfigError
from mvp.geometry import FloatArray, Pose
from mvp.imaging.render_body import RenderBody, textured_plane

if TYPE_CHECKING:
    from mvp.calibrated import TargetPrint
    from mvp.geometry import BoolArray
    from mvp.imaging.light import Float32Array

_BLACK, _WHITE = 0.05, 0.85
_TEXEL_MM = 0.06
_MOST_TEXELS = 9_000_000
_BORDER = 0.5  # of a square, white, around everything printed
_DISC_PARTS = 8  # samples along each side of a texel that a disc's edge crosses


def printed_target(
    layout: TargetPrint, world_from_target: Pose, *, texel_mm: float = _TEXEL_MM
) -> RenderBody:
    """The target as a flat body.

    Args:
        layout: what is printed.
        world_from_target: where it lies.
        texel_mm: about how fine it is drawn; large targets are drawn coarser.

    Raises:
        ConfigError: a marker dictionary that OpenCV does not know.
    """
    low, high = extent_mm(layout)
    texel = _texel_mm(layout.square_mm, high - low, texel_mm)
    albedo = target_albedo(layout, texel)
    shift = Pose("target", "texture", np.eye(3), np.array([*low, 0.0]))
    pose = Pose(
        "world", "target", world_from_target.rotation, world_from_target.translation_mm
    )
    return textured_plane(albedo, texel, pose @ shift, name="target")


def extent_mm(layout: TargetPrint) -> tuple[FloatArray, FloatArray]:
    """Corners (2,) of the paper in the target frame, white border included."""
    side = layout.square_mm
    size = np.array([layout.columns, layout.rows], dtype=np.float64) * side
    if layout.kind == "charuco":
        low, high = np.zeros(2), size
    elif layout.kind == "chessboard":
        low, high = np.full(2, -side), size
    else:
        reach = (side + layout.diameter_mm) / 2
        low, high = np.full(2, -reach), _disc_centres(layout).max(axis=0) + reach
    border = _BORDER * side
    return low - border, high + border


def target_albedo(layout: TargetPrint, texel_mm: float) -> Float32Array:
    """Reflectance (rows, columns) of the paper.

    Raises:
        ConfigError: a marker dictionary that OpenCV does not know.
    """
    low, high = extent_mm(layout)
    columns, rows = np.round((high - low) / texel_mm).astype(int)
    dark = np.zeros((rows, columns), dtype=np.float32)
    if layout.kind == "circle-grid":
        for centre in _disc_centres(layout) - low:
            _add_disc(dark, centre / texel_mm, layout.diameter_mm / 2 / texel_mm)
    else:
        for x, y, width, height in _rectangles(layout):
            corner = (np.array([x, y]) - low) / texel_mm
            _add_box(dark, corner, np.array([width, height]) / texel_mm)
    return np.asarray(_WHITE + (_BLACK - _WHITE) * np.clip(dark, 0, 1), np.float32)


def _texel_mm(square_mm: float, size_mm: FloatArray, wanted_mm: float) -> float:
    """A whole number of texels for half a square, and not too many in all."""
    coarsest = max(wanted_mm, float(np.sqrt(np.prod(size_mm) / _MOST_TEXELS)))
    return square_mm / (2 * max(1, round(square_mm / 2 / coarsest)))


def _rectangles(layout: TargetPrint) -> list[tuple[float, float, float, float]]:
    """Dark x, y, width, height in the target frame, mm; none overlaps another."""
    side = layout.square_mm
    if layout.kind == "chessboard":
        inner = _every_other(layout.columns + 1, layout.rows + 1, 0)
        return [((c - 1) * side, (r - 1) * side, side, side) for r, c in inner]
    squares = _every_other(layout.columns, layout.rows, _first_white(layout))
    dark = [(c * side, r * side, side, side) for r, c in squares]
    return dark + _marker_boxes(layout)


def _first_white(layout: TargetPrint) -> int:
    """1 for a ChArUco board whose first square is white, otherwise 0."""
    return int(layout.legacy and layout.rows % 2 == 0)


def _every_other(columns: int, rows: int, parity: int) -> list[tuple[int, int]]:
    """(row, column) of the squares whose row and column add up to even or odd."""
    total = np.add.outer(np.arange(rows), np.arange(columns))
    row, column = np.nonzero(total % 2 == parity)
    return list(zip(row.tolist(), column.tolist(), strict=True))


def _marker_boxes(layout: TargetPrint) -> list[tuple[float, float, float, float]]:
    """Dark runs of the markers: one marker for each white square, row by row."""
    marker, side = layout.marker_mm, layout.square_mm
    if marker is None:
        raise ValueError("a ChArUco board has markers")
    dictionary = _dictionary(layout.dictionary)
    places = _every_other(layout.columns, layout.rows, 1 - _first_white(layout))
    if len(places) > len(dictionary.bytesList):
        raise ConfigError(
            f"{layout.dictionary} has {len(dictionary.bytesList)} markers, the board "
            f"needs {len(places)}",
            hint="choose a larger dictionary, or fewer squares",
        )
    bits = dictionary.markerSize + 2
    module, margin = marker / bits, (side - marker) / 2
    boxes = []
    for number, (row, column) in enumerate(places):
        image = cv2.aruco.generateImageMarker(dictionary, number, bits)
        x, y = column * side + margin, row * side + margin
        for line, start, end in _runs(image == 0):
            boxes.append(
                (
                    x + start * module,
                    y + line * module,
                    (end - start) * module,
                    module,
                )
            )
    return boxes


def _runs(dark: BoolArray) -> list[tuple[int, int, int]]:
    """Row, first and end column of every run of dark bits."""
    padded = np.pad(dark, ((0, 0), (1, 1))).astype(np.int8)
    row, first = np.nonzero(np.diff(padded, axis=1) == 1)
    _, end = np.nonzero(np.diff(padded, axis=1) == -1)
    return list(zip(row.tolist(), first.tolist(), end.tolist(), strict=True))


def _dictionary(name: str) -> cv2.aruco.Dictionary:
    number = getattr(cv2.aruco, f"DICT_{name}", None)
    if not isinstance(number, int):
        raise ConfigError(
            f"there is no marker dictionary {name!r}",
            hint="OpenCV's names without DICT_, such as 5X5_250",
        )
    return cv2.aruco.getPredefinedDictionary(number)


def _disc_centres(layout: TargetPrint) -> FloatArray:
    row, column = np.divmod(np.arange(layout.rows * layout.columns), layout.columns)
    if layout.asymmetric:
        column = 2 * column + row % 2
    return np.asarray(np.stack([column, row], axis=1) * layout.square_mm, np.float64)


def _add_box(dark: Float32Array, corner: FloatArray, size: FloatArray) -> None:
    """Add the covered part of every texel; corner and size (x, y) in texels."""
    (columns, across), (rows, down) = (
        _covered(float(corner[axis]), float(size[axis])) for axis in (0, 1)
    )
    dark[rows, columns] += np.outer(down, across)


def _covered(start: float, length: float) -> tuple[slice, Float32Array]:
    """Which texels of a line an interval touches, and how much of each."""
    first, last = int(np.floor(start)), int(np.ceil(start + length))
    place = np.arange(first, last)
    part = np.minimum(place + 1, start + length) - np.maximum(place, start)
    return slice(first, last), part.astype(np.float32)


def _add_disc(dark: Float32Array, centre: FloatArray, radius: float) -> None:
    """Add a disc; centre and radius in texels."""
    low, high = (
        np.floor(centre - radius).astype(int),
        np.ceil(centre + radius).astype(int),
    )
    parts = (np.arange(_DISC_PARTS) + 0.5) / _DISC_PARTS
    x = (np.arange(low[0], high[0])[:, None] + parts).ravel() - centre[0]
    y = (np.arange(low[1], high[1])[:, None] + parts).ravel() - centre[1]
    inside = np.add.outer(y**2, x**2) < radius**2
    shape = (high[1] - low[1], _DISC_PARTS, high[0] - low[0], _DISC_PARTS)
    dark[low[1] : high[1], low[0] : high[0]] += inside.reshape(shape).mean(axis=(1, 3))
