"""What a view must show, from CAD, planned pose and planned lens alone."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from mvp.imaging.expectation import (
    DrawnEdges,
    ExpectedEdge,
    ExpectedPoint,
    ExpectedRim,
    Requirement,
    ViewExpectation,
    ViewTolerance,
)
from mvp.imaging.measure_plane import ImagePlane
from mvp.imaging.predict_contrast import contrast_at
from mvp.imaging.predict_geometry import (
    SAME_PLACE_MM,
    cropped,
    cross,
    detail_px,
    distance_mm,
    on_line,
)
from mvp.imaging.predict_lines import (
    SAMPLES,
    Lines,
    Sightings,
    drawn_pieces,
    joined,
    runs,
    sight,
    silhouettes,
)
from mvp.imaging.predict_outlines import Side, measured_pieces, outline_parts
from mvp.imaging.predict_rims import expected_rim
from mvp.imaging.render_body import RenderBody
from mvp.imaging.render_scene import RenderScene

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from mvp.geometry import BoolArray, FloatArray, Pose, TriangleMesh
    from mvp.imaging.light import Illumination
    from mvp.optics import Intrinsics
    from mvp.scene import Feature

_CROP_PX = 90.0
_SHORTEST_NEIGHBOUR_PX = 8.0
_SHORTEST_AUXILIARY_PX = 20.0
_SMALLEST_CROSSING = np.sin(np.deg2rad(15.0))
_SMOOTH_DEG = 40.0
_FAINT = 0.08
_CLEAR_OF_EDGE_PX = 1.5


class EdgeList(Protocol):
    """Straight sharp edges of the CAD model (``mvp.scene.cad_edges``)."""

    @property
    def start_mm(self) -> FloatArray: ...  # noqa: D102
    @property
    def end_mm(self) -> FloatArray: ...  # noqa: D102
    @property
    def normal_a(self) -> FloatArray: ...  # noqa: D102
    @property
    def normal_b(self) -> FloatArray: ...  # noqa: D102
    @property
    def convex(self) -> BoolArray: ...  # noqa: D102


@dataclass(frozen=True, eq=False)
class _Stage:
    """Everything the pieces of a prediction share."""

    scene: RenderScene
    pose: Pose
    plane: ImagePlane
    light: Illumination | None
    lines: Lines
    seen: Sightings
    requirements: Mapping[str, Requirement]


def expect_view(
    features: Sequence[Feature],
    mesh: TriangleMesh,
    edges: EdgeList,
    part_from_camera: Pose,
    *,
    f_mm: float,
    d_mm: float,
    a_mm: float,
    e_mm: float,
    intrinsics: Intrinsics,
    c_mm: float,
    tolerance: ViewTolerance | None = None,
    requirements: Mapping[str, Requirement] | None = None,
    light: Illumination | None = None,
    auxiliary: int = 13,
) -> ViewExpectation:
    """Predict the lines of one picture.

    Args:
        features: what the view was planned for, part frame.
        mesh: part and fixtures, everything that can hide something, part frame.
        edges: straight sharp edges of part and fixtures.
        part_from_camera: planned pose; the camera's origin is the entrance pupil.
        f_mm: planned focal length.
        d_mm: planned image distance.
        a_mm: planned diameter of the entrance pupil.
        e_mm: pupil offset.
        intrinsics: sensor, principal point, distortion.
        c_mm: largest acceptable blur circle.
        tolerance: of the plan.
        requirements: the promised resolution by feature id.
        light: predicts contrast; without it contrast is judged in the picture only.
        auxiliary: how many further edges are measured for registration.
    """
    plane = ImagePlane(intrinsics, f_mm, d_mm, a_mm, e_mm)
    scene, lines = RenderScene([RenderBody(mesh)]), _lines(edges)
    seen = sight(lines, scene, part_from_camera, plane)
    stage = _Stage(
        scene, part_from_camera, plane, light, lines, seen, requirements or {}
    )
    builder = _Builder(stage)
    rims, points = builder.add_features(features)
    builder.add_auxiliary(auxiliary)
    drawn, notes = _all_drawn(stage, mesh), tuple(builder.notes)
    c_px, allowed = c_mm / plane.px_mm, tolerance or ViewTolerance()
    kept = tuple(builder.edges)
    return ViewExpectation(plane, c_px, allowed, kept, drawn, rims, points, notes)


def _lines(edges: EdgeList) -> Lines:
    return Lines(
        edges.start_mm, edges.end_mm, edges.normal_a, edges.normal_b, edges.convex
    )


def _all_drawn(stage: _Stage, mesh: TriangleMesh) -> DrawnEdges:
    curved = silhouettes(mesh, stage.pose, _SMOOTH_DEG)
    if not len(curved.start_mm):
        return drawn_pieces(stage.seen, stage.plane)
    lines = joined([stage.lines, curved])
    return drawn_pieces(sight(lines, stage.scene, stage.pose, stage.plane), stage.plane)


class _Builder:
    """Collects the edges to measure: features, then neighbours, then others."""

    def __init__(self, stage: _Stage) -> None:
        self.stage = stage
        self.edges: list[ExpectedEdge] = []
        self.notes: list[str] = []
        self._used: set[int] = set()
        self._feature_lines: dict[int, int] = {}
        self._neighbour_of: dict[tuple[int, bool], int] = {}

    def add_features(
        self, features: Sequence[Feature]
    ) -> tuple[tuple[ExpectedRim, ...], tuple[ExpectedPoint, ...]]:
        """Rims and points are returned, edges kept."""
        rims: list[ExpectedRim] = []
        for feature in features:
            if feature.kind in ("edge", "face"):
                rims += self._add_outline(feature)
            elif feature.kind == "hole":
                rims.append(self._rim(feature.id, np.asarray(feature.outline_mm[0])))
        for index, edge in enumerate(self.edges[:]):
            ends = self._part_point(edge.asked.start_mm), edge.asked.end_mm
            start = self._neighbours(ends[0], edge.direction)
            end = self._neighbours(self._part_point(ends[1]), edge.direction)
            self.edges[index] = replace(
                edge, start_neighbours=start, end_neighbours=end
            )
        corners = [self._point(f) for f in features if f.kind == "point"]
        return tuple(rims), tuple(corners)

    def _part_point(self, point_camera: FloatArray) -> FloatArray:
        return self.stage.pose.apply(point_camera)

    def _add_outline(self, feature: Feature) -> list[ExpectedRim]:
        """Keep the straight sides, return the circles, note what is left out."""
        stage = self.stage
        lines = tuple(np.asarray(line) for line in feature.outline_mm)
        parts = outline_parts(lines, stage.pose, stage.plane)
        for number, side in enumerate(parts.sides, 1):
            alone = feature.kind == "edge" and len(parts.sides) == 1
            name = feature.id if alone else f"{feature.id}:{number}"
            self._add_pieces(self._feature_edge(feature.id, name, side))
        if parts.left_px > 0:
            self.notes.append(
                f"{feature.id}: {parts.left_px:.0f} of {parts.total_px:.0f} px of its "
                "outline are curved or too short and are not measured"
            )
        return [self._rim(feature.id, rim) for rim in parts.rims]

    def _add_pieces(self, edge: ExpectedEdge) -> None:
        """Keep every piece of a feature edge that can be measured on its own."""
        stage = self.stage
        away = _CLEAR_OF_EDGE_PX + edge.blur_px / 2
        for piece in measured_pieces(edge, away, stage.scene, stage.pose, stage.plane):
            self.edges.append(replace(piece, contrast=self._contrast(piece)))

    def _feature_edge(self, feature: str, name: str, side: Side) -> ExpectedEdge:
        stage, a_mm, b_mm = self.stage, side.start_mm, side.end_mm
        along = on_line(stage.lines, a_mm, b_mm)
        for line_number in np.flatnonzero(along):
            self._used.add(int(line_number))
            self._feature_lines.setdefault(int(line_number), len(self.edges))
        first = int(np.flatnonzero(along)[0]) if along.any() else None
        none = np.zeros((1, 3))
        pick = slice(first, None if first is None else first + 1)
        line = Lines(
            a_mm[None],
            b_mm[None],
            none if first is None else stage.lines.normal_a[pick],
            none if first is None else stage.lines.normal_b[pick],
            np.ones(1, np.bool_) if first is None else stage.lines.convex[pick],
        )
        seen = sight(line, stage.scene, stage.pose, stage.plane)
        requirement = stage.requirements.get(feature)
        run = 0, SAMPLES - 1
        edge = self._edge(name, feature, "feature", seen, 0, run, requirement)
        return replace(edge, open_ends=side.open_ends)

    def _edge(
        self,
        name: str,
        feature: str,
        role: str,
        seen: Sightings,
        index: int,
        run: tuple[int, int],
        requirement: Requirement | None = None,
    ) -> ExpectedEdge:
        first, last = run
        share = np.array([first, last])[:, None] / (SAMPLES - 1)
        ends = seen.start_mm[index] * (1 - share) + seen.end_mm[index] * share
        blur = self.stage.plane.blur_px(seen.depth_mm[index, first : last + 1])
        edge = ExpectedEdge(
            name=name,
            feature=feature,
            role=role,  # type: ignore[arg-type]
            start_px=seen.places_px[index, first],
            end_px=seen.places_px[index, last],
            start_mm=ends[0],
            end_mm=ends[1],
            blur_px=float(np.sqrt(np.mean(blur**2))),
            visible=seen.visible[index, first : last + 1],
            requirement=requirement,
        )
        detail = detail_px(edge, self.stage.plane) if requirement else float("nan")
        return replace(edge, contrast=self._contrast(edge), detail_px=detail)

    def _contrast(self, edge: ExpectedEdge) -> float:
        stage = self.stage
        if stage.light is None:
            return float("nan")
        share = np.linspace(0.2, 0.8, 13)[:, None]
        places = edge.start_px * (1 - share) + edge.end_px * share
        normals = np.broadcast_to(edge.normal, places.shape)
        away = _CLEAR_OF_EDGE_PX + edge.blur_px / 2
        values = contrast_at(
            places, normals, away, stage.light, stage.scene, stage.pose, stage.plane
        )
        return float(np.median(values))

    def _neighbours(
        self, corner_mm: FloatArray, direction: FloatArray | None
    ) -> tuple[int, ...]:
        """Edges that run through a corner, measured near it."""
        stage = self.stage
        touching = np.flatnonzero(distance_mm(stage.lines, corner_mm) < SAME_PLACE_MM)
        found: list[int] = []
        for line in touching:
            own = self._feature_lines.get(int(line))
            ways = (False, True) if own is None else (False,)
            for toward_end in ways:
                number = own
                if number is None:
                    number = self._neighbour(int(line), corner_mm, toward_end)
                if number is None:
                    continue
                crossing = cross(self.edges[number].direction, direction)
                if crossing > _SMALLEST_CROSSING:
                    found.append(number)
        return tuple(sorted(set(found)))

    def _neighbour(
        self, line: int, corner_mm: FloatArray, toward_end: bool
    ) -> int | None:
        """The visible run that leaves the corner in one direction along a line."""
        lines, seen = self.stage.lines, self.stage.seen
        along = lines.end_mm[line] - lines.start_mm[line]
        place = float((corner_mm - lines.start_mm[line]) @ along / (along @ along))
        first = round(place * (SAMPLES - 1))
        step = 1 if toward_end else -1
        inner = first + step
        if not 0 <= inner < SAMPLES or not seen.visible[line, inner]:
            return None
        key = (line, toward_end) if 0.01 < place < 0.99 else (line, place < 0.5)
        if key in self._neighbour_of:
            return self._neighbour_of[key]
        last = inner
        while 0 <= last + step < SAMPLES and seen.visible[line, last + step]:
            last += step
        run = (min(first, last), max(first, last))
        number = self._added_crop(line, run, near_end=not toward_end)
        if number is not None:
            self._neighbour_of[key] = number
        return number

    def _added_crop(
        self, line: int, run: tuple[int, int], *, near_end: bool
    ) -> int | None:
        name = f"edge {line + 1}"
        edge = self._edge(name, "", "neighbour", self.stage.seen, line, run)
        if not edge.length_px > _SHORTEST_NEIGHBOUR_PX:
            return None
        self._used.add(line)
        low, high = (
            (1 - _CROP_PX / edge.length_px, 1.0)
            if near_end
            else (
                0.0,
                _CROP_PX / edge.length_px,
            )
        )
        self.edges.append(cropped(edge, low, high, self.stage.plane))
        return len(self.edges) - 1

    def add_auxiliary(self, count: int) -> None:
        """The longest visible runs that are not measured yet."""
        seen = self.stage.seen
        candidates = []
        for number in np.flatnonzero(seen.visible.sum(axis=1) > 2):
            line = int(number)
            if line in self._used:
                continue
            for run in runs(seen.visible[line]):
                places = seen.places_px[line, [run[0], run[1]]]
                length = float(np.linalg.norm(places[1] - places[0]))
                if length > _SHORTEST_AUXILIARY_PX:
                    candidates.append((-length, line, run))
        wanted = len(self.edges) + count
        for _, line, run in sorted(candidates):
            if len(self.edges) == wanted:
                break
            edge = self._edge(f"edge {line + 1}", "", "auxiliary", seen, line, run)
            half = min(_CROP_PX / edge.length_px, 1.0) / 2
            edge = cropped(edge, 0.5 - half, 0.5 + half, self.stage.plane)
            if not edge.contrast < _FAINT:
                self.edges.append(edge)

    def _rim(self, feature: str, outline_mm: FloatArray) -> ExpectedRim:
        stage = self.stage
        return expected_rim(
            feature,
            outline_mm,
            stage.scene,
            stage.pose,
            stage.plane,
            stage.light,
            stage.requirements.get(feature),
            stage.lines,
        )

    def _point(self, feature: Feature) -> ExpectedPoint:
        part = np.asarray(feature.key_points_mm)[0]
        camera = self.stage.pose.inverse().apply(part)
        return ExpectedPoint(
            feature=feature.id,
            point_px=self.stage.plane.project(camera),
            point_mm=camera,
            neighbours=self._neighbours(part, None),
            blur_px=float(self.stage.plane.blur_px(camera[2])),
        )
