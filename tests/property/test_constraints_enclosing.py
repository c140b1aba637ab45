"""The smallest sphere, by its optimality condition."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls

from mvp.constraints import enclosing_sphere


def is_smallest(points, centre, radius):
    """All inside, and the centre is a mean (weights >= 0) of points on the sphere."""
    distance = np.linalg.norm(points - centre, axis=1)
    assert (distance <= radius * (1 + 1e-9) + 1e-9).all()
    on = points[distance >= radius * (1 - 1e-7) - 1e-9]
    scale = max(radius, 1.0)
    system = np.vstack([(on - centre).T / scale, np.ones(len(on))])
    _, residual = nnls(system, np.array([0.0, 0, 0, 1]))
    return residual < 1e-6


@given(st.integers(0, 2**32 - 1), st.integers(1, 60), st.sampled_from([1, 2, 3]))
@settings(max_examples=150, deadline=None)
def test_no_smaller_sphere_holds_all_points(seed, count, dimensions):
    rng = np.random.default_rng(seed)
    points = np.zeros((count, 3))
    points[:, :dimensions] = rng.normal(0, 40, (count, dimensions)).round(1)
    points += rng.normal(0, 300, 3).round(0)
    assert is_smallest(points, *enclosing_sphere(points))


@given(st.integers(3, 64), st.floats(0.5, 80))
@settings(max_examples=50, deadline=None)
def test_points_of_a_circle_are_held_by_that_circle(count, radius):
    angle = 2 * np.pi * np.arange(count) / count
    points = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1) * radius
    centre, found = enclosing_sphere(points)
    assert found == pytest.approx(radius, rel=1e-9)
    assert np.allclose(centre, 0, atol=1e-9 * radius + 1e-9)


def test_one_point_is_its_own_sphere_and_none_is_refused():
    centre, radius = enclosing_sphere([[1.0, 2, 3]])
    assert np.array_equal(centre, [1, 2, 3])
    assert radius == 0
    with pytest.raises(ValueError, match="at least one"):
        enclosing_sphere(np.zeros((0, 3)))
