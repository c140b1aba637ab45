"""g1: every feature piece of length l is imaged at least w long, eqs. (1), (7), (18).

The worst piece of an edge lies at its deeper end, so both end pieces are rows.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from mvp.constraints.base import Kind, Report, Rows, worst_of
from mvp.constraints.derivatives import (
    IN_FRONT_MM,
    add_pose_gradient,
    add_principal_distance_gradient,
    empty_gradient,
    replace_behind,
)
from mvp.geometry import FloatArray, as_points

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from mvp.optics import Sensor, Views

PixelRule: TypeAlias = Literal["worst", "along"]


@dataclass(frozen=True, eq=False)
class Resolution:
    """Rows in px: how many more pixels than required the worst pieces cover.

    Attributes:
        starts_mm: (R, 3) one end of each piece, part frame.
        ends_mm: (R, 3) the other end.
        required_px: (R,) pixels that the piece must cover.
        pitch_x_mm: distance of two columns.
        pitch_y_mm: distance of two rows.
        rule: ``"worst"`` counts in diagonal pixel spacings W of eq. (18), whatever the
            direction in the image (no kink but where a piece is seen end on).
            ``"along"`` counts columns or rows, whichever are more, along the image's
            own direction: less strict except on the pixel diagonal, where both agree
            and where this rule has a kink.
        labels: feature and end of each row.
    """

    starts_mm: FloatArray
    ends_mm: FloatArray
    required_px: FloatArray
    pitch_x_mm: float
    pitch_y_mm: float
    rule: PixelRule = "worst"
    labels: tuple[str, ...] = ()
    kind: Kind = field(default="resolution", init=False)
    unit: str = field(default="px", init=False)

    @classmethod
    def of_segments(
        cls,
        segments_mm: ArrayLike,
        *,
        detail_mm: ArrayLike,
        pixels: ArrayLike,
        sensor: Sensor,
        rule: PixelRule = "worst",
        names: Sequence[str] | None = None,
    ) -> Resolution:
        """Both end pieces of every segment.

        Args:
            segments_mm: (s, 2, 3) part frame; s = 0 (points only) gives no rows.
            detail_mm: l, smallest detail, one value or one per segment. A segment that
                is shorter is taken whole, with proportionally fewer pixels.
            pixels: pixels that l must cover, one value or one per segment.
            sensor: gives the pixel pitches.
            rule: see the class.
            names: one per segment.

        Raises:
            ValueError: a segment has no length, or a demand is not positive.
        """
        given_mm = np.asarray(segments_mm, np.float64)
        shaped = given_mm.reshape(-1, 2, 3) if given_mm.size == 0 else given_mm
        segments = as_points(shaped, name="segments_mm").reshape(-1, 2, 3)
        pieces, share, owner, end = _end_pieces(segments, detail_mm)
        needed = np.broadcast_to(np.asarray(pixels, np.float64), len(segments))
        if not (needed > 0).all():
            raise ValueError("required pixels must be positive")
        given = names or [f"segment {i + 1}" for i in range(len(segments))]
        labels = tuple(f"{given[i]}, {e}" for i, e in zip(owner, end, strict=True))
        return cls(
            pieces[:, 0],
            pieces[:, 1],
            needed[np.array(owner, dtype=np.int64)] * share,
            sensor.pitch_x_mm,
            sensor.pitch_y_mm,
            rule,
            labels,
        )

    @property
    def diagonal_pitch_mm(self) -> float:
        """W of eq. (18), mm."""
        return float(np.hypot(self.pitch_x_mm, self.pitch_y_mm))

    @property
    def finest_pitch_mm(self) -> float:
        """The smallest length on the sensor that ever counts as one pixel, mm."""
        if self.rule == "worst":
            return self.diagonal_pitch_mm
        return min(self.pitch_x_mm, self.pitch_y_mm)

    def rows(self, views: Views, *, gradient: bool = True) -> Rows:
        """Pixels covered minus pixels required, (N, R) px."""
        qa = views.camera_points(self.starts_mm)
        qb = views.camera_points(self.ends_mm)
        depth = np.minimum(qa[..., 2], qb[..., 2])
        behind = (depth <= IN_FRONT_MM) | (views.f_cal_mm[:, None] <= 0)
        za = np.where(behind, 1.0, qa[..., 2])
        zb = np.where(behind, 1.0, qb[..., 2])
        image_a, image_b = qa[..., :2] / za[..., None], qb[..., :2] / zb[..., None]
        length, weight = self._pixel_length(image_b - image_a)
        f_cal = views.f_cal_mm[:, None]
        value = f_cal * length - self.required_px
        slopes = None
        if gradient:
            slopes = empty_gradient(value.shape)
            pull = f_cal[..., None] * weight
            add_pose_gradient(slopes, views, qa, -_through_image(pull, image_a, za))
            add_pose_gradient(slopes, views, qb, _through_image(pull, image_b, zb))
            add_principal_distance_gradient(slopes, views, length)
        replace_behind(value, slopes, views, depth, behind)
        return Rows(value, slopes)

    def report(self, views: Views) -> Report:
        """The worst row of every view, px."""
        return worst_of("px", self.rows(views, gradient=False).value, self.labels)

    def _pixel_length(self, span: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Length (N, R) in px per mm of f_cal of image vectors, and its slope."""
        if self.rule == "worst":
            norm = np.sqrt(span[..., 0] ** 2 + span[..., 1] ** 2)
            safe = np.where(norm > 0, norm, 1.0)
            scale = 1 / self.diagonal_pitch_mm
            return norm * scale, span * (scale / safe)[..., None]
        counts = span / np.array([self.pitch_x_mm, self.pitch_y_mm])
        columns = np.abs(counts[..., 0]) >= np.abs(counts[..., 1])
        chosen = np.stack([columns, ~columns], axis=-1)
        per_mm = np.sign(counts) / np.array([self.pitch_x_mm, self.pitch_y_mm])
        return np.abs(counts).max(axis=-1), np.where(chosen, per_mm, 0.0)


def _through_image(pull: FloatArray, image: FloatArray, z: FloatArray) -> FloatArray:
    """Slope (N, R, 3) by q of pull . (X, Y)/z."""
    depth = -(pull * image).sum(axis=-1, keepdims=True)
    return np.concatenate([pull, depth], axis=-1) / z[..., None]


def _end_pieces(
    segments: FloatArray, detail_mm: ArrayLike
) -> tuple[FloatArray, FloatArray, list[int], list[str]]:
    """Pieces (R, 2, 3), their length as a share of l, owner segment, name of the end."""
    detail = np.broadcast_to(np.asarray(detail_mm, np.float64), len(segments))
    length = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1)
    if not (length > 0).all() or not (detail > 0).all():
        raise ValueError("segments and details must have a positive length")
    pieces: list[FloatArray] = []
    share: list[float] = []
    owner: list[int] = []
    end: list[str] = []
    for i, (a, b) in enumerate(segments):
        part = min(1.0, float(detail[i] / length[i]))
        ends = [(a, a + part * (b - a), "start"), (b, b + part * (a - b), "end")]
        for first, second, name in ends if part < 1 else [(a, b, "whole")]:
            pieces.append(np.stack([first, second]))
            share.append(min(1.0, float(length[i] / detail[i])))
            owner.append(i)
            end.append(name)
    return np.array(pieces).reshape(-1, 2, 3), np.array(share), owner, end
