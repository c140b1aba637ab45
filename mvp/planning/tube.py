"""Which extension tube a planned d needs, in words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

    from mvp.optics import LensTable


@dataclass(frozen=True)
class TubeAdvice:
    """What must be screwed between lens and camera.

    Attributes:
        tube_mm: length; 0 for none, None when no tube at hand will do.
        text: one sentence; empty when the lens does it alone.
    """

    tube_mm: float | None
    text: str


def tube_needed(
    table: LensTable, *, d_mm: float, f_mm: float, tubes_mm: Iterable[float]
) -> TubeAdvice:
    """Compare a planned d with the bare lens' own range and the tubes in the cell.

    Args:
        table: the lens without any tube.
        d_mm: planned image distance.
        f_mm: planned focal length.
        tubes_mm: lengths at hand.
    """
    lengths = tuple(tubes_mm)
    tube = table.tube_for(d_mm, f_mm, lengths)
    if tube == 0:
        return TubeAdvice(0.0, "")
    low, high = table.d_range_mm(f_mm)
    reach = f"the lens focuses from d = {low:.3f} to {high:.3f} mm at f = {f_mm:.2f} mm"
    if tube is not None:
        needs = f"d = {d_mm:.3f} mm needs the {tube:g} mm extension tube"
        return TubeAdvice(tube, f"{needs}: {reach}")
    if d_mm < low:
        return TubeAdvice(
            None,
            f"d = {d_mm:.3f} mm is below its range and no tube shortens it: {reach}",
        )
    at_hand = ", ".join(f"{length:g}" for length in sorted(lengths)) or "none"
    return TubeAdvice(
        None,
        f"d = {d_mm:.3f} mm needs a tube of about {d_mm - high:.2f} mm or a little "
        f"more; at hand (mm): {at_hand}; {reach}",
    )
