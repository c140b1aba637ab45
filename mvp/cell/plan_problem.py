"""From a scene, a lens and a group of features to a problem the planner can search."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from mvp.cell.values import bounds
from mvp.cell.view_uncertainty import stated_uncertainty, view_errors
from mvp.constraints import (
    FieldOfViewCircle,
    FieldOfViewRectangle,
    FocusFar,
    FocusNear,
    LensRange,
    Resolution,
    Visibility,
    Workspace,
    enclosing_sphere,
)
from mvp.errors import CalibrationError
from mvp.geometry import Box, Pose
from mvp.kinematics import camera_rotation, intrinsics_of
from mvp.optics import LensTable, Views
from mvp.planning import LensBounds, PlanningProblem
from mvp.visibility import (
    NOTHING,
    OWN_FACES,
    Occluders,
    Region,
    intersection,
    limiting_faces,
    prepare,
    visibility_region,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.cell.loading import LoadedCell, LoadedTask
    from mvp.cell.task_scene import TaskScene
    from mvp.constraints import Constraint
    from mvp.geometry import FloatArray
    from mvp.optics import AxisName, Intrinsics
    from mvp.planning import Accept
    from mvp.scene import Feature

_GUARD_PX = 12.0
_FACETS = 16
# First zero of the Airy pattern: diameter 2.44 lambda d / a.
_AIRY = 2.44


@dataclass(frozen=True, eq=False)
class ProblemFactory:
    """Makes a problem for any group of a task's features and any extension tube.

    Regions of single features are computed once; groups intersect them.

    Attributes:
        beyond: plan over the whole lens table, not only where it holds.
    """

    cell: LoadedCell
    task: LoadedTask
    scene: TaskScene
    accept: Accept | None = None
    beyond: bool = False
    _regions: dict[str, Region] = field(default_factory=dict)

    @cached_property
    def base_from_part(self) -> Pose:
        """Where the part lies."""
        return self.cell.calibrations.base_from_part

    @cached_property
    def intrinsics(self) -> Intrinsics:
        """Sensor, principal point and distortion, unless the zoom changes them."""
        return intrinsics_of(self.cell.calibrations.camera)

    def intrinsics_at(self, f_mm: float) -> Intrinsics:
        """The same where the zoom gives f."""
        here = self.table.optics_of(f_mm)
        return self.intrinsics.at(here.centre_px, here.k1)

    @cached_property
    def table(self) -> LensTable:
        """The lens on the tube that is mounted, where its table holds."""
        found = self.cell.calibrations
        try:
            table = LensTable.from_calibration(
                found.lens_table, tube_mm=self.cell.config.optics.mounted_tube_mm
            )
            return table.within(None if self.beyond else found.lens_table.validity)
        except CalibrationError as error:
            file = str(found.files["lens_table"])
            raise CalibrationError(
                f"{file}: {error.message}", hint=error.hint, where=file
            ) from error

    @cached_property
    def workspace_base(self) -> Box:
        """Where the pupil may be, base frame."""
        stated = self.cell.config.workspace
        return Box(np.array(stated.low_mm), np.array(stated.high_mm))

    @cached_property
    def search_box(self) -> Box:
        """A part-frame box around the workspace."""
        corners = self.base_from_part.inverse().apply(self.workspace_base.corners())
        return Box.around(corners)

    @cached_property
    def occluders(self) -> Occluders:
        """Part and fixtures, prepared."""
        return prepare(self.scene.scene.occluders)

    def face_name(self, face_id: int) -> str:
        """How messages call a face of part or fixtures."""
        return self.scene.scene.face_name(face_id)

    @property
    def c_mm(self) -> float:
        """Largest acceptable circle of confusion."""
        return self.cell.config.optics.blur_circle_um / 1000

    def region(self, feature: Feature) -> Region:
        """Where one feature is seen whole."""
        if feature.id not in self._regions:
            self._regions[feature.id] = visibility_region(
                self.occluders, feature.sight_pieces(), self.search_box
            )
        return self._regions[feature.id]

    def sight_row(self, features: Sequence[Feature], position_mm: FloatArray) -> str:
        """Which feature is lost first near a pupil (3,), part frame, and to what."""
        point = position_mm[None]
        distances = [float(self.region(f).signed_distance(point)[0]) for f in features]
        weakest = features[int(np.argmin(distances))]
        face = int(limiting_faces(self.region(weakest), point)[0])
        if face == NOTHING:
            return weakest.id
        if face == OWN_FACES:
            return f"{weakest.id}, before it turns away"
        return f"{weakest.id}, before {self.face_name(face)} hides it"

    def common_region(self, features: Sequence[Feature]) -> Region:
        """Where all features are seen whole."""
        return intersection([self.region(f) for f in features])

    def tubes_mm(self) -> list[float]:
        """The mounted tube, then the others by length."""
        optics = self.cell.config.optics
        others = {0.0, *optics.extension_tubes_mm} - {optics.mounted_tube_mm}
        return [optics.mounted_tube_mm, *sorted(others)]

    def lens_bounds(
        self, tube_mm: float, *, f_mm: float | None = None
    ) -> LensBounds | None:
        """What lens, tube and task allow together; None when nothing is left.

        Args:
            tube_mm: the extension tube.
            f_mm: the zoom step that gives about so much is the only one.
        """
        table, wanted = self.table.with_tube(tube_mm), self.task.config.lens
        f = _common(table.f_range_mm, wanted.f_mm)
        if f is not None and f_mm is not None:
            f = (float(table.zoom.value_mm(table.zoom.nearest_step(f_mm))),) * 2
        a = _common(table.a_range_mm, wanted.a_mm or self._default_a_mm)
        if f is None or a is None:
            return None
        table = table.at_focal_length(_middle(f))
        lens_d = (table.d_range_mm(f[0])[0], table.d_range_mm(f[1])[1])
        d = _common(lens_d, wanted.d_mm)
        if d is None or d[1] <= f[0]:
            return None
        return LensBounds(f, d, a, table.pupil_offset_mm)

    @cached_property
    def _default_a_mm(self) -> float:
        """The pupil whose diffraction disc is as large as the accepted blur."""
        optics = self.cell.config.optics
        d_mm = self.table.d_range_mm(self._nominal_f_mm)[0]
        a_mm = _AIRY * optics.wavelength_nm * 1e-6 * d_mm / self.c_mm
        return float(np.clip(a_mm, *self.table.a_range_mm))

    @property
    def _nominal_f_mm(self) -> float:
        wanted = self.task.config.lens.f_mm
        return float(np.mean(bounds(wanted) if wanted else self.table.f_range_mm))

    def problem(
        self,
        features: Sequence[Feature],
        region: Region,
        lens: LensBounds,
        tube_mm: float,
    ) -> PlanningProblem:
        """The problem of one group with one tube."""
        points = np.concatenate([f.key_points_mm for f in features])
        centre, radius = enclosing_sphere(points)
        names = [
            f"{f.id}, point {i + 1}"
            for f in features
            for i in range(len(f.key_points_mm))
        ]
        constraints: list[Constraint] = [
            self._resolution(features),
            FocusNear(points, self.c_mm, tuple(names)),
            FocusFar(points, self.c_mm, tuple(names)),
            self._field_of_view(points, tuple(names), _middle(lens.f_mm)),
            Visibility(region, _FACETS),
            Workspace(self.workspace_base, self.base_from_part),
        ]
        constraints += self._lens_range(lens, tube_mm)
        return PlanningProblem(
            constraints=tuple(constraints),
            key_points_mm=points,
            target_centre_mm=centre,
            target_radius_mm=radius,
            lens=lens,
            workspace=self.search_box,
            roll_free=self.task.config.planning.field_of_view == "rectangle",
            uncertainty=stated_uncertainty(self.cell),
            errors=view_errors(self.cell),
            accept=self.accept,
            user_starts=self._user_starts(lens),
        )

    def _resolution(self, features: Sequence[Feature]) -> Constraint:
        segments, detail, pixels, names = [], [], [], []
        for feature in features:
            wanted = self.scene.requirements[feature.id]
            for number, segment in enumerate(feature.segments_mm, 1):
                segments.append(segment)
                detail.append(wanted.detail_mm)
                pixels.append(wanted.pixels)
                names.append(
                    feature.id
                    if len(feature.segments_mm) == 1
                    else f"{feature.id}, line {number}"
                )
        return Resolution.of_segments(
            np.array(segments),
            detail_mm=detail,
            pixels=pixels,
            sensor=self.intrinsics.sensor,
            names=names,
        )

    def _field_of_view(
        self, points: FloatArray, names: tuple[str, ...], f_mm: float
    ) -> Constraint:
        intrinsics = self.intrinsics_at(f_mm)
        if self.task.config.planning.field_of_view == "rectangle":
            return FieldOfViewRectangle.for_sensor(
                points, intrinsics, guard_px=_GUARD_PX, names=names
            )
        centre, radius = enclosing_sphere(points)
        return FieldOfViewCircle.for_sensor(
            centre, radius, intrinsics, guard_px=_GUARD_PX
        )

    def _lens_range(self, lens: LensBounds, tube_mm: float) -> list[Constraint]:
        """Bounds of what is free; a fixed value needs no margin."""
        axes: list[AxisName] = ["focus"] if lens.d_free else []
        axes += ["zoom"] if lens.f_free else []
        axes += ["iris"] if lens.a_free else []
        if not axes:
            return []
        wanted = self.task.config.lens
        table = self.table.with_tube(tube_mm).at_focal_length(_middle(lens.f_mm))
        return [
            LensRange.within(
                table=table,
                axes=axes,
                d_mm=_range(wanted.d_mm),
                f_mm=_range(wanted.f_mm),
                a_mm=_range(wanted.a_mm),
            )
        ]

    def _user_starts(self, lens: LensBounds) -> Views | None:
        starts = self.task.config.starts
        if not starts:
            return None
        position = np.array([s.position_mm for s in starts])
        aim = np.array([s.look_at_mm for s in starts]) - position
        roll = np.radians([s.roll_deg for s in starts])
        middle = float(np.mean(lens.d_mm))
        one = np.ones(len(starts))
        return Views(
            camera_rotation(aim, roll),
            position,
            np.array([s.d_mm or middle for s in starts]),
            float(np.mean(lens.f_mm)) * one,
            float(np.mean(lens.a_mm)) * one,
            lens.e_mm * one,
        )


def _middle(ends_mm: tuple[float, float]) -> float:
    """Where what the zoom changes beside f is taken while f is free."""
    return float(np.sqrt(ends_mm[0] * ends_mm[1]))


def _common(
    have: tuple[float, float], wanted: float | tuple[float, float] | None
) -> tuple[float, float] | None:
    """What two ranges share; None when nothing."""
    if wanted is None:
        return have
    low, high = bounds(wanted)
    low, high = max(low, have[0]), min(high, have[1])
    return (low, high) if low <= high else None


def _range(wanted: float | tuple[float, float] | None) -> tuple[float, float] | None:
    return wanted if isinstance(wanted, tuple) and wanted[0] < wanted[1] else None
