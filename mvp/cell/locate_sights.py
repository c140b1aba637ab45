"""The part of a task as a wizard sees it: where to look from, what a picture shows."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from mvp.cell.light_config import illumination
from mvp.cell.locate_views import locating_views
from mvp.cell.plan_job import make_plan
from mvp.errors import InfeasibleError
from mvp.imaging import ViewTolerance, expect_view, measure_part, meter_exposure
from mvp.scene import CadEdges, cad_edges
from mvp.wizard import SeenPart

if TYPE_CHECKING:
    from mvp.cell.plan_job import Planned, Setting
    from mvp.cell.progress import Tell
    from mvp.geometry import FloatArray, Pose
    from mvp.imaging import PartLines, ViewExpectation
    from mvp.wizard import SessionFacts, Shot, SightView

# Of a part that was put down by hand; it decides how much of a picture is believed.
_PUT_DOWN = ViewTolerance(position_mm=5.0, angle_deg=2.0, d_mm=0.05)
_EDGES = 24


@dataclass(eq=False)
class TaskSights:
    """See ``mvp.wizard.PartSights``.

    Attributes:
        setting: the cell with the part where it is believed to be.
        facts: of the session: camera and lens.
        planned: the plan for that place; made when it is first asked for.
        tell: hears about the stages of planning.
    """

    setting: Setting
    facts: SessionFacts
    planned: Planned | None = None
    tell: Tell | None = None
    _views: list[SightView] = field(default_factory=list)
    _last: tuple[bytes, ViewExpectation] | None = None

    def views(self) -> list[SightView]:
        """Where to look from; see ``PartSights``."""
        if not self._views:
            self._views = locating_views(self._plan())
        return self._views

    def _plan(self) -> Planned:
        if self.planned is None:
            setting = self.setting
            self.planned = make_plan(
                setting.cell, setting.task, seed=self.facts.seed, tell=self.tell
            )
        plan = self.planned.plan
        if not plan.views:
            missing = "; ".join(f"{m.feature}: {m.reason}" for m in plan.not_covered)
            fixes = "; ".join(dict.fromkeys(m.fix for m in plan.not_covered if m.fix))
            raise InfeasibleError(
                f"the part cannot be looked at where it is believed to be: {missing}",
                hint=fixes,
                where=plan.task.file,
            )
        return self.planned

    @cached_property
    def _edges(self) -> CadEdges:
        """Of the part alone: fixtures do not move with it."""
        return cad_edges(self.setting.scene.scene.part)

    def measure(self, shot: Shot, camera_from_part: Pose) -> SeenPart:
        """Measure the part's edges and holes in a picture; see ``PartSights``."""
        expectation = self._expected(shot, camera_from_part)
        found = measure_part(shot.pixels, float(shot.full_scale), expectation)
        return _in_part(found, camera_from_part.inverse())

    def exposure_factor(self, shot: Shot, camera_from_part: Pose) -> float:
        """How much longer to expose for the features; see ``PartSights``."""
        expectation = self._expected(shot, camera_from_part)
        return meter_exposure(shot.pixels, float(shot.full_scale), expectation)

    def _expected(self, shot: Shot, camera_from_part: Pose) -> ViewExpectation:
        """What the picture should show; the last one is kept."""
        scene, facts = self.setting.scene.scene, self.facts
        key = camera_from_part.matrix.tobytes() + repr(shot.lens_steps).encode()
        if self._last is not None and self._last[0] == key:
            return self._last[1]
        lens = facts.lens_at(dict(shot.lens_steps))
        expectation = expect_view(
            scene.features,
            scene.occluders,
            self._edges,
            camera_from_part.inverse(),
            f_mm=lens.f_mm,
            d_mm=lens.d_mm,
            a_mm=lens.a_mm,
            e_mm=lens.e_mm,
            intrinsics=facts.intrinsics_at(lens),
            c_mm=facts.blur_circle_mm,
            tolerance=_PUT_DOWN,
            light=illumination(self.setting.cell.config.light),
            auxiliary=_EDGES,
        )
        self._last = key, expectation
        return expectation


def _in_part(found: PartLines, part_from_camera: Pose) -> SeenPart:
    def placed(points: FloatArray) -> FloatArray:
        return part_from_camera.apply(points.reshape(-1, 3)).reshape(points.shape)

    return SeenPart(
        ends_part_mm=placed(found.ends_mm),
        edge_pixels=found.places_px,
        edge=found.edge,
        edge_sigma_px=found.sigma_px,
        edge_names=found.names,
        agrees=found.agrees,
        centres_part_mm=placed(found.centres_mm),
        normals_part=np.asarray(found.axes @ part_from_camera.rotation.T),
        radii_mm=found.radii_mm,
        rim_pixels=found.rim_px,
        rim_sigma_px=found.rim_sigma_px,
        rim_names=found.rim_names,
        found=found.found,
        reason=found.reason,
    )
