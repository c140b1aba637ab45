"""Faults put into pictures: named right, and none of them passes."""

from __future__ import annotations

import pytest

from tools.confusion_matrix import Outcome, outcome, outcomes
from tools.picture_trials import CAUSE_OF, CLASSES, Stage, paper_stage

FAULTS = tuple(c for c in CLASSES if c != "none")


@pytest.fixture(scope="module")
def stage() -> Stage:
    return paper_stage()


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("seed", [71, 72])
def test_an_injected_fault_is_named_and_does_not_pass(
    stage: Stage, fault: str, seed: int
) -> None:
    found = outcome(stage, fault, seed)
    assert found.verdict != "pass", found
    assert found.cause == CAUSE_OF[fault], found


def test_clean_pictures_with_small_errors_pass(stage: Stage) -> None:
    found = [outcome(stage, "none", seed) for seed in range(500, 520)]
    assert [o for o in found if o.verdict != "pass"] == []


def test_without_a_light_model_a_hidden_feature_still_does_not_pass() -> None:
    blind = paper_stage(light_known=False)
    found = [outcome(blind, "occluder", seed) for seed in (5006, 5002)]
    assert all(o.verdict != "pass" for o in found)
    assert all(o.cause == "occlusion" for o in found)


def _share(results: list[Outcome]) -> float:
    return sum(o.named_right for o in results) / len(results)


@pytest.mark.full
@pytest.mark.timeout(3600)
def test_at_most_two_percent_of_300_clean_views_raise_an_alarm() -> None:
    found = outcomes({"none": 300}, seed=9000)
    assert sum(o.verdict != "pass" for o in found) <= 6


@pytest.mark.full
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("light_known", [True, False])
def test_97_percent_of_the_causes_are_named_right_and_no_fault_passes(
    light_known: bool,
) -> None:
    counts = dict.fromkeys(CLASSES, 31)
    found = outcomes(counts, seed=12000, light_known=light_known)
    assert len(found) >= 246
    assert not [o for o in found if o.fault != "none" and o.verdict == "pass"]
    assert _share(found) >= 0.97
    for fault in CLASSES:
        assert _share([o for o in found if o.fault == fault]) >= 0.9
    for fault in ("over", "under"):
        assert _share([o for o in found if o.fault == fault]) == 1.0
