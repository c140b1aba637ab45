"""Where to start: many random views, culled cheaply, the best distinct ones kept."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from mvp.constraints import Visibility
from mvp.geometry import TriangleMesh
from mvp.optics import Views
from mvp.optics.thick_lens import equal_blur_image_distance_mm
from mvp.optics.views import concatenated

if TYPE_CHECKING:
    from mvp.geometry import BoolArray, FloatArray, IntArray
    from mvp.planning.problem import PlanningProblem
    from mvp.planning.rows import RowTable

_CHUNK = 10_000
_ENOUGH = 2_000
_FEW = 200
_KEPT_PER_START, _MEASURED_PER_START = 40, 10
_NEAREST_RADII = 1.3
_DISTINCT = 0.15
_INWARD_MM = (0.5, 100.0)
# Powers of 1/g with g^4 = g + 1, the generalised golden ratio of three dimensions.
_EVEN_STEPS = 1.2207440846057596 ** -np.arange(1.0, 4.0)


@dataclass(frozen=True, eq=False)
class Screened:
    """Candidates inside every region, best first.

    Attributes:
        views: N candidates. ``worst``: (N,) smallest index, descending.
        tried: how many were drawn.
    """

    views: Views
    worst: FloatArray
    tried: int


def screen(
    problem: PlanningProblem, table: RowTable, rng: np.random.Generator
) -> Screened:
    """Draw candidates, keep those inside the visibility region, sort by worst index.

    Where hardly any of them is inside, which says nothing after a short look, views
    just inside the region's walls join them.
    """
    kept: list[FloatArray] = []
    count = tried = 0
    while tried < problem.candidates and count < _ENOUGH:
        size = min(_CHUNK, problem.candidates - tried)
        positions = orbit_positions(problem, size, rng)
        kept.append(positions[inside(problem, positions)])
        count += len(kept[-1])
        tried += size
    views = aimed(problem, np.concatenate([np.zeros((0, 3)), *kept]), rng)
    if count < _FEW:
        views = concatenated([views, from_boundary(problem, rng)])
    measured = max(_FEW, _KEPT_PER_START * problem.starts)
    return ranked(problem, table, views[: 2 * _ENOUGH], tried, measured=measured)


def glance(
    problem: PlanningProblem,
    table: RowTable,
    rng: np.random.Generator,
    within_mm: tuple[float, float],
) -> Screened:
    """``screen`` for few candidates between two distances from the target.

    Distances to the region are measured just as far as the starts need it.
    """
    positions = orbit_positions(problem, problem.candidates, rng, within_mm=within_mm)
    views = aimed(problem, positions[inside(problem, positions)], rng)
    measured = _MEASURED_PER_START * max(problem.starts, 1)
    return ranked(problem, table, views, problem.candidates, measured=measured)


def ranked(
    problem: PlanningProblem,
    table: RowTable,
    views: Views,
    tried: int,
    *,
    measured: int,
) -> Screened:
    """The best views that pass the further filter, by their worst index, descending.

    Distances cost most and only lower an index: only the best ``measured`` views by
    everything else are kept.
    """
    optical = table.curved_index(views)
    best = _first_accepted(problem, views, _descending(optical), measured)
    views, optical = views[best], optical[best]
    if not len(views):
        return Screened(views, np.zeros(0), tried)
    worst = table.worst(table.completed(views, optical))
    order = np.argsort(-worst, kind="stable")
    return Screened(views[order], worst[order], tried)


def _descending(index: FloatArray) -> IntArray:
    """Numbers of views by the smallest index (N, R) of each, largest first."""
    if not index.shape[1]:
        return np.arange(len(index))
    return np.argsort(-index.min(axis=1), kind="stable")


def _first_accepted(
    problem: PlanningProblem, views: Views, order: IntArray, count: int
) -> IntArray:
    """The first ``count`` views in this order that pass the further filter.

    Reach takes longer than everything else, so it is asked for no more than needed.
    """
    kept: list[IntArray] = [order[:0]]
    for start in range(0, len(order), count):
        some = order[start : start + count]
        kept.append(some[problem.accepted(views[some])])
        if sum(map(len, kept)) >= count:
            break
    return np.concatenate(kept)[:count]


def inside(problem: PlanningProblem, points: FloatArray) -> BoolArray:
    """Which points lie inside the search box and every visibility region, (N,)."""
    good = problem.workspace.contains(points)
    for constraint in problem.constraints:
        if isinstance(constraint, Visibility) and good.any():
            good[good] = in_region(constraint, points[good])
    return good


def in_region(constraint: Visibility, points: FloatArray) -> BoolArray:
    """Which points (N, 3) see the features, by the cheapest exact test there is."""
    contains = getattr(constraint.region, "contains", None)
    if callable(contains):
        return np.asarray(contains(points), dtype=bool)
    return np.asarray(constraint.region.signed_distance(points) >= 0)


def orbit_positions(
    problem: PlanningProblem,
    count: int,
    rng: np.random.Generator,
    *,
    within_mm: tuple[float, float] = (0.0, np.inf),
) -> FloatArray:
    """Uniform directions about the target, log-uniform distances, (count, 3) mm.

    Evenly spread in all three together (a shifted Kronecker sequence): no gaps and no
    crowds, so that the best of a few hundred is as good as the best of twice as many
    independent draws.
    """
    spread = (rng.uniform(size=3) + np.arange(count)[:, None] * _EVEN_STEPS) % 1.0
    low, high = _distances_mm(problem, within_mm)
    distance = low * (high / low) ** spread[:, 2]
    height = 1 - 2 * spread[:, 0]
    across = distance * np.sqrt(1 - height**2)
    angle = 2 * np.pi * spread[:, 1]
    offset = np.stack(
        [across * np.cos(angle), across * np.sin(angle), distance * height], axis=1
    )
    return np.asarray(problem.target_centre_mm + offset)


def _distances_mm(
    problem: PlanningProblem, within_mm: tuple[float, float]
) -> tuple[float, float]:
    """From where to where views are drawn; a range that leaves nothing is ignored."""
    low = max(_NEAREST_RADII * problem.target_radius_mm, 2 * problem.lens.f_mm[0])
    high = max(problem.farthest_mm, 2 * low)
    nearest, farthest = max(low, within_mm[0]), min(high, within_mm[1])
    return (nearest, farthest) if nearest < farthest else (low, high)


def from_boundary(problem: PlanningProblem, rng: np.random.Generator) -> Views:
    """Views just inside the walls of the region: finds it however narrow it is."""
    found = []
    for constraint in problem.constraints:
        mesh = getattr(getattr(constraint, "region", None), "mesh", None)
        if isinstance(mesh, TriangleMesh) and len(mesh.faces):
            found.append(_inward(mesh, rng))
    if not found:
        found = [np.zeros((0, 3))]
    points = np.concatenate(found)
    gap = np.linalg.norm(points - problem.target_centre_mm, axis=1)
    points = points[gap > _NEAREST_RADII * problem.target_radius_mm]
    return aimed(problem, _first_inside(problem, points), rng)


def _first_inside(problem: PlanningProblem, points: FloatArray) -> FloatArray:
    """The first points that lie inside, as many as are enough."""
    kept = [np.zeros((0, 3))]
    for start in range(0, len(points), _ENOUGH):
        some = points[start : start + _ENOUGH]
        kept.append(some[inside(problem, some)])
        if sum(map(len, kept)) >= _ENOUGH:
            break
    return np.concatenate(kept)[:_ENOUGH]


def _inward(mesh: TriangleMesh, rng: np.random.Generator) -> FloatArray:
    area = mesh.areas_mm2
    per_face = np.full(len(area), 1.0 / max(len(area), 1))
    chance = (area / area.sum() + per_face) / 2 if area.sum() > 0 else per_face
    face = rng.choice(len(area), size=_CHUNK, p=chance)
    weights = rng.dirichlet(np.ones(3), size=_CHUNK)
    on_face = np.einsum("nk,nkj->nj", weights, mesh.triangles_mm[face])
    depth = _log_uniform(rng, _INWARD_MM, _CHUNK)
    return np.asarray(on_face - mesh.normals[face] * depth[:, None])


def _log_uniform(
    rng: np.random.Generator, bounds: tuple[float, float], count: int
) -> FloatArray:
    low, high = np.log(bounds[0]), np.log(bounds[1])
    return np.asarray(np.exp(rng.uniform(low, high, count)))


def aimed(
    problem: PlanningProblem, positions: FloatArray, rng: np.random.Generator
) -> Views:
    """Views from positions (N, 3) at the target, sharpest common focus, random lens."""
    count = len(positions)
    rotation = looking_at(problem.target_centre_mm, positions)
    if problem.roll_free:
        roll = np.zeros((count, 3))
        roll[:, 2] = rng.uniform(-np.pi, np.pi, count)
        rotation = rotation @ Rotation.from_rotvec(roll).as_matrix()
    lens = problem.lens
    views = Views(
        rotation,
        positions,
        np.full(count, lens.d_mm[0]),
        _log_uniform(rng, lens.f_mm, count),
        _log_uniform(rng, lens.a_mm, count),
        np.full(count, lens.e_mm),
    )
    return focused(problem, views)


def looking_at(target: FloatArray, positions: FloatArray) -> FloatArray:
    """Rotations (N, 3, 3) whose z axis points at the target; roll is arbitrary."""
    n = target - positions
    length = np.linalg.norm(n, axis=1, keepdims=True)
    n = np.where(length > 0, n / np.where(length > 0, length, 1.0), [0.0, 0.0, -1.0])
    helper = np.where(np.abs(n[:, :1]) < 0.9, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    x = np.cross(helper, n)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(n, x), n], axis=2)


def focused(problem: PlanningProblem, views: Views) -> Views:
    """The same views with equal blur at the nearest and the farthest key point."""
    if not len(views) or not problem.lens.d_free:
        return problem.lens.clipped(views)
    depth = views.camera_points(problem.key_points_mm)[..., 2]
    near = np.maximum(depth.min(axis=1), 1.1 * views.f_mm)
    far = np.maximum(depth.max(axis=1), near)
    d = equal_blur_image_distance_mm(near, far, views.f_mm, views.e_mm)
    return problem.lens.clipped(replace(views, d_mm=d))


def distinct(problem: PlanningProblem, screened: Screened, count: int) -> IntArray:
    """Numbers of the best candidates that differ by 15 % of their distance."""
    position = screened.views.position_mm
    reach = np.linalg.norm(position - problem.target_centre_mm, axis=1)
    alive = np.ones(len(position), dtype=bool)
    chosen: list[int] = []
    while len(chosen) < count and alive.any():
        best = int(np.flatnonzero(alive)[0])
        chosen.append(best)
        gap = np.linalg.norm(position - position[best], axis=1)
        alive &= gap > _DISTINCT * reach[best]
    return np.array(chosen, dtype=np.int64)
