"""What a wizard's steps look like on a terminal, and what may be typed."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.observations import Observations
from calibration.poses import Poses
from calibration.wizard.coverage import COLUMNS, ROWS, counts_of, coverage
from mvp.cli.wizard_view import TerminalView, covered_lines, parsed
from mvp.errors import UsageError
from mvp.wizard import Allow, Ask, Covered, Forecast


@pytest.mark.parametrize(
    ("step", "said", "understood"),
    [
        (Ask("k", "?", "number", 3.0), "", 3.0),
        (Ask("k", "?", "number"), "2.5", 2.5),
        (Ask("k", "?", "number"), "two", None),
        (Ask("k", "?", "yes-no"), "Yes", True),
        (Ask("k", "?", "yes-no"), "n", False),
        (Ask("k", "?", "yes-no"), "perhaps", None),
        (Ask("k", "?", "choice", choices=("a", "b")), "b", "b"),
        (Ask("k", "?", "choice", choices=("a", "b")), "c", None),
        (Ask("k", "?", "text"), "any words", "any words"),
    ],
)
def test_an_answer_is_understood_as_its_question_wants_it(
    step: Ask, said: str, understood: object
) -> None:
    assert parsed(step, said) == understood


def test_unattended_a_question_without_a_default_is_an_error() -> None:
    view = TerminalView(simulated=True, auto=True, yes=True)
    assert view.answer(Ask("k", "how many?", "number", 3.0)) == 3.0
    with pytest.raises(UsageError, match="how many"):
        view.answer(Ask("k", "how many?", "number"))


def test_unattended_only_simulated_arms_move_unasked() -> None:
    step = Allow("to view 1", 2.0)
    assert TerminalView(simulated=True, auto=True, yes=False).answer(step) is True
    assert TerminalView(simulated=False, auto=True, yes=True).answer(step) is True
    with pytest.raises(UsageError, match="would move"):
        TerminalView(simulated=False, auto=True, yes=False).answer(step)


def test_map_bars_and_forecast_are_drawn() -> None:
    grid = ((0, 1), (9, 0))
    forecast = Forecast("error", 0.2, 0.1, "mm")
    lines = covered_lines(Covered(grid, (("border", 0.5),), forecast))
    assert lines[0] == "    |  ..|"
    assert lines[1] == "    |@@  |"
    assert "border" in lines[2]
    assert lines[2].endswith("#####.....")
    assert "not yet" in lines[3]
    assert (
        "too early" in covered_lines(Covered(forecast=Forecast("e", None, 1, "mm")))[0]
    )


def test_every_point_is_counted_in_its_field() -> None:
    size = (80, 60)
    x, y = np.meshgrid(np.arange(80), np.arange(60))
    pixels = np.stack([x, y], axis=-1).reshape(-1, 2).astype(np.float64)
    assert (counts_of(pixels, size) == 100).all()
    corners = np.array([[-0.5, -0.5], [79.49, 59.49]])
    found = counts_of(corners, size)
    assert found[0, 0] == found[ROWS - 1, COLUMNS - 1] == 1


def test_bars_fill_with_tilts_both_ways_and_with_sizes() -> None:
    pixels = np.array([[10.0, 10.0], [70.0, 50.0]])
    seen = Observations.from_views(
        [np.zeros((2, 3))] * 2, [pixels] * 2, size_px=(80, 60)
    )
    tilt = np.radians(20.0)

    def about_x(angle: float) -> np.ndarray:
        c, s = np.cos(angle), np.sin(angle)
        return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])

    level = Poses(np.stack([np.eye(3)] * 2), np.array([[0, 0, 100.0], [0, 0, 100.0]]))
    bars = dict(coverage(seen, level).bars)
    assert bars["tilt about x"] == bars["tilt about y"] == bars["sizes"] == 0
    rotations = np.stack([about_x(tilt), about_x(-tilt)])
    tilted = Poses(rotations, np.array([[0, 0, 100.0], [0, 0, 150.0]]))
    bars = dict(coverage(seen, tilted).bars)
    assert bars["tilt about x"] == pytest.approx(1.0)
    assert bars["tilt about y"] == pytest.approx(0.0, abs=1e-12)
    assert bars["sizes"] == 1.0
