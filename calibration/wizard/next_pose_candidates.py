"""Views of a target that a wizard may propose: where from, and what they would show.

A candidate is a ``camera_from_target``: the target's middle at a place in the picture and
a distance, tilted about both axes and rolled. They are spread evenly (Halton's sequence)
over all of these at once, so that a few hundred leave no gap.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import qmc

from calibration.poses import Poses
from calibration.projection import project, to_normalised

if TYPE_CHECKING:
    from calibration.projection import PinholeCamera
    from mvp.geometry import BoolArray, FloatArray

_MARGIN_PX = 12.0


@dataclass(frozen=True)
class ViewRange:
    """From where the target may be looked at.

    Attributes:
        near_mm: least distance of the target's middle along the optical axis.
        far_mm: greatest.
        tilt_rad: greatest angle between the target's normal and the optical axis.
        roll_rad: greatest turn about the optical axis, both ways, from ``upright_rad``.
        upright_rad: roll about which the rolls are spread.
        places: the middle of the target lies within this share of half the picture.
        share: of the target's points that must be in the picture.
        fill: least share of the picture's short side that the target must span.
    """

    near_mm: float
    far_mm: float
    tilt_rad: float = float(np.radians(38.0))
    roll_rad: float = float(np.pi)
    upright_rad: float = 0.0
    places: float = 0.5
    share: float = 0.6
    fill: float = 0.25

    def __post_init__(self) -> None:
        if not 0 < self.near_mm <= self.far_mm:
            raise ValueError("distances rise and are positive")


@dataclass(frozen=True)
class FocusBand:
    """How blurred a point at some depth is at one lens setting.

    Attributes:
        f_cal_mm: principal distance.
        magnification: m = (d - f) / f.
        a_mm: diameter of the entrance pupil.
        pitch_mm: of a pixel.
        limit_px: largest blur circle that corners are still found in.
    """

    f_cal_mm: float
    magnification: float
    a_mm: float
    pitch_mm: float
    limit_px: float

    def blur_px(self, depth_mm: FloatArray) -> FloatArray:
        """Diameter of the blur circle at a depth from the entrance pupil."""
        off = self.magnification - self.f_cal_mm / depth_mm
        return np.asarray(np.abs(self.a_mm * off) / self.pitch_mm)

    def range_mm(self) -> tuple[float, float]:
        """Nearest and farthest depth (may be inf) within the limit."""
        slack = self.limit_px * self.pitch_mm / self.a_mm
        near = self.f_cal_mm / (self.magnification + slack)
        gap = self.magnification - slack
        return near, self.f_cal_mm / gap if gap > 0 else float("inf")


@dataclass(frozen=True, eq=False)
class TargetViews:
    """Views of one target: poses, pixels, and which points can be used.

    Attributes:
        camera_from_target: n poses.
        points_target_mm: (m, 3).
        pixels: (n, m, 2), nan behind the camera.
        seen: (n, m), inside the picture and sharp enough.
    """

    camera_from_target: Poses
    points_target_mm: FloatArray
    pixels: FloatArray
    seen: BoolArray

    def __len__(self) -> int:
        return len(self.seen)

    def some(self, chosen: BoolArray) -> TargetViews:
        """The chosen ones."""
        return TargetViews(
            self.camera_from_target[chosen],
            self.points_target_mm,
            self.pixels[chosen],
            self.seen[chosen],
        )


def views_of(
    camera: PinholeCamera,
    size_px: tuple[int, int],
    points_target_mm: FloatArray,
    camera_from_target: Poses,
    focus: FocusBand | None = None,
) -> TargetViews:
    """What given views show."""
    points = points_target_mm @ np.swapaxes(camera_from_target.rotation, 1, 2)
    points = points + camera_from_target.translation_mm[:, None]
    pixels = project(camera, np.eye(3), np.zeros(3), points)
    ends = np.array(size_px) - 1 - _MARGIN_PX
    with np.errstate(invalid="ignore"):
        seen = ((pixels >= _MARGIN_PX) & (pixels <= ends)).all(axis=-1)
    seen &= _unfolded(camera, size_px, points)
    if focus is not None:
        depth = np.maximum(points[..., 2], 1e-6)
        seen &= focus.blur_px(depth) <= focus.limit_px
    return TargetViews(camera_from_target, points_target_mm, pixels, seen)


def candidate_views(
    camera: PinholeCamera,
    size_px: tuple[int, int],
    points_target_mm: FloatArray,
    within: ViewRange,
    rng: np.random.Generator,
    *,
    focus: FocusBand | None = None,
    count: int = 384,
) -> TargetViews:
    """Evenly spread views that show enough of the target, sharp enough.

    Args:
        camera: intrinsics as known so far.
        size_px: columns and rows of the picture.
        points_target_mm: (m, 3), flat.
        within: distances, tilts, rolls, places.
        rng: scrambles the sequence.
        focus: of the lens; None: everything is sharp.
        count: how many are drawn, before those that show too little are left out.
    """
    poses = _spread(camera, size_px, points_target_mm, within, rng, count)
    views = views_of(camera, size_px, points_target_mm, poses, focus)
    enough = views.seen.mean(axis=1) >= within.share
    return views.some(enough & (_fill(views, size_px) >= within.fill))


def _spread(
    camera: PinholeCamera,
    size_px: tuple[int, int],
    points_target_mm: FloatArray,
    within: ViewRange,
    rng: np.random.Generator,
    count: int,
) -> Poses:
    draw = qmc.Halton(6, scramble=True, seed=rng).random(count)
    # The rim of the disc of tilts tells most: radius drawn evenly, not area.
    tilt = within.tilt_rad * draw[:, 0]
    side = 2 * np.pi * draw[:, 1]
    roll = within.upright_rad + within.roll_rad * (2 * draw[:, 2] - 1)
    tilted = np.stack([tilt * np.cos(side), tilt * np.sin(side), 0 * side], axis=1)
    rolled = np.stack([0 * roll, 0 * roll, roll], axis=1)
    turn = Rotation.from_rotvec(rolled) * Rotation.from_rotvec(tilted)
    rotation = turn.as_matrix()
    near, far = 1 / within.near_mm, 1 / within.far_mm
    distance = 1 / (near + (far - near) * draw[:, 3])
    half = (np.array(size_px) - 1) / 2
    place = half + within.places * half * (2 * draw[:, 4:6] - 1)
    ray = np.column_stack(
        [to_normalised(camera.without_distortion(), place), np.ones(count)]
    )
    middle = (points_target_mm.min(axis=0) + points_target_mm.max(axis=0)) / 2
    return Poses(rotation, distance[:, None] * ray - rotation @ middle)


def _fill(views: TargetViews, size_px: tuple[int, int]) -> FloatArray:
    """(n,): share of the picture's short side that the usable points span."""
    short = int(size_px[1] < size_px[0])
    along = views.pixels[..., short]
    low = np.where(views.seen, along, np.inf).min(axis=1)
    high = np.where(views.seen, along, -np.inf).max(axis=1)
    return np.asarray(np.maximum(high - low, 0.0) / min(size_px))


def _unfolded(
    camera: PinholeCamera, size_px: tuple[int, int], points: FloatArray
) -> BoolArray:
    """Far outside the field the distortion folds back into the picture."""
    reach = np.hypot(size_px[0] / camera.fx_px, size_px[1] / camera.fy_px)
    with np.errstate(invalid="ignore", divide="ignore"):
        slope = np.linalg.norm(points[..., :2], axis=-1) / points[..., 2]
    return np.asarray((points[..., 2] > 0) & (slope < reach))
