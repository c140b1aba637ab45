"""g4: the pupil stays inside the region from which the features are seen, (12)-(13).

Inside, the distance to every facet within reach is a row, because the nearest facet
changes along a step; distance to a convex facet is convex, so the linearised rows never
promise too much. Outside, the nearest facet with the sign turned is all there is.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

import numpy as np

from mvp.constraints.base import SHIFT, Kind, Report, Rows, worst_of
from mvp.constraints.derivatives import empty_gradient

if TYPE_CHECKING:
    from mvp.geometry import FloatArray
    from mvp.optics import Views

_FAR_MM = 1e6


class NearFacets(Protocol):
    """The nearest facets of a region, nearest first.

    ``distance`` (N, k) mm, inf where there are fewer facets; ``direction`` (N, k, 3)
    unit vectors from the closest point of the facet to the asking point.
    """

    @property
    def distance(self) -> FloatArray:
        """(N, k) mm, not negative."""
        ...

    @property
    def direction(self) -> FloatArray:
        """(N, k, 3)."""
        ...


class SightRegion(Protocol):
    """What this constraint asks of a visibility region."""

    def signed_distance(self, points: FloatArray, /) -> FloatArray:
        """(N,) mm, positive inside."""
        ...

    def signed_distance_gradient(
        self, points: FloatArray, /
    ) -> tuple[FloatArray, FloatArray]:
        """The same with its gradient (N, 3)."""
        ...

    def nearest_facets(self, points: FloatArray, k: int, /) -> NearFacets:
        """The nearest k facets of every point."""
        ...


@dataclass(frozen=True, eq=False)
class Visibility:
    """Rows in mm: distance from the nearest ``facets`` facets of the region."""

    region: SightRegion
    facets: int = 16
    kind: Kind = field(default="visibility", init=False)
    unit: str = field(default="mm", init=False)
    labels: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        if self.facets < 1:
            raise ValueError("visibility needs at least one facet")
        names = tuple(f"facet {i + 1} by distance" for i in range(self.facets))
        object.__setattr__(self, "labels", names)

    def margin(self, views: Views) -> FloatArray:
        """Signed distance to the region's boundary, (N,) mm: the least row, cheaper."""
        signed = np.asarray(self.region.signed_distance(views.position_mm), np.float64)
        return np.clip(signed, -_FAR_MM, _FAR_MM)

    def rows(self, views: Views, *, gradient: bool = True) -> Rows:
        """Distance to each of the nearest facets, (N, facets) mm.

        Outside the region every row is the nearest facet with the sign turned. Kinks:
        on the boundary, and where the order of the facets changes.
        """
        points = views.position_mm
        signed, slope = self.region.signed_distance_gradient(points)
        value = np.repeat(np.clip(signed, -_FAR_MM, _FAR_MM)[:, None], self.facets, 1)
        slopes = empty_gradient(value.shape)
        slopes[..., SHIFT] = slope[:, None]
        inside = np.flatnonzero(signed >= 0)
        near = self.region.nearest_facets(points[inside], self.facets)
        value[inside], slopes[inside, :, SHIFT] = self._padded(near, len(inside))
        return Rows(value, slopes if gradient else None)

    def report(self, views: Views) -> Report:
        """Signed distance to the region's boundary, mm."""
        return worst_of("mm", self.margin(views)[:, None], self.labels[:1])

    def _padded(self, near: NearFacets, count: int) -> tuple[FloatArray, FloatArray]:
        """Exactly ``facets`` columns; missing facets are far away."""
        missing = self.facets - near.distance.shape[1]
        distance = np.minimum(np.nan_to_num(near.distance, nan=_FAR_MM), _FAR_MM)
        direction = np.nan_to_num(near.direction)
        if missing <= 0:
            return distance[:, : self.facets], direction[:, : self.facets]
        far = np.full((count, missing), _FAR_MM)
        nowhere = np.zeros((count, missing, 3))
        return np.hstack([distance, far]), np.concatenate([direction, nowhere], axis=1)
