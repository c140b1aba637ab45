"""Features that no place sees: named one by one with what hides them."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np
import pytest

from mvp.cell.unseen import unseen
from mvp.geometry import Box, TriangleMesh, box_mesh
from mvp.scene import EdgeFeature, edge_feature
from mvp.visibility import Occluders, Region, intersection, prepare, visibility_region

if TYPE_CHECKING:
    from mvp.cell.plan_problem import ProblemFactory
    from mvp.scene import Feature

ABOVE = Box(np.array([-50.0, -50.0, 10.0]), np.array([50.0, 50.0, 60.0]))


class Sight:
    """The little of a problem factory that the question needs."""

    def __init__(self, mesh: TriangleMesh, box: Box) -> None:
        self.occluders: Occluders = prepare(mesh)
        self.box = box

    def region(self, feature: Feature) -> Region:
        return visibility_region(self.occluders, feature.sight_pieces(), self.box)

    def face_name(self, face_id: int) -> str:
        return f"face {face_id} of block"


@pytest.fixture(scope="module")
def block() -> TriangleMesh:
    return box_mesh(Box(np.full(3, -5.0), np.full(3, 5.0)), name="block")


@pytest.fixture(scope="module")
def edges(block: TriangleMesh) -> dict[str, EdgeFeature]:
    return {
        "top": edge_feature("top", (-5, -5, 5), (5, -5, 5), block),
        "bottom": edge_feature("bottom", (-5, -5, -5), (5, -5, -5), block),
        "back": edge_feature("back", (-5, 5, -5), (5, 5, -5), block),
    }


def asked(
    block: TriangleMesh, features: list[EdgeFeature], box: Box = ABOVE
) -> tuple[str, str] | None:
    sight = Sight(block, box)
    region = intersection([sight.region(f) for f in features])
    found = unseen(cast("ProblemFactory", sight), features, region)
    return None if found is None else (found.reason, found.fix)


def test_features_that_are_seen_need_no_words(
    block: TriangleMesh, edges: dict[str, EdgeFeature]
) -> None:
    assert asked(block, [edges["top"]]) is None


def test_only_the_feature_that_is_seen_from_nowhere_is_named(
    block: TriangleMesh, edges: dict[str, EdgeFeature]
) -> None:
    low = Box(np.array([-4.0, -4.0, 10.0]), np.array([4.0, 4.0, 60.0]))
    found = asked(block, [edges["top"], edges["bottom"]], low)
    assert found is not None
    reason, fix = found
    assert reason.startswith("bottom is seen from nowhere: ")
    assert "%" in reason
    assert "split" not in fix


def test_features_without_a_common_place_are_named_with_what_hides_each(
    block: TriangleMesh, edges: dict[str, EdgeFeature]
) -> None:
    below = Box(np.array([-50.0, -50.0, -4.0]), np.array([50.0, 50.0, 4.0]))
    found = asked(block, [edges["bottom"], edges["back"]], below)
    assert found is not None
    reason, _ = found
    assert reason.startswith("bottom and back are seen whole from no common place: ")
    assert "bottom: " in reason
    assert "; back: " in reason
    assert reason.count("%") >= 2
