"""Notes of a planned view, each said once."""

from __future__ import annotations

from mvp.cell.plan_document import with_thin_margin


def test_a_thin_margin_is_warned_about_once_with_the_final_number():
    planner = (
        "admissible, but only 2.67 standard deviations from failing: expect pictures "
        "that do not keep the specification"
    )
    notes = with_thin_margin(["mount the tube", planner, "mount the tube"], 2.71)
    assert notes == ["mount the tube", planner.replace("2.67", "2.7")]


def test_a_safe_margin_needs_no_warning():
    assert with_thin_margin(["mount the tube"], 12.0) == ["mount the tube"]
    assert with_thin_margin([], None) == []
