"""Irises that could not be measured are said, with the range that is left."""

from __future__ import annotations

from calibration.lens_table import Measured
from calibration.wizard.lens_irises import Irises


def of(*steps: int) -> dict[int, Measured]:
    return {step: Measured(0.5 + step / 200, 0.01) for step in steps}


def test_all_measured_is_nothing_to_say() -> None:
    assert Irises(of(0, 200, 600), {}).warnings == ()


def test_an_end_that_is_missing_narrows_the_range() -> None:
    (said,) = Irises(of(200, 400, 600), {0: "no usable picture"}).warnings
    assert said == (
        "iris 0 could not be measured (no usable picture): the table holds from iris 200 "
        "to 600, a = 1.50 to 3.50 mm"
    )


def test_one_between_is_interpolated() -> None:
    (said,) = Irises(of(0, 600), {200: "the edges are not blurred"}).warnings
    assert said.endswith("and is interpolated there")
