"""How blurred the edges of a target's squares are, each at its own depth.

Along every side of a square the grey levels of the pixels themselves (nothing is
resampled) are compared with the spread function of a blur disc behind pixel and
diffraction. The square of the disc's diameter is estimated: it stays unbiased where the
disc vanishes, and over depth it is a parabola in 1 / z with the sharp place at its foot.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibration.projection import project
from calibration.targets.layout import Charuco, Chessboard
from mvp.imaging.esf import Optics, angle_bin, spread_at

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from calibration.projection import PinholeCamera
    from calibration.targets.layout import Target
    from mvp.geometry import BoolArray, FloatArray

_ENDS = (0.22, 0.78)
_MOST_EDGES = 40
_WIDEST_PX, _NARROWEST_PX = 12.0, 2.5
_BANDS = 2
_ROUNDS = 9
_START_PX2 = 6.0
_LEAST_STEP = 12.0
_CLIPPED = 252
_ANGLE_STEP = 9
_DIFFRACTION_STEP = 0.1
_PLATEAU_PX = 1.0


@dataclass(frozen=True, eq=False)
class EdgeBlurs:
    """Edges of one picture, or of several.

    Attributes:
        depth_mm: (k,), of the middle of each edge from the entrance pupil.
        square_px2: (k,), squared diameter of the blur disc, row pitches; a little below
            zero is possible.
        sigma_px2: (k,), one standard deviation by the picture's own noise.
    """

    depth_mm: FloatArray
    square_px2: FloatArray
    sigma_px2: FloatArray

    def __len__(self) -> int:
        return len(self.depth_mm)

    @classmethod
    def joined(cls, many: list[EdgeBlurs]) -> EdgeBlurs:
        """All of them together."""
        return cls(
            np.concatenate([one.depth_mm for one in many] or [np.zeros(0)]),
            np.concatenate([one.square_px2 for one in many] or [np.zeros(0)]),
            np.concatenate([one.sigma_px2 for one in many] or [np.zeros(0)]),
        )


def optics_of(
    f_cal_mm: float, a_mm: float, *, pitch_mm: float, lambda_mm: float
) -> Optics:
    """Pixel and diffraction; the latter coarsely, it is fitted along with the sharp place."""
    spot = lambda_mm * f_cal_mm / a_mm / pitch_mm
    return Optics(1.0, round(spot / _DIFFRACTION_STEP) * _DIFFRACTION_STEP)


def edge_blurs(
    grey: NDArray[np.uint8],
    target: Target,
    camera: PinholeCamera,
    camera_from_target: tuple[FloatArray, FloatArray],
    optics: Optics,
    *,
    start_px2: float = _START_PX2,
) -> EdgeBlurs:
    """Blur of the sides of a target's squares.

    Args:
        grey: (rows, columns), 8 bits.
        target: with squares; a grid of discs gives nothing.
        camera: intrinsics, good to a few pixels in the picture.
        camera_from_target: rotation (3, 3) and translation (3,), mm.
        optics: pixel and diffraction.
        start_px2: about how large the squared blur is.
    """
    sides = _sides(target)
    if not len(sides):
        return EdgeBlurs.joined([])
    rotation, translation = camera_from_target
    middle = sides.mean(axis=1)
    depth = (middle @ rotation.T + translation)[:, 2]
    share = np.array(_ENDS)[:, None]
    ends = sides[:, :1] * (1 - share) + sides[:, 1:] * share
    pixels = project(camera, rotation, translation, ends)
    width = _free_px(target, camera, rotation, translation, sides)
    inside = _inside(pixels, np.minimum(width, _WIDEST_PX), grey.shape)
    chosen = np.flatnonzero(inside & (width >= _NARROWEST_PX))
    chosen = chosen[:: max(1, len(chosen) // _MOST_EDGES)]
    found = [
        _settled(grey, pixels[k], float(width[k]), optics, start_px2) for k in chosen
    ]
    good = [i for i, one in enumerate(found) if one is not None]
    values = np.array([found[i] for i in good], dtype=np.float64).reshape(-1, 2)
    return EdgeBlurs(depth[chosen][good], values[:, 0], values[:, 1])


def _sides(target: Target) -> FloatArray:
    """(k, 2, 3): the ends of every side between two neighbouring corners."""
    if isinstance(target, Charuco):
        columns, rows = target.columns - 1, target.rows - 1
    elif isinstance(target, Chessboard):
        columns, rows = target.columns, target.rows
    else:
        return np.zeros((0, 2, 3))
    grid = target.points_mm.reshape(rows, columns, 3)
    across = np.stack([grid[:, :-1], grid[:, 1:]], axis=2).reshape(-1, 2, 3)
    down = np.stack([grid[:-1], grid[1:]], axis=2).reshape(-1, 2, 3)
    return np.concatenate([across, down])


def _free_px(
    target: Target,
    camera: PinholeCamera,
    rotation: FloatArray,
    translation: FloatArray,
    sides: FloatArray,
) -> FloatArray:
    """(k,): how far on both sides of an edge there is nothing but white and black."""
    square = target.spacing.mm
    free = 0.45 * square
    if isinstance(target, Charuco):
        free = 0.95 * (square - target.marker_mm) / 2
    along = (sides[:, 1] - sides[:, 0]) / square
    aside = np.stack([-along[:, 1], along[:, 0], 0 * along[:, 0]], axis=1)
    middle = sides.mean(axis=1)
    places = np.stack([middle, middle + along, middle + aside], axis=1)
    pixels = project(camera, rotation, translation, places)
    one, other = pixels[:, 1] - pixels[:, 0], pixels[:, 2] - pixels[:, 0]
    area = np.abs(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0])
    scale = area / np.maximum(np.linalg.norm(one, axis=1), 1e-9)
    return np.asarray(free * scale)


def _inside(pixels: FloatArray, width: FloatArray, shape: tuple[int, ...]) -> BoolArray:
    reach = width[:, None, None] + 1
    ends = np.array([shape[1], shape[0]]) - 1
    with np.errstate(invalid="ignore"):
        good = (pixels >= reach) & (pixels <= ends - reach)
    return np.asarray(good.all(axis=(1, 2)))


def _settled(
    grey: NDArray[np.uint8],
    ends: FloatArray,
    free_px: float,
    optics: Optics,
    start_px2: float,
) -> tuple[float, float] | None:
    """As ``_one``, in a band that the blur of what lies beyond does not reach."""
    blur_px2 = start_px2
    found: tuple[float, float] | None = None
    for _ in range(_BANDS):
        width = min(free_px - np.sqrt(max(blur_px2, 0.0)) / 2, _WIDEST_PX)
        if width < _NARROWEST_PX:
            return None
        found = _one(grey, ends, width, optics, blur_px2)
        if found is None:
            return None
        blur_px2 = found[0]
    return found


def _one(
    grey: NDArray[np.uint8],
    ends: FloatArray,
    width: float,
    optics: Optics,
    start_px2: float,
) -> tuple[float, float] | None:
    """Squared blur and its sigma of one edge; None where it cannot be measured."""
    values, across, along, normal = _band(grey, ends, width)
    if len(values) < 40 or values.max() >= _CLIPPED:
        return None
    bins = angle_bin(np.broadcast_to(normal, (len(values), 2)))
    bins = np.minimum(_ANGLE_STEP * np.rint(bins / _ANGLE_STEP), 45).astype(np.int64)
    right = across > 0
    low, high = float(values[~right].mean()), float(values[right].mean())
    if abs(high - low) < _LEAST_STEP:
        return None
    state = np.array([low, high, 0.0, 0.0, min(start_px2, width**2)])
    for _ in range(_ROUNDS):
        spread = spread_at(optics, across - state[2] - state[3] * along, state[4], bins)
        step = state[1] - state[0]
        rest = values - (state[0] + step * spread.edge)
        slope = np.stack(
            [
                1 - spread.edge,
                spread.edge,
                -step * spread.by_t,
                -step * spread.by_t * along,
                step * spread.by_q,
            ],
            axis=1,
        )
        normal_matrix = slope.T @ slope
        try:
            change = np.linalg.solve(normal_matrix, slope.T @ rest)
        except np.linalg.LinAlgError:
            return None
        change[4] = np.clip(change[4], -0.6 * max(state[4], 2.0), max(state[4], 2.0))
        change[2:4] = np.clip(change[2:4], -1.5, 1.5)
        state = state + change
        if abs(change[4]) < 1e-3 * max(state[4], 1.0):
            break
    else:
        return None
    blur = np.sqrt(max(state[4], 0.0))
    if blur / 2 + _PLATEAU_PX > width or abs(state[2]) > width / 2:
        return None
    variance = float((rest**2).sum()) / (len(values) - 5)
    sigma = np.sqrt(variance * np.linalg.inv(normal_matrix)[4, 4])
    return float(state[4]), float(sigma)


def _band(
    grey: NDArray[np.uint8], ends: FloatArray, width: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Grey, distance across and share along (-1 .. 1) of the pixels beside an edge."""
    low = np.floor(ends.min(axis=0) - width).astype(int)
    high = np.ceil(ends.max(axis=0) + width).astype(int)
    part = grey[low[1] : high[1] + 1, low[0] : high[0] + 1]
    rows, columns = np.mgrid[low[1] : high[1] + 1, low[0] : high[0] + 1]
    direction = ends[1] - ends[0]
    length = float(np.linalg.norm(direction))
    direction = direction / length
    normal = np.array([-direction[1], direction[0]])
    offset = np.stack([columns, rows], axis=-1) - ends.mean(axis=0)
    across, along = offset @ normal, offset @ direction
    near = (np.abs(across) <= width) & (np.abs(along) <= length / 2)
    return (
        part[near].astype(np.float64),
        across[near],
        along[near] * (2 / length),
        normal,
    )
