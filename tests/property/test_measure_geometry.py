"""Round trips and group laws of alignments, ellipses and registrations."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from mvp.imaging.edge_samples import Line
from mvp.imaging.hole_ellipse import Ellipse, fitted_ellipse
from mvp.imaging.register import Alignment, fit_alignment

alignments = st.builds(
    Alignment,
    st.floats(-40, 40),
    st.floats(-40, 40),
    st.floats(-0.08, 0.08),
    st.floats(0.85, 1.15),
)
POINTS = np.array([[-200.0, 30.0], [10.0, -150.0], [120.0, 90.0], [0.0, 0.0]])


@given(alignments, alignments)
def test_one_alignment_after_another_is_their_product(
    a: Alignment, b: Alignment
) -> None:
    together = a.then(b).apply(POINTS)
    assert np.allclose(together, b.apply(a.apply(POINTS)), atol=1e-8)


OFF_PX = st.floats(-30, 30)


@given(
    alignments,
    st.integers(0, 2**32 - 1),
    st.lists(st.tuples(OFF_PX, OFF_PX), min_size=2, max_size=2),
)
@settings(max_examples=60, deadline=None)
def test_lines_moved_by_a_similarity_give_it_back(
    truth: Alignment, seed: int, off_px: list[tuple[float, float]]
) -> None:
    rng = np.random.default_rng(seed)
    starts, ends = rng.uniform(-200, 200, (2, 14, 2))
    ends = (
        starts + (ends - starts) / np.linalg.norm(ends - starts, axis=1)[:, None] * 60
    )
    expected = [Line(a, b) for a, b in zip(starts, ends, strict=True)]
    small = Alignment(
        truth.shift_x_px / 20, truth.shift_y_px / 20, truth.roll_rad / 20, 1.002
    )
    measured = [small.line(a, b) for a, b in zip(starts, ends, strict=True)]
    # Two edges lock onto something else, anywhere along and across.
    for number, (along, across) in zip((3, 8), off_px, strict=True):
        line = measured[number]
        away = along * line.along + across * line.across
        measured[number] = Line(line.start_px + away, line.end_px + away)
    found = fit_alignment(expected, measured, np.full(14, 0.03)).alignment
    assert np.abs(found.apply(POINTS) - small.apply(POINTS)).max() < 0.15


@given(
    st.floats(10, 200),
    st.floats(0.4, 0.98),
    st.floats(0, 3.1),
    st.floats(-100, 100),
    st.floats(-3, 3),
)
def test_points_beside_an_ellipse_know_their_distance(
    a: float, ratio: float, turn: float, x: float, off: float
) -> None:
    ellipse = Ellipse(x, -x / 2, a, a * ratio, turn)
    angle = np.linspace(0, 2 * np.pi, 50)[:-1]
    inward = a * ratio**2
    away = np.clip(off, -0.5 * inward, 3)
    places = ellipse.points(angle) + away * ellipse.normals(angle)
    nearest = ellipse.nearest(places)
    assert np.abs(ellipse.distance(places, nearest) - away).max() < 1e-3


@given(st.floats(5, 200), st.floats(0.3, 0.97), st.floats(0, 3.1), st.floats(-50, 50))
def test_an_ellipse_is_fitted_from_its_points(
    a: float, ratio: float, turn: float, x: float
) -> None:
    ellipse = Ellipse(x, 3.0, a, a * ratio, turn)
    found = fitted_ellipse(ellipse.points(np.linspace(0, 6, 40)))
    assert np.allclose(found.axes_px, ellipse.axes_px, rtol=1e-6)
    assert np.allclose([found.x_px, found.y_px], [x, 3.0], atol=1e-5)
