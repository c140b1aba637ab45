"""What holds for every soup of triangles and every feature."""

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st

from mvp.geometry import Box, FeaturePiece, TriangleMesh
from mvp.visibility import exactly_visible, intersection, prepare, visibility_region

WORKSPACE = Box([-60.0] * 3, [60.0] * 3)
seeds = st.integers(0, 2**32 - 1)
few = settings(max_examples=25, deadline=None)


def soup(rng, count):
    corners = rng.uniform(-40, 40, (count, 1, 3))
    corners = corners + rng.normal(0, rng.choice([3.0, 15.0]), (count, 3, 3))
    faces = np.arange(3 * count).reshape(-1, 3)
    return TriangleMesh(corners.reshape(-1, 3), faces, np.arange(count))


def piece(rng):
    vertices = rng.normal(0, 8, (int(rng.integers(1, 4)), 3))
    return FeaturePiece(vertices)


@few
@given(seeds, st.integers(1, 25))
@example(seed=1143, count=17)  # the tip of a triangle passes through the feature
def test_the_region_agrees_with_the_independent_test(seed, count):
    rng = np.random.default_rng(seed)
    mesh, feature = soup(rng, count), piece(rng)
    region = visibility_region(prepare(mesh), [feature], WORKSPACE)
    points = rng.uniform(-60, 60, (300, 3))
    clear = np.abs(region.signed_distance(points)) > 0.01
    seen = exactly_visible(mesh, [feature], points)
    assert (region.contains(points) == seen)[clear].all()


@few
@given(seeds, st.integers(1, 12))
def test_one_more_triangle_never_adds_a_view_point(seed, count):
    rng = np.random.default_rng(seed)
    mesh, feature = soup(rng, count + 1), piece(rng)
    fewer = TriangleMesh(mesh.vertices_mm, mesh.faces[:-1], mesh.face_ids[:-1])
    more = visibility_region(prepare(mesh), [feature], WORKSPACE)
    less = visibility_region(prepare(fewer), [feature], WORKSPACE)
    assert more.volume_mm3 <= less.volume_mm3 + 1e-3
    assert (more.solid - less.solid).volume() < 1e-2


@few
@given(seeds, st.integers(1, 12))
def test_walking_away_from_a_hidden_point_s_occluder_stays_hidden(seed, count):
    """Behind a hidden point, seen from any point of the feature, all is hidden."""
    rng = np.random.default_rng(seed)
    mesh, feature = soup(rng, count), piece(rng)
    points = rng.uniform(-60, 60, (200, 3))
    hidden = points[~exactly_visible(mesh, [feature], points)]
    share = rng.dirichlet(np.ones(len(feature.vertices_mm)), len(hidden))
    away = hidden - share @ feature.vertices_mm
    farther = hidden + rng.uniform(0, 3, (len(hidden), 1)) * away
    region = visibility_region(prepare(mesh), [feature], WORKSPACE)
    assert not exactly_visible(mesh, [feature], farther).any()
    assert (region.signed_distance(farther) <= 0.01).all()


@few
@given(seeds, st.integers(1, 10))
def test_a_part_of_a_feature_is_seen_from_at_least_where_the_whole_is(seed, count):
    rng = np.random.default_rng(seed)
    mesh = soup(rng, count)
    ends = rng.normal(0, 8, (2, 3))
    occluders = prepare(mesh)
    whole = visibility_region(occluders, [FeaturePiece(ends)], WORKSPACE)
    half = FeaturePiece(np.stack([ends[0], ends.mean(axis=0)]))
    part = visibility_region(occluders, [half], WORKSPACE)
    assert (whole.solid - part.solid).volume() < 1e-2
    both = intersection([whole, part])
    assert abs(both.volume_mm3 - whole.volume_mm3) < 1e-2 + 1e-9 * whole.volume_mm3
