"""One picture of a part as a least squares over its pose, intrinsics held fixed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from calibration.projection import (
    POSE_NAMES,
    PinholeCamera,
    moved_pose,
    project,
    project_with_derivatives,
    skew,
    to_normalised,
)

if TYPE_CHECKING:
    from calibration.part_pose.sightings import PartSight, SeenCircles, SeenEdges
    from mvp.geometry import FloatArray

State: TypeAlias = "tuple[FloatArray, FloatArray]"


@dataclass(frozen=True, eq=False)
class PoseProblem:
    """Residuals of points, rims and edges, whitened; see ``calibration.estimate``.

    A state is rotation (3, 3) and translation (3,) mm of ``camera_from_part``.

    Attributes:
        camera: fixed intrinsics.
        sight: what was seen.
        edge_rays: (k, 3), places on edges as ideal normalised (x, y, 1).
    """

    camera: PinholeCamera
    sight: PartSight
    edge_rays: FloatArray

    names = POSE_NAMES
    prior_rows = 0

    @classmethod
    def of(cls, camera: PinholeCamera, sight: PartSight) -> PoseProblem:
        """Removes the distortion from the places on edges once."""
        ideal = to_normalised(camera, sight.edges.pixels)
        return cls(camera, sight, np.pad(ideal, ((0, 0), (0, 1)), constant_values=1.0))

    @property
    def scales(self) -> FloatArray:
        """1 mm, and the angle that moves the outermost place by 1 mm."""
        places = self.sight.places_part_mm
        radius = np.linalg.norm(places - places.mean(axis=0), axis=1).max()
        return np.array([1.0, 1.0, 1.0] + [1 / max(float(radius), 1e-6)] * 3)

    def residuals(self, state: State) -> FloatArray:
        """(m,), whitened; nan behind the camera."""
        points, circles, edges = (
            self.sight.points,
            self.sight.circles,
            self.sight.edges,
        )
        off = project(self.camera, *state, points.points_part_mm) - points.pixels
        found = [(off / points.sigma_px).ravel()]
        if len(circles.pixels):
            rims, _ = rim_centres(self.camera, *state, circles)
            off_rims = (rims - circles.pixels) / circles.sigmas_px[:, None]
            found.append(off_rims.ravel())
        if len(edges.pixels):
            across, _ = off_edges(self.camera, *state, edges, self.edge_rays)
            found.append(across / edges.sigmas_px)
        return np.concatenate(found)

    def jacobian(self, state: State) -> FloatArray:
        """(m, 6)."""
        points, circles, edges = (
            self.sight.points,
            self.sight.circles,
            self.sight.edges,
        )
        found = []
        if len(points.pixels):
            seen = project_with_derivatives(self.camera, *state, points.points_part_mm)
            found.append(seen.d_pose.reshape(-1, 6) / points.sigma_px)
        if len(circles.pixels):
            _, d_rims = rim_centres(self.camera, *state, circles)
            d_rims = d_rims / circles.sigmas_px[:, None, None]
            found.append(d_rims.reshape(-1, 6))
        if len(edges.pixels):
            _, d_off = off_edges(self.camera, *state, edges, self.edge_rays)
            found.append(d_off / edges.sigmas_px[:, None])
        return np.concatenate(found)

    def moved(self, state: State, step: FloatArray) -> State:
        """A small step, see ``calibration.projection``."""
        return moved_pose(*state, step)


def rim_centres(
    camera: PinholeCamera,
    rotation: FloatArray,
    translation_mm: FloatArray,
    circles: SeenCircles,
) -> tuple[FloatArray, FloatArray]:
    """Centres (n, 2) of the ellipses that circles make, and derivative (n, 2, 6).

    With centre c, normal n and radius r in camera axes, the dual conic of the image is
    r^2 (1 - n n') - c c'; its centre is the image of c c_z - r^2 (e_z - n n_z).
    """
    turned = circles.centres_part_mm @ rotation.T
    centre = turned + translation_mm
    normal = circles.normals_part @ rotation.T
    square = (circles.radii_mm**2)[:, None]
    depth, slope = centre[:, 2:], normal[:, 2:]
    conic = centre * depth - square * (np.array([0.0, 0.0, 1.0]) - normal * slope)
    in_front = depth[:, 0] > circles.radii_mm
    conic = np.where(in_front[:, None], conic, -1.0)
    d_centre = np.concatenate([np.broadcast_to(np.eye(3), (len(turned), 3, 3))], axis=0)
    d_centre = np.concatenate([d_centre, -skew(turned)], axis=2)
    d_normal = np.concatenate([np.zeros((len(turned), 3, 3)), -skew(normal)], axis=2)
    d_conic = depth[..., None] * d_centre + centre[..., None] * d_centre[:, 2:]
    d_conic = d_conic + square[..., None] * (
        slope[..., None] * d_normal + normal[..., None] * d_normal[:, 2:]
    )
    seen = project_with_derivatives(camera, np.eye(3), np.zeros(3), conic)
    return seen.pixels, seen.d_point @ d_conic


def off_edges(
    camera: PinholeCamera,
    rotation: FloatArray,
    translation_mm: FloatArray,
    edges: SeenEdges,
    rays: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Distances (k,) in px of places from the images of their edges; derivative (k, 6).

    Measured in the picture without distortion.
    """
    turned = edges.ends_part_mm @ rotation.T
    ends = turned + translation_mm
    first, second = ends[:, 0], ends[:, 1]
    line = np.cross(first, second)
    d_turn = skew(second) @ skew(turned[:, 0]) - skew(first) @ skew(turned[:, 1])
    d_line = np.concatenate([-skew(second - first), d_turn], axis=2)
    inverse = np.array([1 / camera.fx_px**2, 1 / camera.fy_px**2, 0.0])
    length = np.sqrt((line**2) @ inverse)
    d_length = np.einsum("ei,eij->ej", line * inverse, d_line) / length[:, None]
    behind = (ends[..., 2] <= 0).any(axis=1)
    length = np.where(behind, np.nan, length)
    place = edges.edge
    off = (rays * line[place]).sum(axis=1) / length[place]
    d_off = np.einsum("ki,kij->kj", rays, d_line[place])
    d_off = (d_off - off[:, None] * d_length[place]) / length[place][:, None]
    return off, d_off
