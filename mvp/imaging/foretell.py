"""What a picture will not tell although all goes well: known before it is taken."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mvp.imaging.verify_judge import listed

if TYPE_CHECKING:
    from mvp.imaging.expectation import DrawnEdges, ExpectedEdge, ViewExpectation

# Nearer lines are the edge itself.
_SAME_LINE_PX = 0.4
_PARALLEL = np.cos(np.deg2rad(15.0))


def foretold(expectation: ViewExpectation) -> tuple[str, ...]:
    """What of the features will not be measured, and why."""
    unmarked = tuple(e.name for e in _asked(expectation) if _unmarked(e))
    notes = list(expectation.notes)
    if unmarked:
        notes.append(
            f"{listed(unmarked)}: an end is marked by no visible edge: the length will "
            "not be measured"
        )
    notes += [_beside(e, expectation) for e in expectation.feature_edges if e.crowded]
    notes += [
        f"{rim.feature}: another line is too close beside it to tell them apart"
        for rim in expectation.rims
        if rim.crowded
    ]
    return tuple(notes)


def _asked(expectation: ViewExpectation) -> tuple[ExpectedEdge, ...]:
    return tuple(e for e in expectation.feature_edges if not e.open_ends)


def _unmarked(edge: ExpectedEdge) -> bool:
    return not (edge.start_neighbours and edge.end_neighbours)


def _beside(edge: ExpectedEdge, expectation: ViewExpectation) -> str:
    distance_px = _nearest_line_px(edge, expectation.drawn)
    where = "close" if distance_px is None else f"{distance_px:.1f} px"
    return (
        f"{edge.name}: another line is {where} beside it: it may not be measurable; ask "
        "for a finer detail to bring the camera nearer"
    )


def _nearest_line_px(edge: ExpectedEdge, drawn: DrawnEdges) -> float | None:
    """Smallest distance of a line that runs along beside an edge; None for no such."""
    middle = (edge.start_px + edge.end_px) / 2
    along = drawn.end_px - drawn.start_px
    length = np.maximum(np.linalg.norm(along, axis=1), 1e-9)
    parallel = np.abs(along @ edge.direction) / length > _PARALLEL
    ends = np.stack([drawn.start_px - middle, drawn.end_px - middle])
    places = np.sort(ends @ edge.direction, axis=0)
    low = np.maximum(places[0], -edge.length_px / 2)
    high = np.minimum(places[1], edge.length_px / 2)
    distance = np.abs(ends.mean(axis=0) @ edge.normal)
    near = distance[parallel & (high > low) & (distance > _SAME_LINE_PX)]
    return float(near.min()) if len(near) else None
