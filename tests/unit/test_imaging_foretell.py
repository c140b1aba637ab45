"""What a plan can say beforehand about measuring its pictures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mvp.imaging import ViewExpectation, foretold
from tools.picture_trials import paper_stage


@pytest.fixture(scope="module")
def planned() -> ViewExpectation:
    return paper_stage().planned("V_f", 0.0)[1]


def test_nothing_is_foretold_of_edges_between_corners(planned: ViewExpectation) -> None:
    assert foretold(planned) == ()


def test_an_end_without_a_visible_edge_is_foretold(planned: ViewExpectation) -> None:
    first, *rest = planned.edges
    loose = replace(first, end_neighbours=())
    notes = foretold(replace(planned, edges=(loose, *rest)))
    assert notes == (
        f"{first.name}: an end is marked by no visible edge: the length will not be "
        "measured",
    )
    smooth = replace(loose, open_ends=True)
    assert foretold(replace(planned, edges=(smooth, *rest))) == ()


def test_a_line_close_beside_an_edge_is_foretold_with_its_distance(
    planned: ViewExpectation,
) -> None:
    first, *rest = planned.edges
    away = 1.3 * first.normal
    drawn = planned.drawn
    beside = replace(
        drawn,
        start_px=np.vstack([drawn.start_px, first.start_px + away]),
        end_px=np.vstack([drawn.end_px, first.end_px + away]),
    )
    crowded = replace(first, crowded=True)
    notes = foretold(replace(planned, edges=(crowded, *rest), drawn=beside))
    assert notes == (
        f"{first.name}: another line is 1.3 px beside it: it may not be measurable; ask "
        "for a finer detail to bring the camera nearer",
    )


def test_what_is_left_out_of_an_outline_is_foretold(planned: ViewExpectation) -> None:
    left_out = replace(planned, notes=("F1: 30 of 90 px are curved",))
    assert foretold(left_out) == left_out.notes
