"""What a view misses is named requirement by requirement, with the rows it is about."""

from __future__ import annotations

from mvp.cell.plan_views import missed
from mvp.planning import evaluate
from mvp.testing.planning_scenes import race_scene, table_views


def test_every_requirement_that_a_view_misses_is_named_with_all_its_rows():
    problem = race_scene().problem(stricter=40)
    best = evaluate(problem, table_views()["V_f1"])
    text = missed(problem, best)
    rows = text[text.index("(") + 1 : text.index(")")].split("; ")
    assert text.startswith("resolution by ")
    assert rows[0].split(", ")[0] in ("horizontal edge", "vertical edge")
    assert len(rows) == 3
    assert rows[-1].endswith("and 1 more")


def test_several_missed_requirements_are_in_order_of_their_index():
    problem = race_scene().problem()
    best = evaluate(problem, table_views()["V_i1"])
    missing = {k: m for k, m in best.margins.items() if m.index < 0}
    assert len(missing) > 1
    text = missed(problem, best)
    places = [
        text.index(f"{kind.replace('_', ' ')} by ")
        for kind in sorted(missing, key=lambda kind: missing[kind].index)
    ]
    assert places == sorted(places)
    kept = set(best.margins) - set(missing)
    assert not any(f"{kind.replace('_', ' ')} by" in text for kind in kept)
