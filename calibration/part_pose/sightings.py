"""What one picture shows of a part whose drawing is known: corners, rims, edges.

Measured places are px in the picture as taken (with distortion); the drawing is mm in the
part frame. Which place belongs to which feature is known.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from mvp.geometry import unit

if TYPE_CHECKING:
    from mvp.geometry import FloatArray, IntArray


def _none(*shape: int) -> FloatArray:
    return np.zeros((0, *shape))


@dataclass(frozen=True, eq=False)
class SeenPoints:
    """Corners and other points.

    Attributes:
        points_part_mm: (n, 3).
        pixels: (n, 2), where each was found.
        sigma_px: one standard deviation of each coordinate.
        names: (n,) for reports, or empty.
    """

    points_part_mm: FloatArray = field(default_factory=lambda: _none(3))
    pixels: FloatArray = field(default_factory=lambda: _none(2))
    sigma_px: float = 0.1
    names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        _check(self.points_part_mm, self.pixels, self.sigma_px)


@dataclass(frozen=True, eq=False)
class SeenCircles:
    """Rims of holes, found as ellipses.

    The centre of the ellipse is not the image of the centre of the hole; the model
    predicts the former.

    Attributes:
        centres_part_mm: (n, 3).
        normals_part: (n, 3), of any length.
        radii_mm: (n,).
        pixels: (n, 2), centres of the ellipses.
        sigma_px: one standard deviation of each coordinate.
        names: (n,) for reports, or empty.
        each_sigma_px: (n,) instead, where they are not all known alike.
    """

    centres_part_mm: FloatArray = field(default_factory=lambda: _none(3))
    normals_part: FloatArray = field(default_factory=lambda: _none(3))
    radii_mm: FloatArray = field(default_factory=_none)
    pixels: FloatArray = field(default_factory=lambda: _none(2))
    sigma_px: float = 0.1
    names: tuple[str, ...] = ()
    each_sigma_px: FloatArray | None = None

    def __post_init__(self) -> None:
        _check(self.centres_part_mm, self.pixels, self.sigma_px)
        _check_each(self.pixels, self.each_sigma_px)
        if self.normals_part.shape != self.centres_part_mm.shape:
            raise ValueError("one normal for each circle")
        if self.radii_mm.shape != (len(self.pixels),):
            raise ValueError("one radius for each circle")
        if len(self.normals_part):
            object.__setattr__(self, "normals_part", unit(self.normals_part))

    @property
    def sigmas_px(self) -> FloatArray:
        """(n,)."""
        return _each(self.pixels, self.sigma_px, self.each_sigma_px)


@dataclass(frozen=True, eq=False)
class SeenEdges:
    """Straight edges, each found at some places anywhere along it.

    Attributes:
        ends_part_mm: (e, 2, 3).
        pixels: (k, 2), places on the edges.
        edge: (k,), the edge of each place, 0 .. e - 1.
        sigma_px: one standard deviation across the edge.
        names: (e,) for reports, or empty.
        each_sigma_px: (k,) instead, where the places are not all known alike.
    """

    ends_part_mm: FloatArray = field(default_factory=lambda: _none(2, 3))
    pixels: FloatArray = field(default_factory=lambda: _none(2))
    edge: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    sigma_px: float = 0.1
    names: tuple[str, ...] = ()
    each_sigma_px: FloatArray | None = None

    def __post_init__(self) -> None:
        if self.ends_part_mm.shape[1:] != (2, 3) or self.pixels.shape[1:] != (2,):
            raise ValueError("edges are (e, 2, 3) and their places (k, 2)")
        if self.edge.shape != (len(self.pixels),):
            raise ValueError("each place on an edge names its edge")
        counts = np.bincount(self.edge, minlength=len(self.ends_part_mm))
        if len(counts) != len(self.ends_part_mm) or (counts < 2).any():
            raise ValueError("each edge needs two places at least")
        _check_noise(self.pixels, self.sigma_px)
        _check_each(self.pixels, self.each_sigma_px)

    @property
    def sigmas_px(self) -> FloatArray:
        """(k,)."""
        return _each(self.pixels, self.sigma_px, self.each_sigma_px)


@dataclass(frozen=True, eq=False)
class PartSight:
    """All that one picture shows of a part."""

    points: SeenPoints = field(default_factory=SeenPoints)
    circles: SeenCircles = field(default_factory=SeenCircles)
    edges: SeenEdges = field(default_factory=SeenEdges)

    @property
    def equations(self) -> int:
        """How many numbers the picture gives that depend on the pose.

        An edge counts twice however many places were found on it: more of them only
        make it more exact.
        """
        return 2 * (
            len(self.points.pixels)
            + len(self.circles.pixels)
            + len(self.edges.ends_part_mm)
        )

    @property
    def places_part_mm(self) -> FloatArray:
        """(p, 3): points, centres and ends of edges."""
        return np.concatenate(
            [
                self.points.points_part_mm,
                self.circles.centres_part_mm,
                self.edges.ends_part_mm.reshape(-1, 3),
            ]
        )


def _check(points: FloatArray, pixels: FloatArray, sigma_px: float) -> None:
    count = len(pixels)
    if points.shape != (count, 3) or pixels.shape != (count, 2):
        raise ValueError("as many places (n, 2) in the picture as points (n, 3)")
    if not np.isfinite(points).all():
        raise ValueError("points must be finite")
    _check_noise(pixels, sigma_px)


def _check_each(pixels: FloatArray, each: FloatArray | None) -> None:
    if each is not None and not (each.shape == (len(pixels),) and (each > 0).all()):
        raise ValueError("one positive sigma for each place")


def _each(pixels: FloatArray, sigma_px: float, each: FloatArray | None) -> FloatArray:
    return np.full(len(pixels), sigma_px) if each is None else each


def _check_noise(pixels: FloatArray, sigma_px: float) -> None:
    if not np.isfinite(pixels).all() or not sigma_px > 0:
        raise ValueError("places must be finite and their sigma positive")
