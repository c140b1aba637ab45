"""A node from pictures of a tilted target at one zoom and focus."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibration.camera import CameraOptions, calibrate_camera
from calibration.lens_table.nodes import LensNode
from calibration.projection import CAMERA_NAMES

if TYPE_CHECKING:
    from calibration.camera import CameraEstimate
    from calibration.lens_table.nodes import Measured
    from calibration.observations import Observations
    from calibration.target_shape import ShapePrior

_FREE = ("fx_px", "cx_px", "cy_px", "k1")


@dataclass(frozen=True)
class PixelGrid:
    """The sensor's pixels, and how well a point is found in them.

    Attributes:
        pitch_x_mm: width of a pixel.
        pitch_y_mm: height of a pixel.
        sigma_px: one standard deviation of a found coordinate; None: not known, then it
            is taken from the residuals.
        largest_noise_px: residuals beyond it are not noise; None: any size is believed.
    """

    pitch_x_mm: float
    pitch_y_mm: float
    sigma_px: float | None = None
    largest_noise_px: float | None = None


def node_from_views(
    seen: Observations,
    steps: tuple[int, int],
    pixels: PixelGrid,
    *,
    sharp_mm: Measured | None = None,
    pupil_mm: Measured | None = None,
    shape: ShapePrior | None = None,
    folds: int = 5,
) -> tuple[LensNode, CameraEstimate]:
    """Calibrate a camera whose pixels are known: one principal distance, centre, k1.

    Args:
        seen: pictures at this setting.
        steps: of zoom and focus.
        pixels: of the sensor.
        sharp_mm: distance in best focus from the entrance pupil.
        pupil_mm: place of the entrance pupil along the axis.
        shape: what is known of the target's flatness, which is then estimated with the
            node; None: the target is taken to be exactly as stated.
        folds: of the cross-validation over views; 0: none.

    Returns:
        The node, and the camera fit with its own verdict (tilt, coverage, residuals).

    Raises:
        CalibrationError: a view gives no pose, or too few points.
    """
    options = CameraOptions(
        free=("fx_px", "fy_px", "cx_px", "cy_px", "k1"),
        tied_focal=True,
        aspect=pixels.pitch_x_mm / pixels.pitch_y_mm,
        sigma_px=pixels.sigma_px,
        folds=folds,
        shape=shape,
        largest_noise_px=pixels.largest_noise_px,
    )
    found = calibrate_camera(seen, options)
    index = [CAMERA_NAMES.index(name) for name in _FREE]
    node = LensNode.from_camera(
        steps,
        [float(value) for value in found.camera.values[index]],
        found.camera_covariance[np.ix_(index, index)],
        pitch_x_mm=pixels.pitch_x_mm,
        sharp_mm=sharp_mm,
        pupil_mm=pupil_mm,
        fill=filled_share(seen),
    )
    return node, found


def filled_share(seen: Observations) -> float:
    """Share of the picture's short side that the target's points span, mean of views."""
    short = int(seen.height_px < seen.width_px)
    side = min(seen.width_px, seen.height_px)
    spans = [np.ptp(seen.of_view(view)[1][:, short]) for view in range(seen.views)]
    return float(np.mean(spans) / side)
