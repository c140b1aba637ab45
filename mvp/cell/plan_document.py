"""From realised views to the plan as data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mvp.cell.lens_validity import carried_words
from mvp.cell.view_uncertainty import kept_probability
from mvp.planning.chance import failure_probability
from mvp.planning.plan import LensSteps, Margin, NotCovered, PlannedView, Tolerance
from mvp.planning.rows import RowTable
from mvp.planning.sensitivity import sensitivity
from mvp.planning.solution import margins
from mvp.planning.tolerance import certify
from mvp.planning.tube import tube_needed

if TYPE_CHECKING:
    from mvp.cell.plan_problem import ProblemFactory
    from mvp.cell.plan_views import Failed
    from mvp.cell.realise_view import RealisedView
    from mvp.kinematics import ClearanceIndex
    from mvp.planning import KindMargin
    from mvp.planning.plan import KeptProbability
    from mvp.planning.tolerance import Certificate

_THIN_SIGMA = 3.0
_THIN = "standard deviations from failing"


@dataclass(frozen=True, eq=False)
class ViewWriter:
    """Writes views of one task."""

    factory: ProblemFactory

    def planned(self, number: int, realised: RealisedView) -> PlannedView:
        """One view: what will be commanded, and how safe that is."""
        view, problem = realised.view, realised.problem
        table = RowTable.of(problem)
        found = margins(problem, view, table.index(view)[0])
        written: dict[str, Margin] = {
            kind: _margin(m, hard=kind in problem.hard_kinds)
            for kind, m in found.items()
        }
        written |= self._arm_margins(realised)
        pose = realised.arm.part_from_camera
        written["visibility"] = self._sight(written["visibility"], realised)
        exposure = self.factory.task.config.exposure
        return PlannedView(
            id=f"v{number}",
            features=[f.id for f in realised.features],
            part_from_camera=pose.matrix.tolist(),
            base_from_tool=realised.arm.base_from_tool.matrix.tolist(),
            position_mm=_triple(pose.translation_mm),
            view_direction=_triple(pose.rotation[:, 2]),
            roll_rad=realised.arm.roll_rad,
            f_mm=realised.setting.f_mm,
            d_mm=realised.setting.d_mm,
            a_mm=realised.setting.a_mm,
            pupil_offset_mm=realised.setting.e_mm,
            lens_steps=LensSteps(
                zoom=realised.steps.zoom,
                focus=realised.steps.focus,
                iris=realised.steps.iris,
            ),
            joints_rad=[float(j) for j in realised.arm.joints],
            exposure_s=exposure.exposure_s or 0.0,
            margins=written,
            binding=_binding(written),
            tolerance=_tolerance(certify(problem, view)),
            failure_probability=_chance(realised, number),
            probability=self._probability(number, realised),
            sensitivity=sensitivity(problem, view),
            extension_tube_mm=realised.tube_mm or None,
            notes=self._notes(realised, written),
            contrast=realised.contrast.by_feature if realised.contrast else {},
        )

    def _sight(self, margin: Margin, realised: RealisedView) -> Margin:
        """The margin of visibility with the feature and the face that it is about."""
        if margin.unbounded:
            return margin
        pupil_mm = realised.arm.part_from_camera.translation_mm
        row = self.factory.sight_row(realised.features, pupil_mm)
        return margin.model_copy(update={"row": row})

    def _arm_margins(self, realised: RealisedView) -> dict[str, Margin]:
        """What the arm adds: joints are commanded as planned, so reach has no sigmas."""
        reach, nearest = realised.arm.reach, realised.arm.nearest
        index = realised.clearance_index
        asked_mm = self.factory.cell.config.kinematics.clearance_mm
        asked = self.factory.cell.config.kinematics.joint_margin_deg
        if reach.label not in self.factory.cell.arm.joint_names:
            asked = 0.0  # an end of reach is no joint limit
        return {
            "reach": Margin(
                value=reach.value - asked,
                unit=reach.unit,
                normalised=None,
                row=reach.label,
            ),
            "clearance": Margin(
                value=nearest.distance_mm - asked_mm,
                unit="mm",
                normalised=None if index is None else index.sigmas,
                row=_pair(nearest.body, nearest.other, index),
            ),
        }

    def _probability(self, number: int, realised: RealisedView) -> KeptProbability:
        index = realised.clearance_index
        return kept_probability(
            self.factory.cell,
            realised.problem,
            realised.view,
            clearance_sigmas=None if index is None else index.sigmas,
            number=number,
        )

    def _notes(self, realised: RealisedView, written: dict[str, Margin]) -> list[str]:
        notes = [*realised.solution.notes, *realised.repairs]
        optics = self.factory.cell.config.optics
        advice = tube_needed(
            self.factory.table.with_tube(0.0),
            d_mm=realised.setting.d_mm,
            f_mm=realised.setting.f_mm,
            tubes_mm=optics.extension_tubes_mm,
        )
        if advice.text:
            notes.append(advice.text)
        if realised.tube_mm != optics.mounted_tube_mm:
            notes.append(
                f"mount the {realised.tube_mm:g} mm extension tube and set "
                f"optics.mounted_tube_mm = {realised.tube_mm:g} before the run"
            )
        found = self.factory.cell.calibrations
        f_mm = realised.setting.f_mm
        carried = carried_words(found.hand_eye, found.lens_table, f_mm)
        if carried:
            notes.append(carried)
        if realised.path.via:
            notes.append(f"the arm goes round by way of {realised.path.via}")
        if realised.contrast is not None:
            notes += realised.contrast.notes
        region_exact = all(self.factory.region(f).exact for f in realised.features)
        if not region_exact:
            notes.append(
                "the visibility region was simplified on the safe side; the view "
                "itself was checked exactly"
            )
        optical = {k: m for k, m in written.items() if k != "clearance"}
        return with_thin_margin(notes, written[_binding(optical)].normalised)


def with_thin_margin(notes: list[str], weakest: float | None) -> list[str]:
    """Notes, each once, with a warning about the smallest normalised margin.

    The planner's own warning is left out: the margin of the rounded motor steps says
    it with the final number.
    """
    kept = [note for note in dict.fromkeys(notes) if _THIN not in note]
    if weakest is None or weakest >= _THIN_SIGMA:
        return kept
    warning = (
        f"admissible, but only {weakest:.1f} {_THIN}: expect pictures that do not keep "
        "the specification"
    )
    return [*kept, warning]


def not_covered(failed: Failed) -> list[NotCovered]:
    """Every feature of a failed group with its reason and what would help."""
    nearest: dict[str, float | str | list[float]] = {}
    if failed.nearest is not None:
        view = failed.nearest.view
        nearest = {
            "position_mm": [float(v) for v in view.position_mm[0]],
            "view_direction": [float(v) for v in view.direction[0]],
            "d_mm": float(view.d_mm[0]),
            "smallest_index": float(failed.nearest.t),
        }
    return [
        NotCovered(feature=f.id, reason=failed.reason, nearest=nearest, fix=failed.fix)
        for f in failed.features
    ]


def _margin(found: KindMargin, *, hard: bool) -> Margin:
    """A hard bound must hold, but no stated error moves it: it has no sigmas."""
    return Margin(
        value=None if found.unbounded else found.value,
        unit=found.unit,
        normalised=None if hard else found.index,
        unbounded=found.unbounded,
        row=found.row,
    )


def _binding(written: dict[str, Margin]) -> str:
    """The requirement with the smallest normalised margin."""
    indexed = {k: m.normalised for k, m in written.items() if m.normalised is not None}
    return min(indexed, key=lambda kind: indexed[kind])


def _tolerance(found: Certificate) -> Tolerance:
    return Tolerance(
        position_mm=found.position_mm,
        angle_deg=float(np.degrees(found.angle_rad)),
        d_mm=found.d_mm,
        method=found.method,
        scale=found.scale,
        position_alone_mm=found.position_alone_mm,
        angle_alone_deg=float(np.degrees(found.angle_alone_rad)),
        d_alone_mm=found.d_alone_mm,
        f_mm=found.f_mm,
        a_mm=found.a_mm,
    )


def _chance(realised: RealisedView, number: int) -> float:
    """The chance of failing as the optimiser drew it, or drawn now.

    It draws for its best solution only, and another one may have been realised.
    """
    drawn = realised.solution.failure_probability
    if drawn is not None:
        return drawn
    rng = np.random.default_rng(number)
    return failure_probability(realised.problem, realised.view, rng)


def _pair(body: str, other: str, index: ClearanceIndex | None) -> str:
    """The nearest pair, and the one that errors bring together first if another."""
    nearest = f"{body} against {other}"
    if index is None or (index.body, index.other) == (body, other):
        return nearest
    return f"{nearest}; in sigmas {index.body} against {index.other}"


def _triple(values: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in values)
    return x, y, z
