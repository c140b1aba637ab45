"""Where a lens table holds, beside what was measured, in words."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.optics import LensSteps, LensTable, MotorAxis


def narrowed_axes(whole: LensTable, valid: LensTable) -> tuple[MotorAxis, ...]:
    """The motors whose table holds over less than was measured."""
    pairs = zip(_axes(whole), _axes(valid), strict=True)
    return tuple(held for all_, held in pairs if held.range_steps != all_.range_steps)


def _axes(table: LensTable) -> tuple[MotorAxis, MotorAxis, MotorAxis]:
    return table.zoom, table.focus, table.iris


def beyond_words(narrowed: Sequence[MotorAxis], steps: LensSteps) -> tuple[str, str]:
    """Which ranges, and which steps beyond them a view needs."""
    needed: dict[str, int] = {s: getattr(steps, s) for s in ("zoom", "focus", "iris")}
    beyond = [
        (axis, needed[axis.name])
        for axis in narrowed
        if not axis.range_steps[0] <= needed[axis.name] <= axis.range_steps[1]
    ]
    ranges = [
        f"{a.name} steps {a.range_steps[0]} to {a.range_steps[1]}" for a, _ in beyond
    ]
    return ", ".join(ranges), ", ".join(f"{a.name} step {n}" for a, n in beyond)
