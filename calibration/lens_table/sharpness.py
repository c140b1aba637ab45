"""The sharp distance, and blur against defocus, from the blur of many edges.

Over 1 / z the squared blur is the parabola (a / p)^2 (m - f_cal / z)^2: its foot is the
distance in best focus, its opening the pupil. Tilted views of a target sweep the distance
by themselves. A print is not perfectly sharp either: edges that are s wide on the paper
add (s f_cal / z p)^2, which lets the foot come out at a^2 / (a^2 + s^2) of the true 1 / z;
what is left at the foot tells s, and the foot is put right. How wide the pixel's own
response is takes part in what is left, so that s and with it the foot stay in doubt.

Near the foot the blur disc is smaller than pixel and diffraction, and what is measured of
it bears on how well their shapes are known. A bump there, as high as that may be off, is
fitted along; otherwise edges on one side only would drag the foot.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibration.lens_table.aperture import BlurShots
from calibration.lens_table.nodes import Measured
from mvp.errors import CalibrationError

if TYPE_CHECKING:
    from calibration.lens_table.edge_blur import EdgeBlurs
    from mvp.geometry import FloatArray

_FEWEST = 24
_ROUNDS = 12
_HUBER = 1.5
_MODEL_SHARE = 0.03
_FLOOR_PX2 = 0.03
_SHIFT_DOUBT = 1.0
# Squared diameters by which pixel (filled to 80 or 100 %) and diffraction (rounded) are off.
_RESPONSE_PX2 = 0.2
_BUMP_PX2, _BUMP_WIDTH_PX2 = 0.3, 1.0
_SOFTEST = 0.5
_BASE_SIGMA_PX = float(1 / np.sqrt(12))


@dataclass(frozen=True)
class SharpPlace:
    """The foot of the parabola.

    Attributes:
        distance_mm: in best focus from the entrance pupil, with one standard deviation.
        a_mm: diameter of the pupil by the opening, with one standard deviation.
        print_mm: how wide the print's own edges are, as a blur disc.
        edges: how many edges told it.
    """

    distance_mm: Measured
    a_mm: Measured
    print_mm: float
    edges: int


def sharp_place(
    blurs: EdgeBlurs, f_cal_mm: float, pitch_mm: float, *, scale_sigma: float = 0.0
) -> SharpPlace:
    """The distance in best focus.

    Args:
        blurs: of edges at depths on both sides of the sharp distance, or near it.
        f_cal_mm: principal distance.
        pitch_mm: row pitch of the pixels.
        scale_sigma: one standard deviation that all lengths of the target share.

    Raises:
        CalibrationError: too few edges, or blur does not grow away from any place.
    """
    if len(blurs) < _FEWEST:
        raise CalibrationError(
            f"the blur of {len(blurs)} edges does not tell where it is sharp",
            hint="take more views of a target with squares, well lit and large enough",
        )
    unit = float(np.median(1 / blurs.depth_mm))
    (second, _, rest), covariance, foot, sigma = _with_foot(unit, blurs)
    opening = float(np.sqrt(second)) * pitch_mm / (f_cal_mm * unit)
    left = max(float(rest - second * foot**2), 0.0)
    # m / p at the foot is f_cal (1 + foot) unit / p; s is what is left there by it.
    soft = float(np.sqrt(left)) * pitch_mm / (f_cal_mm * (1 + foot) * unit)
    soft = min(soft, _SOFTEST * opening)
    a = float(np.sqrt(opening**2 - soft**2))
    shift = (soft / a) ** 2
    near = (1 + foot) * unit * (1 + shift)
    in_doubt = _RESPONSE_PX2 * (pitch_mm / (f_cal_mm * near * a)) ** 2
    relative = float(
        np.linalg.norm(
            [sigma / (1 + foot), _SHIFT_DOUBT * shift, in_doubt, scale_sigma]
        )
    )
    a_sigma = a * float(np.sqrt(covariance[0, 0])) / (2 * second)
    return SharpPlace(
        Measured(1 / near, relative / near),
        Measured(a, max(a_sigma, 1e-3 * a)),
        soft,
        len(blurs),
    )


def _with_foot(
    unit: float, blurs: EdgeBlurs
) -> tuple[FloatArray, FloatArray, float, float]:
    """The parabola (3,) over 1 / z unit - 1, its covariance, its foot and that one's sigma.

    Raises:
        CalibrationError: blur does not grow away from any place.
    """
    x = 1 / (blurs.depth_mm * unit)
    found, covariance = _parabola(x - 1, blurs)
    second, first = found[:2]
    foot = -first / (2 * second) if second > 0 else np.nan
    slope = np.array([-foot / second, -1 / (2 * second), 0.0, 0.0])
    sigma = float(np.sqrt(slope @ covariance @ slope)) if second > 0 else np.inf
    spread = np.ptp(x)
    if not second > 0 or sigma > spread or abs(foot) > 3 * spread:
        raise CalibrationError(
            "the blur hardly changes with the distance",
            hint="open the iris, or take views from nearer and farther",
        )
    return found[:3], covariance, float(foot), sigma


def blur_shots(
    blurs: EdgeBlurs, defocus: FloatArray, *, pitch_mm: float, diffraction_px: float
) -> BlurShots:
    """Edges as the pupil's estimator takes them: discs as wide as all that blurs.

    Args:
        blurs: of edges at one iris.
        defocus: (k,), m - f_cal / z of each.
        pitch_mm: row pitch of the pixels.
        diffraction_px: standard deviation of the diffraction spot that was taken off.
    """
    base = 16 * (_BASE_SIGMA_PX**2 + diffraction_px**2)
    whole = np.sqrt(np.maximum(blurs.square_px2 + base, 0.25 * base))
    sigma = _total_sigma(blurs) / (2 * whole)
    return BlurShots(defocus, pitch_mm * whole, pitch_mm * sigma)


def _total_sigma(blurs: EdgeBlurs) -> FloatArray:
    """Noise of the picture, and a share of the blur for what the model leaves out."""
    model = _MODEL_SHARE * np.maximum(blurs.square_px2, 0.0)
    return np.asarray(np.sqrt(blurs.sigma_px2**2 + model**2 + _FLOOR_PX2**2))


def _parabola(x: FloatArray, blurs: EdgeBlurs) -> tuple[FloatArray, FloatArray]:
    """Robust weighted fit: coefficients (4,) of x^2, x, 1, bump, and their covariance."""
    powers = np.stack([x**2, x, np.ones_like(x)], axis=1)
    weight, robust = 1 / _total_sigma(blurs), np.ones_like(x)
    known = np.diag([0.0, 0.0, 0.0, _BUMP_PX2**-2])
    above = np.maximum(blurs.square_px2, 0.0)
    for _ in range(_ROUNDS):
        rows = np.column_stack([powers, np.exp(-above / _BUMP_WIDTH_PX2)])
        weighted = rows * (weight**2 * robust)[:, None]
        information = rows.T @ weighted + known
        seen = weighted.T @ blurs.square_px2
        found = np.asarray(np.linalg.lstsq(information, seen, rcond=None)[0])
        rest = (blurs.square_px2 - rows @ found) * weight
        scale = max(1.4826 * float(np.median(np.abs(rest))), 1e-9)
        robust = _HUBER / np.maximum(np.abs(rest) / scale, _HUBER)
        above = _above_the_foot(powers, found[:3])
    factor = max(scale, 0.3) ** 2
    information = rows.T @ weighted / factor + known
    return found, np.asarray(np.linalg.pinv(information))


def _above_the_foot(powers: FloatArray, found: FloatArray) -> FloatArray:
    """The parabola over its lowest place, and over the lowest edge where it has none."""
    height = powers @ found
    lowest = found[2] - found[1] ** 2 / (4 * found[0]) if found[0] > 0 else -np.inf
    return np.asarray(np.maximum(height - max(lowest, float(height.min())), 0.0))
