"""What a bench knows of the task's part: where to look from, and what a picture shows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from mvp.geometry import BoolArray, FloatArray, IntArray, Pose
    from mvp.wizard.protocol import Shot


@dataclass(frozen=True, eq=False)
class SightView:
    """A place to look at the part from.

    Attributes:
        name: for people.
        part_from_camera: where the camera should be, seen from the part.
        d_mm: image distance of the lens setting.
        lens_steps: zoom, focus, iris.
        position_mm: how far the camera may be off there with every requirement of the
            plan still kept; None: the view is not one of the plan's.
        angle_deg: how far it may be turned, likewise.
    """

    name: str
    part_from_camera: Pose
    d_mm: float
    lens_steps: Mapping[str, int]
    position_mm: float | None = None
    angle_deg: float | None = None


@dataclass(frozen=True, eq=False)
class SeenPart:
    """What one picture shows of the part, part frame (mm) and raw pixels.

    Attributes:
        ends_part_mm: (e, 2, 3) ends of straight edges that were measured.
        edge_pixels: (k, 2) places found on them.
        edge: (k,) the edge of each place.
        edge_sigma_px: (k,) one standard deviation across the edge.
        edge_names: (e,).
        agrees: (e,) lies where the others put it: always so when the believed pose is
            right, and for too few edges while it is not.
        centres_part_mm: (c, 3) centres of the rims of holes that were measured.
        normals_part: (c, 3).
        radii_mm: (c,).
        rim_pixels: (c, 2) centres of their ellipses.
        rim_sigma_px: (c,) one standard deviation of each coordinate.
        rim_names: (c,).
        found: share of the expected length of edges that was found.
        reason: why nothing was measured; empty when something was.
    """

    ends_part_mm: FloatArray
    edge_pixels: FloatArray
    edge: IntArray
    edge_sigma_px: FloatArray
    edge_names: tuple[str, ...]
    agrees: BoolArray
    centres_part_mm: FloatArray
    normals_part: FloatArray
    radii_mm: FloatArray
    rim_pixels: FloatArray
    rim_sigma_px: FloatArray
    rim_names: tuple[str, ...]
    found: float
    reason: str = ""


class PartSights(Protocol):
    """The part of a task, for whoever has to find out where it lies."""

    def views(self) -> Sequence[SightView]:
        """Where to look from: the plan's own views, then others from other sides.

        Raises:
            InfeasibleError: no view of the part is admissible and in reach.
        """
        ...

    def exposure_factor(self, shot: Shot, camera_from_part: Pose) -> float:
        """By how much to change the exposure to suit the part's features.

        Something brighter beside the part may have been exposed for.

        Args:
            shot: the picture.
            camera_from_part: where the part is believed to be.
        """
        ...

    def measure(self, shot: Shot, camera_from_part: Pose) -> SeenPart:
        """Measure the part's edges and holes in a picture.

        Args:
            shot: the picture.
            camera_from_part: where the part is believed to be, to some millimetres and
                degrees.
        """
        ...
