"""At which settings a lens is measured, by what its present table and the arm allow.

f follows the zoom and x = d - f the focus, so not every pair is needed: every zoom with
the focus settings that are sharp where the arm can stand, every focus with a zoom.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from calibration.wizard.lookout import target_of
from calibration.wizard.working import pupil_for_depth, sharp_mm
from mvp.calibrated import LensGrid
from mvp.errors import CalibrationError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.geometry import FloatArray
    from mvp.optics import LensSetting
    from mvp.wizard import SessionFacts

Grid: TypeAlias = LensGrid

NODE_LIMIT_PX = 2.5
_FINE = 65
_SAME_SHARE = 0.02
_MOST_OF_A_ZOOM = 3
_DEPTH_SHARE = 0.22
_TILT_DEPTH = 0.09
_LEAST_SQUARES, _FILL = 5.0, 0.5


@dataclass(frozen=True)
class NodePlan:
    """One zoom and focus.

    Attributes:
        zoom: steps.
        focus: steps.
        iris: steps.
        sharp_mm: where it should be sharp.
        tilts: the depth of field allows a tilted target; otherwise frontal and travel.
    """

    zoom: int
    focus: int
    iris: int
    sharp_mm: float
    tilts: bool = True

    @property
    def name(self) -> str:
        """For samples and reports."""
        return f"zoom {self.zoom} focus {self.focus}"

    @property
    def steps(self) -> dict[str, int]:
        """As the bench takes them."""
        return {"zoom": self.zoom, "focus": self.focus, "iris": self.iris}


def plan_nodes(
    facts: SessionFacts, grid: Grid, reach_mm: tuple[float, float]
) -> tuple[NodePlan, ...]:
    """Zoom and focus settings that are sharp within the arm's reach.

    Args:
        facts: with the present table.
        grid: how many.
        reach_mm: nearest and farthest distance at which the arm can see the target.

    Raises:
        CalibrationError: hardly any setting is sharp where the arm can stand.
    """
    zooms = zoom_steps(facts, grid.zooms, grid.f_mm)
    focuses = focus_steps(facts, grid.focuses, zooms, reach_mm)
    plans: list[NodePlan] = []
    for zoom in zooms:
        mine = [f for f in focuses if _sharp_in(facts, zoom, f, reach_mm)]
        plans += [node_at(facts, zoom, focus) for focus in _thinned(mine)]
    missing = set(focuses) - {plan.focus for plan in plans}
    for focus in sorted(missing):
        able = [z for z in zooms if _sharp_in(facts, z, focus, reach_mm)]
        plans += [node_at(facts, zoom, focus) for zoom in able[:1]]
    fewest = min(2, len(zooms))
    if len({p.zoom for p in plans}) < fewest or len({p.focus for p in plans}) < 2:
        raise CalibrationError(
            f"hardly any lens setting is sharp between {reach_mm[0]:.0f} and "
            f"{reach_mm[1]:.0f} mm, where the arm can see the target",
            hint="place the target where the camera can come nearer and go farther",
            where=facts.cell,
        )
    return tuple(sorted(plans, key=lambda plan: (plan.zoom, plan.focus)))


def zoom_steps(
    facts: SessionFacts, count: int, f_mm: float | tuple[float, float] | None = None
) -> list[int]:
    """Both ends of the zoom and equal ratios of f between them; its middle for one.

    Args:
        facts: with the present table.
        count: how many.
        f_mm: the range, or the only one; None: all of the table.

    Raises:
        CalibrationError: the asked focal lengths are not those of the lens.
    """
    axis = facts.table.zoom
    able = axis.range_mm
    ends = f_mm if isinstance(f_mm, tuple) else (f_mm, f_mm) if f_mm else able
    near = np.clip(ends, *able)
    if np.abs(near - ends).max() > _SAME_SHARE * able[0]:
        raise CalibrationError(
            f"f of {ends[0]:g} to {ends[1]:g} mm was asked for, but the present table of "
            f"the lens goes from {able[0]:.4g} to {able[1]:.4g} mm",
            hint="correct f_mm in [lens_calibration] of the cell file, or put a table in "
            "place that goes further: one before, or the data sheet",
            where=facts.cell,
        )
    if count == 1:
        return [axis.nearest_step(float(np.sqrt(near[0] * near[1])))]
    asked = np.geomspace(near[0], near[1], count)
    return sorted({axis.nearest_step(float(f)) for f in asked})


def focus_steps(
    facts: SessionFacts, count: int, zooms: Sequence[int], reach_mm: tuple[float, float]
) -> list[int]:
    """Equal steps of the extension, over all that is sharp in reach at some zoom."""
    axis = facts.table.focus
    first, last = axis.range_steps
    steps = np.unique(np.rint(np.linspace(first, last, _FINE)).astype(int))
    able = [
        int(s)
        for s in steps
        if any(_sharp_in(facts, z, int(s), reach_mm) for z in zooms)
    ]
    if len(able) < 2:
        return able
    low, high = (float(axis.value_mm(able[i])) for i in (0, -1))
    return sorted({axis.nearest_step(float(x)) for x in np.linspace(low, high, count)})


def iris_steps(facts: SessionFacts, count: int) -> list[int]:
    """Both ends of the iris and equal ratios of a between them."""
    axis = facts.table.iris
    low, high = axis.range_mm
    return sorted({axis.nearest_step(float(a)) for a in np.geomspace(low, high, count)})


def node_at(facts: SessionFacts, zoom: int, focus: int) -> NodePlan:
    """A node with the pupil that leaves enough depth of field, if any does."""
    lens = _setting(facts, zoom, focus)
    a = pupil_for_depth(
        facts, lens.f_mm, lens.d_mm, depth_share=_DEPTH_SHARE, limit_px=NODE_LIMIT_PX
    )
    iris = facts.table.iris.nearest_step(a)
    a = float(facts.table.iris.value_mm(iris))
    m = (lens.d_mm - lens.f_mm) / lens.f_mm
    depth = NODE_LIMIT_PX * facts.sensor.pitch_y_mm / (a * m)
    return NodePlan(zoom, focus, iris, sharp_mm(lens), tilts=depth >= _TILT_DEPTH)


def between(steps: Sequence[int]) -> list[int]:
    """Whole steps half-way between neighbours, no nodes; of one step itself."""
    ordered = np.array(sorted(set(steps)))
    if len(ordered) == 1:
        return [int(ordered[0])]
    return [int(s) for s in np.rint((ordered[1:] + ordered[:-1]) / 2)]


def _setting(facts: SessionFacts, zoom: int, focus: int) -> LensSetting:
    iris = facts.table.iris.range_steps[0]
    return facts.table.setting(zoom, focus, iris)


def _sharp_in(
    facts: SessionFacts, zoom: int, focus: int, reach_mm: tuple[float, float]
) -> bool:
    """Sharp in reach, with enough of the target in the picture and large enough."""
    lens = _setting(facts, zoom, focus)
    sharp, target = sharp_mm(lens), target_of(facts)
    sensor = facts.sensor
    sides = sensor.width_px * sensor.pitch_x_mm, sensor.height_px * sensor.pitch_y_mm
    field = min(sides) / lens.d_mm
    near = _LEAST_SQUARES * target.square_mm / field
    far = (min(target.columns, target.rows) - 1) * target.square_mm / (_FILL * field)
    low, high = max(reach_mm[0], near), min(reach_mm[1], far)
    return low <= sharp <= high


def _thinned(steps: list[int]) -> list[int]:
    """The ends and the middle of too many."""
    if len(steps) <= _MOST_OF_A_ZOOM:
        return steps
    keep: FloatArray = np.linspace(0, len(steps) - 1, _MOST_OF_A_ZOOM)
    return [steps[round(float(k))] for k in keep]
