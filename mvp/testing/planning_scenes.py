"""Scenes on which planners are compared: the paper's object, four ways.

``paper`` asks for one pixel per 0.1 in; ``tight`` for four; ``rect`` is tight with a
rectangular sensor and roll; ``fa`` is tight with focal length and aperture free.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, TypeAlias

import numpy as np

from mvp.constraints import (
    FieldOfViewCircle,
    FieldOfViewRectangle,
    FocusFar,
    FocusNear,
    Resolution,
    Visibility,
    enclosing_sphere,
)
from mvp.geometry import Box, FloatArray, TriangleMesh
from mvp.optics import Sensor, Views
from mvp.planning import LensBounds, PlanningProblem
from mvp.scene import (
    EdgeFeature,
    PaperObject,
    edge_feature,
    paper_object,
    without_slit,
)
from mvp.visibility import Region, prepare, visibility_region

SceneName: TypeAlias = Literal["paper", "tight", "rect", "fa"]

SENSOR = Sensor(512, 480, 0.023 * 0.70642, 0.0135)
REQUIRED_MM = 0.02112
DETAIL_MM = 2.54
CIRCLE_OF_CONFUSION_MM = 0.0135
IMAGE_DIAMETER_MM = 6.4665
_RECTANGLE_MM = (8.832, 6.467)
HALF_MM = 650.0
_FACETS = 32


def paper_view(position_mm: FloatArray, direction: FloatArray, d_mm: float) -> Views:
    """A view of the paper's tables (f = 12.5 mm, a = f/16), direction normalised."""
    n = np.asarray(direction, dtype=np.float64)
    n = n / np.linalg.norm(n)
    helper = np.eye(3)[0] if abs(n[0]) < 0.9 else np.eye(3)[1]
    x = np.cross(helper, n)
    x = x / np.linalg.norm(x)
    rotation = np.stack([x, np.cross(n, x), n], axis=1)
    position = np.asarray(position_mm, dtype=np.float64)
    one = np.ones(1)
    return Views(
        rotation[None], position[None], d_mm * one, 12.5 * one, 0.78125 * one, 0 * one
    )


def table_views() -> dict[str, Views]:
    """Initial and computed viewpoints of Tables I-III by name."""
    rows = {
        "V_i": ((165.1, -279.4, 368.3), (-0.336, 0.569, -0.750), 15.0),
        "V_f": ((107.58, -231.43, 258.68), (-0.389, 0.694, -0.608), 13.07),
        "V_i1": ((228.6, 0.0, 368.3), (0.0, 0.0, -1.0), 13.75),
        "V_f1": ((197.10, 100.58, 330.45), (-0.513, -0.255, -0.820), 12.84),
        "V_i2": ((2.54, 2.54, 2.54), (0.0, 0.0, -1.0), 13.75),
        "V_f2": ((112.78, 110.49, 159.77), (-0.444, -0.583, -0.680), 13.25),
    }
    return {
        name: paper_view(np.array(position), np.array(direction), d)
        for name, (position, direction, d) in rows.items()
    }


@dataclass(frozen=True, eq=False)
class PlanningScene:
    """A part, edges that must be seen on it, and where the camera may be.

    The region is built once; problems are made from it.

    Attributes:
        mesh: the part, which is all that can hide an edge.
        edges: the features.
        workspace: where the pupil may be.
        walls: whether the workspace's walls count as visibility facets.
    """

    mesh: TriangleMesh
    edges: tuple[EdgeFeature, ...]
    workspace: Box
    walls: bool = True

    @cached_property
    def region(self) -> Region:
        """From where all edges are seen whole."""
        pieces = [piece for edge in self.edges for piece in edge.sight_pieces()]
        occluders = prepare(self.mesh)
        return visibility_region(occluders, pieces, self.workspace, walls=self.walls)

    @property
    def key_points_mm(self) -> FloatArray:
        """The different ends of the edges."""
        points = np.concatenate([edge.key_points_mm for edge in self.edges])
        return np.unique(points, axis=0)

    @property
    def segments_mm(self) -> FloatArray:
        """All edges (k, 2, 3)."""
        return np.concatenate([edge.segments_mm for edge in self.edges])

    def problem(
        self,
        name: SceneName = "paper",
        *,
        stricter: float | None = None,
        lens: LensBounds | None = None,
        circle_of_confusion_mm: float = CIRCLE_OF_CONFUSION_MM,
        starts: int = 24,
        candidates: int = 40_000,
        user_starts: Views | None = None,
    ) -> PlanningProblem:
        """The planning problem of one scene.

        Args:
            name: which scene.
            stricter: factor on the required image length; by default the scene's own.
            lens: bounds; by default the scene's own.
            circle_of_confusion_mm: largest blur.
            starts: how many starts to search from.
            candidates: how many candidates to draw for them.
            user_starts: starts that a person gave.
        """
        points = self.key_points_mm
        centre, radius = enclosing_sphere(points)
        return PlanningProblem(
            constraints=(
                self._resolution(stricter or (1.0 if name == "paper" else 4.0)),
                FocusNear(points, circle_of_confusion_mm),
                FocusFar(points, circle_of_confusion_mm),
                self._field_of_view(name),
                Visibility(self.region, _FACETS),
            ),
            key_points_mm=points,
            target_centre_mm=centre,
            target_radius_mm=radius,
            lens=lens or scene_lens(name),
            workspace=self.workspace,
            roll_free=name == "rect",
            starts=starts,
            candidates=candidates,
            user_starts=user_starts,
        )

    def _resolution(self, factor: float) -> Resolution:
        return Resolution.of_segments(
            self.segments_mm,
            detail_mm=DETAIL_MM,
            pixels=factor * REQUIRED_MM / SENSOR.diagonal_pitch_mm,
            sensor=SENSOR,
            names=[edge.id for edge in self.edges],
        )

    def _field_of_view(
        self, name: SceneName
    ) -> FieldOfViewRectangle | FieldOfViewCircle:
        points = self.key_points_mm
        if name == "rect":
            return FieldOfViewRectangle(points, np.repeat(_RECTANGLE_MM, 2) / 2)
        centre, radius = enclosing_sphere(points)
        return FieldOfViewCircle(centre, radius, IMAGE_DIAMETER_MM / 2)


def scene_lens(name: SceneName, *, e_mm: float = 0.0) -> LensBounds:
    """The lens of one scene."""
    if name == "fa":
        return LensBounds.of(f_mm=(8, 25), d_mm=(8.05, 30), a_mm=(0.4, 4), e_mm=e_mm)
    return LensBounds.of(f_mm=12.5, d_mm=(12.6, 15), a_mm=0.78125, e_mm=e_mm)


def _paper_scene(sizes: PaperObject, *, walls: bool) -> PlanningScene:
    """The two feature edges of the cube, seen from a workspace of 1.3 m."""
    mesh = paper_object(sizes)
    corner = np.array([12.7, 0.0, 12.7])
    edges = (
        edge_feature("horizontal edge", corner * [-1, 1, 1], corner, mesh),
        edge_feature("vertical edge", corner * [1, 1, -1], corner, mesh),
    )
    workspace = Box(np.full(3, -HALF_MM), np.full(3, HALF_MM))
    return PlanningScene(mesh, edges, workspace, walls)


def race_scene() -> PlanningScene:
    """The object without slit, walls counting as facets: known best indices."""
    return _paper_scene(without_slit(), walls=True)


def experiment_scene() -> PlanningScene:
    """The object that reproduces the facts of the three experiments."""
    return _paper_scene(PaperObject(), walls=False)
