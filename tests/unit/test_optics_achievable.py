"""What a lens reaches, in millimetres, against the table's own settings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mvp.calibrated import LensValidity
from mvp.optics import (
    LensTable,
    MotorAxis,
    achievable_set,
    achievable_words,
    focus_distance_mm,
)

ZOOM = MotorAxis("zoom", np.array([0.0, 1000, 3000]), np.array([8.0, 12.5, 25.0]))
FOCUS = MotorAxis("focus", np.array([0.0, 4000, 8000]), np.array([0.1, 0.6, 1.2]))
IRIS = MotorAxis("iris", np.array([0.0, 600]), np.array([0.5, 4.0]))
LENS = LensTable(ZOOM, FOCUS, IRIS, pupil_offset_mm=2.4)
HELD = LensValidity(zoom_steps=(500, 1000), focus_steps=(0, 4000), iris_steps=(0, 600))


def sharp_mm(zoom: int, focus: int, lens: LensTable = LENS) -> float:
    found = lens.setting(zoom, focus, 300)
    return float(focus_distance_mm(found.d_mm, found.f_mm)) - found.e_mm


@pytest.mark.parametrize("tube_mm", [0.0, 5.0])
def test_ends_of_the_reach_are_those_of_the_motors(tube_mm: float) -> None:
    lens = LENS.with_tube(tube_mm)
    reach = achievable_set(lens)
    assert [zoom.zoom for zoom in reach.zooms] == [0, 1000, 3000]
    for zoom in reach.zooms:
        assert zoom.sharp_near_mm == pytest.approx(sharp_mm(zoom.zoom, 8000, lens))
        assert zoom.sharp_far_mm == pytest.approx(sharp_mm(zoom.zoom, 0, lens))
        assert zoom.d_high_mm == pytest.approx(zoom.f_mm + 1.2 + tube_mm)


def test_only_where_the_table_holds() -> None:
    held = LENS.within(HELD)
    reach = achievable_set(held)
    assert [zoom.zoom for zoom in reach.zooms] == [500, 1000]
    assert reach.zooms[-1].sharp_near_mm == pytest.approx(sharp_mm(1000, 4000))
    words = achievable_words(held)
    assert f"f {reach.zooms[0].f_mm:.2f} to 12.50 mm" in words
    assert "a 0.50 to 4.00 mm" in words
    near, far = reach.zooms[0].sharp_near_mm, sharp_mm(1000, 0)
    assert words.endswith(f"sharp from {near:.0f} mm to {far:.0f} mm")


def test_a_lens_that_reaches_infinity_says_so() -> None:
    far = replace(LENS, focus=replace(FOCUS, values_mm=FOCUS.values_mm - 0.1))
    assert achievable_words(far).endswith("to infinity")
    assert achievable_set(far).zooms[0].sharp_far_mm is None
