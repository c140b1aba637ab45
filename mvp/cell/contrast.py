"""How much of a step every line of a view will show, at each roll of the camera.

The light travels with the camera, so turning the camera about its axis changes which
face of an edge is the brighter one, and nothing else. What lies on both sides of every
line is found once by rays; each roll then only turns the lamps.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Self

import numpy as np

from mvp.cell.light_config import illumination
from mvp.imaging import BothSides, both_sides, expect_view, outward_normals
from mvp.imaging.render_body import RenderBody
from mvp.imaging.render_scene import RenderScene
from mvp.scene import CadEdges, cad_edges

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.cell.plan_problem import ProblemFactory
    from mvp.geometry import FloatArray, IntArray, Pose
    from mvp.imaging import ExpectedEdge, Illumination, ViewExpectation
    from mvp.optics import LensSetting
    from mvp.scene import Feature

_PLACES = 13
_BETWEEN = 0.1, 0.9
_CLEAR_PX = 1.5
# A line is measured on three quarters of its length, a rim where it stands out.
_EDGE_PERCENT = 25.0
_RIM_PERCENT = 10.0
_HEADROOM = 2.0
_RANKS = 10


@dataclass(frozen=True, eq=False)
class Line:
    """Something that must stand out for a picture to be measured.

    Attributes:
        name: for people.
        feature: whose it is.
        pieces: numbers of the probed pieces; the clearest of them counts.
    """

    name: str
    feature: str
    pieces: tuple[int, ...]


@dataclass(frozen=True)
class SeenContrast:
    """What a view will show at the roll it is taken with.

    Attributes:
        by_line: step over the brighter grey.
        by_feature: the smallest of each feature's lines.
        asked: what a line must show to be measured.
    """

    by_line: dict[str, float]
    by_feature: dict[str, float]
    asked: float

    @property
    def smallest(self) -> float:
        """Of the faintest line; 1 when nothing is measured by lines."""
        return min(self.by_line.values(), default=1.0)

    @property
    def rank(self) -> float:
        """0 to 1: reached when every line shows what is asked, with headroom."""
        return float(_rank(np.array([self.smallest]), self.asked)[0])

    @property
    def notes(self) -> list[str]:
        """What will not be measurable for want of contrast."""
        faint = {n: v for n, v in self.by_line.items() if v < self.asked}
        if not faint:
            return []
        name = min(faint, key=lambda n: faint[n])
        more = f" ({len(faint) - 1} more lines are faint)" if len(faint) > 1 else ""
        return [
            f"{name} will show only {faint[name]:.0%} contrast{more}: expect 'not "
            "measurable'; a second light or a coating helps"
        ]


@dataclass(frozen=True, eq=False)
class ViewContrast:
    """The contrast of one view at any roll.

    Attributes:
        rotation: (3, 3) part_from_camera at turn 0.
        lines: what must stand out.
        sides: both sides of every probed place.
        piece: (n,) piece of every place.
        percent: (K,) which percentile of its places stands for a piece.
        light: fixed to the camera.
        asked: smallest contrast that can be measured.
    """

    rotation: FloatArray
    lines: tuple[Line, ...]
    sides: BothSides
    piece: IntArray
    percent: FloatArray
    light: Illumination
    asked: float

    def values(self, rotations: FloatArray) -> FloatArray:
        """Contrast (M, lines) at part_from_camera rotations (M, 3, 3)."""
        x = rotations[:, :, 0]
        turns = np.arctan2(x @ self.rotation[:, 1], x @ self.rotation[:, 0])
        places = self.sides.contrast(self.light, turns)
        pieces = [
            np.percentile(places[:, self.piece == k], percent, axis=1)
            for k, percent in enumerate(self.percent)
        ]
        found = [
            np.max([pieces[k] for k in line.pieces], axis=0) for line in self.lines
        ]
        return np.stack(found, axis=1) if found else np.ones((len(rotations), 0))

    def rank(self, rotations: FloatArray) -> FloatArray:
        """0 to 1 (M,), in tenths: how nearly the faintest line shows enough."""
        return _rank(self.values(rotations).min(axis=1, initial=1.0), self.asked)

    def at(self, part_from_camera: Pose) -> SeenContrast:
        """What is seen at one roll."""
        values = self.values(part_from_camera.rotation[None])[0]
        by_line = {
            line.name: float(v) for line, v in zip(self.lines, values, strict=True)
        }
        by_feature: dict[str, float] = {}
        for line, value in zip(self.lines, values, strict=True):
            before = by_feature.get(line.feature, np.inf)
            by_feature[line.feature] = min(before, float(value))
        return SeenContrast(by_line, by_feature, self.asked)


@dataclass(frozen=True, eq=False)
class ContrastForecast:
    """Predicts contrast of views of one scene.

    Attributes:
        factory: scene and sensor.
        light: believed.
        asked: smallest contrast that can be measured.
    """

    factory: ProblemFactory
    light: Illumination
    asked: float

    @classmethod
    def of_cell(cls, factory: ProblemFactory) -> Self | None:
        """For the light that the cell states; None when it states none."""
        stated = factory.cell.config.light
        light = illumination(stated)
        if stated is None or light is None:
            return None
        return cls(factory, light, stated.min_contrast)

    @cached_property
    def _edges(self) -> CadEdges:
        return cad_edges(self.factory.scene.scene.occluders)

    @cached_property
    def _scene(self) -> RenderScene:
        return RenderScene([RenderBody(self.factory.scene.scene.occluders)])

    def of(
        self, features: Sequence[Feature], part_from_camera: Pose, lens: LensSetting
    ) -> ViewContrast:
        """Probe both sides of every line that the view will be measured by."""
        expectation = expect_view(
            features,
            self.factory.scene.scene.occluders,
            self._edges,
            part_from_camera,
            f_mm=lens.f_mm,
            d_mm=lens.d_mm,
            a_mm=lens.a_mm,
            e_mm=lens.e_mm,
            intrinsics=self.factory.intrinsics.at(lens.centre_px, lens.k1),
            c_mm=self.factory.c_mm,
            auxiliary=0,
        )
        probes = _Probes.of(expectation)
        sides = both_sides(
            probes.places_px,
            probes.normals_px,
            probes.away_px,
            self._scene,
            part_from_camera,
            expectation.plane,
        )
        return ViewContrast(
            part_from_camera.rotation,
            _lines(expectation),
            sides,
            probes.piece,
            probes.percent,
            self.light,
            self.asked,
        )


@dataclass(frozen=True, eq=False)
class _Probes:
    """Places on all edges, then on all rims, of an expectation."""

    places_px: FloatArray
    normals_px: FloatArray
    away_px: FloatArray
    piece: IntArray
    percent: FloatArray

    @classmethod
    def of(cls, expectation: ViewExpectation) -> Self:
        share = np.linspace(*_BETWEEN, _PLACES)[:, None]
        places = [np.zeros((0, 2))]
        normals = [np.zeros((0, 2))]
        blurs: list[float] = []
        percent: list[float] = []
        for edge in expectation.edges:
            places.append(edge.start_px * (1 - share) + edge.end_px * share)
            normals.append(np.broadcast_to(edge.normal, (_PLACES, 2)))
            blurs.append(edge.blur_px)
            percent.append(_EDGE_PERCENT)
        for rim in expectation.rims:
            seen = rim.visible if rim.visible.any() else ~rim.visible
            places.append(rim.points_px[seen])
            normals.append(outward_normals(rim.points_px)[seen])
            blurs.append(rim.blur_px)
            percent.append(_RIM_PERCENT)
        counts = [len(p) for p in places[1:]]
        return cls(
            np.concatenate(places),
            np.concatenate(normals),
            np.repeat(_CLEAR_PX + np.array(blurs) / 2, counts),
            np.repeat(np.arange(len(counts)), counts),
            np.array(percent),
        )


def _lines(expectation: ViewExpectation) -> tuple[Line, ...]:
    """Feature edges, what marks their ends, and rims."""
    lines: list[Line] = []
    for number, edge in enumerate(expectation.edges):
        if edge.role == "feature":
            own = Line(edge.name, edge.feature, (number,))
            lines += [own, *_ends(edge)]
    for point in expectation.points:
        lines += [
            Line(f"{point.feature}, edge {k}", point.feature, (number,))
            for k, number in enumerate(point.neighbours, 1)
        ]
    first = len(expectation.edges)
    for number, rim in enumerate(expectation.rims):
        same = [r for r in expectation.rims[:number] if r.feature == rim.feature]
        name = f"{rim.feature}, circle {len(same) + 1}" if same else rim.feature
        lines.append(Line(name, rim.feature, (first + number,)))
    return tuple(lines)


def _ends(edge: ExpectedEdge) -> list[Line]:
    """One clear edge across is enough to mark an end; a smooth end is not asked for."""
    if edge.open_ends:
        return []
    return [
        Line(f"what marks the {end} of {edge.name}", edge.feature, numbers)
        for end, numbers in (
            ("start", edge.start_neighbours),
            ("end", edge.end_neighbours),
        )
        if numbers
    ]


def _rank(smallest: FloatArray, asked: float) -> FloatArray:
    """Share of the contrast asked for, with headroom, in whole steps."""
    if asked <= 0:
        return np.ones(len(smallest))
    share = np.minimum(smallest / (_HEADROOM * asked), 1.0)
    return np.asarray(np.floor(share * _RANKS + 1e-9) / _RANKS)
