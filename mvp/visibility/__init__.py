"""Where a feature is seen whole: regions, distances to their boundary, oracles."""

from mvp.visibility.blocking import (
    NOTHING,
    OWN_FACES,
    blocking_faces,
    limiting_faces,
)
from mvp.visibility.build import visibility_region
from mvp.visibility.enclosure import closed_in
from mvp.visibility.facets import FacetDistances
from mvp.visibility.measures import paper_distance, ray_distance
from mvp.visibility.occluders import Occluders, prepare
from mvp.visibility.oracle import exactly_visible
from mvp.visibility.rays import line_of_sight
from mvp.visibility.region import Region, RegionStatistics, intersection

__all__ = [
    "NOTHING",
    "OWN_FACES",
    "FacetDistances",
    "Occluders",
    "Region",
    "RegionStatistics",
    "blocking_faces",
    "closed_in",
    "exactly_visible",
    "intersection",
    "limiting_faces",
    "line_of_sight",
    "paper_distance",
    "prepare",
    "ray_distance",
    "visibility_region",
]
