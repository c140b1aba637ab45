"""Principal distance and pupil from a squarely faced target and a travel along the axis.

The way where the depth of field forbids a tilted target. How the travel is laid along
the axis before hand-eye is known: ``camera_from_tool`` finds the camera's axes from a few
small moves; after a travel the one point of the image that did not move (the focus of
expansion) says by how much the direction misses the axis, ``next_direction`` turns it,
and the travel is repeated until the two agree. What is left is part of the fit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from calibration.estimate import Estimate, FitOptions, fit
from calibration.lens_table.nodes import LensNode, Measured
from calibration.lens_table.travel_problem import (
    TravelProblem,
    TravelShots,
    TravelState,
    camera_of,
)
from calibration.planar import homography, pose_from_homography
from calibration.projection import PinholeCamera, to_normalised
from mvp.errors import CalibrationError

if TYPE_CHECKING:
    from mvp.geometry import FloatArray

_OPTIONS = FitOptions(most_steps=60, tolerance=1e-6)
_LEAST_GROWTH = 0.01
_FLAT_MOVES = 0.05
_NARROWEST = (0.1, 200.0)
_LENS_NAMES = ("f_px", "cx_px", "cy_px", "k1")


@dataclass(frozen=True)
class TravelPrior:
    """What is known of the camera: a squarely faced target does not show its centre.

    Attributes:
        centre_px: image centre, from other nodes or the middle of the picture.
        centre_sigma_px: one standard deviation of each coordinate.
        k1: OpenCV's; None: not known, found together with the rest.
        k1_sigma: its one standard deviation.
        aspect: fy / fx = pixel pitch x / pitch y.
    """

    centre_px: tuple[float, float]
    centre_sigma_px: float
    k1: float | None = None
    k1_sigma: float = 0.0
    aspect: float = 1.0


@dataclass(frozen=True, eq=False)
class TravelResult:
    """What a travel tells.

    Attributes:
        f_px: principal distance by pixel width; ``f_sigma_px`` one standard deviation.
        pupil_to_target_mm: along the optical axis from the entrance pupil to the middle
            of the target's points, where travel is 0; with ``pupil_sigma_mm``.
        expansion_px: (2,), the image point that does not move.
        direction_camera: (3,), unit vector of the travel in camera axes.
        off_axis_rad: angle between travel and optical axis.
        tilt_rad: angle between the target's normal and the optical axis.
        lens: (4,), f_px, cx, cy, k1.
        lens_covariance: (4, 4) of them.
        estimate: covariance, condition, weakest direction, chi-square.
    """

    f_px: float
    f_sigma_px: float
    pupil_to_target_mm: float
    pupil_sigma_mm: float
    expansion_px: FloatArray
    direction_camera: FloatArray
    off_axis_rad: float
    tilt_rad: float
    lens: FloatArray
    lens_covariance: FloatArray
    estimate: Estimate

    def node(
        self,
        steps: tuple[int, int],
        *,
        pitch_x_mm: float,
        sharp_mm: Measured | None = None,
        fill: float = 1.0,
    ) -> LensNode:
        """For the table; the target stays where it is while focus changes.

        Args:
            steps: of zoom and focus.
            pitch_x_mm: width of a pixel.
            sharp_mm: distance in best focus from the pupil.
            fill: share of the short side that the target filled.
        """
        return LensNode.from_camera(
            steps,
            [float(value) for value in self.lens],
            self.lens_covariance,
            pitch_x_mm=pitch_x_mm,
            sharp_mm=sharp_mm,
            pupil_mm=Measured(-self.pupil_to_target_mm, self.pupil_sigma_mm),
            fill=fill,
        )


def measure_travel(shots: TravelShots, prior: TravelPrior) -> TravelResult:
    """Principal distance and place of the pupil.

    Raises:
        CalibrationError: the target hardly changed its size.
    """
    middle = shots.points_target_mm.mean(axis=0)
    shots = replace(shots, points_target_mm=shots.points_target_mm - middle)
    mean = np.array([0.0, *prior.centre_px, prior.k1 or 0.0])
    k1_sigma = prior.k1_sigma if prior.k1 is not None else np.inf
    sigma = np.array([np.inf, prior.centre_sigma_px, prior.centre_sigma_px, k1_sigma])
    problem = TravelProblem(shots, (mean, sigma))
    found = fit(problem, _start(shots, prior), _OPTIONS)
    state, estimate = found.state, found.estimate
    camera = state.camera
    slope = state.direction[:2] / state.direction[2]
    focal = np.array([camera.fx_px, camera.fy_px])
    return TravelResult(
        camera.fx_px,
        estimate.sigma_of("f_px"),
        float(state.translation_mm[2]),
        estimate.sigma_of("tz_mm"),
        np.array([camera.cx_px, camera.cy_px]) + slope * focal,
        state.direction,
        float(np.arctan(np.hypot(*slope))),
        float(np.arccos(np.clip(abs(state.rotation[2, 2]), 0, 1))),
        np.array([camera.fx_px, camera.cx_px, camera.cy_px, camera.k1]),
        estimate.block(_LENS_NAMES),
        estimate,
    )


def camera_from_tool(
    moves_tool_mm: FloatArray, places_camera_mm: FloatArray
) -> FloatArray:
    """How the camera is turned in the tool, from moves of the tool without turning.

    Args:
        moves_tool_mm: (k, 3), where the tool was, in its own axes.
        places_camera_mm: (k, 3), where a fixed target then was in camera axes; a nominal
            principal distance is good enough.

    Returns:
        (3, 3); its transpose's third column is the optical axis in the tool.

    Raises:
        CalibrationError: the moves do not span three directions.
    """
    moves = moves_tool_mm - moves_tool_mm.mean(axis=0)
    places = places_camera_mm - places_camera_mm.mean(axis=0)
    spread = np.linalg.svd(moves, compute_uv=False)
    if len(moves) < 4 or spread[2] < _FLAT_MOVES * spread[0]:
        raise CalibrationError(
            "the moves that look for the optical axis do not span three directions",
            hint="move the tool along each of its three axes by similar lengths",
        )
    u, _, vt = np.linalg.svd(-places.T @ moves)
    return np.asarray(u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt)


def next_direction(
    direction_tool: FloatArray, camera_in_tool: FloatArray, direction_camera: FloatArray
) -> FloatArray:
    """The direction (tool axes) to travel next so that it is along the optical axis.

    Args:
        direction_tool: (3,) that was travelled.
        camera_in_tool: (3, 3), from ``camera_from_tool``; a few degrees off is enough.
        direction_camera: (3,), what a travel found.
    """
    axis = np.array([0.0, 0.0, 1.0])
    across = np.cross(direction_camera, axis)
    angle = np.arctan2(np.linalg.norm(across), direction_camera[2])
    vector = across / max(float(np.linalg.norm(across)), 1e-300) * angle
    turn = Rotation.from_rotvec(vector).as_matrix()
    turned = camera_in_tool.T @ turn @ camera_in_tool @ direction_tool
    return np.asarray(turned / np.linalg.norm(turned))


def _start(shots: TravelShots, prior: TravelPrior) -> TravelState:
    """1 / size is linear in travel; where size would be 0 is the focus of expansion."""
    plane = shots.points_target_mm[:, :2]
    maps = [homography(plane, pixels) for pixels in shots.pixels]
    middles = np.array([h[:2, 2] / h[2, 2] for h in maps])
    size = np.array([_size_at_origin(h, prior.aspect) for h in maps])
    slope, zero = np.polyfit(shots.travel_mm, 1 / size, 1)
    growth = np.ptp(size) / size.mean()
    if growth < _LEAST_GROWTH or slope == 0:
        raise CalibrationError(
            f"the target changed its size by {100 * growth:.1f} % over the travel",
            hint="travel towards the target, by a fifth of its distance or more",
        )
    _check_units(1 / abs(float(slope)), shots)
    foe = np.array([np.polyfit(size, middles[:, i], 1)[1] for i in range(2)])
    sense = -np.sign(slope)
    f = 1 / abs(slope)
    tangent = (foe - np.array(prior.centre_px)) / (f * np.array([1, prior.aspect]))
    direction = np.array([*tangent, 1.0]) / np.hypot(np.hypot(*tangent), 1.0)
    f *= float(direction[2])
    camera = PinholeCamera(f, f * prior.aspect, *prior.centre_px, prior.k1 or 0.0)
    rotation, translation = _pose(shots, camera, zero * f)
    count = len(shots.travel_mm)
    return TravelState(
        camera_of(np.array([f, *prior.centre_px, prior.k1 or 0.0]), camera),
        rotation,
        translation,
        sense * direction,
        np.zeros((count, 3)),
        np.tile(np.eye(3), (count, 1, 1)),
    )


def _check_units(f_px: float, shots: TravelShots) -> None:
    """The field of view that follows is that of a lens."""
    reach = float(np.ptp(shots.pixels.reshape(-1, 2), axis=0).max())
    if not _NARROWEST[0] * reach < f_px < _NARROWEST[1] * reach:
        raise CalibrationError(
            f"a principal distance of {f_px:.3g} px follows from the travel, with points "
            f"over {reach:.0f} px: travel and target are in different units",
            hint="give the travel and the target's squares in millimetres",
        )


def _size_at_origin(matrix: FloatArray, aspect: float) -> float:
    """Pixels (widths) per mm of a homography at the plane's origin."""
    h = matrix / matrix[2, 2]
    local = h[:2, :2] - np.outer(h[:2, 2], h[2, :2])
    return float(np.sqrt(abs(np.linalg.det(local)) / aspect))


def _pose(
    shots: TravelShots, camera: PinholeCamera, distance_mm: float
) -> tuple[FloatArray, FloatArray]:
    """Pose where travel is 0: turned as at the first stop, at the distance found."""
    ideal = to_normalised(camera.without_distortion(), shots.pixels[0])
    rotation, first = pose_from_homography(
        homography(shots.points_target_mm[:, :2], ideal)
    )
    return rotation, first * (distance_mm / (distance_mm - shots.travel_mm[0]))
