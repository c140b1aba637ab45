"""Straight joint paths: certified clearance along them, and ways round an obstacle."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain, pairwise
from typing import TYPE_CHECKING

import numpy as np

from mvp.geometry import FloatArray, Pose
from mvp.kinematics.clearance import CellBodies, Nearest
from mvp.kinematics.model import inverse
from mvp.kinematics.roundabout import Explorer

if TYPE_CHECKING:
    from collections.abc import Iterator

_RAISE_MM = (100.0, 250.0)
_FIRST_SAMPLES = 16
_PLENTY_MM = 50.0


@dataclass(frozen=True)
class PathClearance:
    """The closest approach along a path.

    Attributes:
        certified_mm: no pair of bodies comes closer than this at any moment; where
            there is plenty of room it is not made sharper than 50 mm. Where a sample
            was found to be too close it is that sample's distance.
        nearest: the closest pair among the samples.
        fraction: where on the path that is, 0 to 1.
        samples: configurations looked at.
    """

    certified_mm: float
    nearest: Nearest
    fraction: float
    samples: int


def segment_clearance(
    bodies: CellBodies,
    start: FloatArray,
    goal: FloatArray,
    *,
    required_mm: float = 0.0,
    resolution_mm: float = 2.0,
) -> PathClearance:
    """Bound the clearance of the straight joint path from start to goal (dof,).

    Halves the path where the bodies are close until between two samples no pair can
    come more than ``resolution_mm`` closer than seen, by the levers of the axes. Stops
    early at a sample closer than ``required_mm``.
    """
    start, goal = np.asarray(start, np.float64), np.asarray(goal, np.float64)
    effort = np.abs(goal - start)
    best = Nearest(bodies.far_mm, "arm", "nothing")
    where, floor, samples = 0.0, np.inf, 0
    half = 0.5 / _FIRST_SAMPLES
    middle = half * (2 * np.arange(_FIRST_SAMPLES) + 1)
    while len(middle):
        pairs = bodies.pairs(start + middle[:, None] * (goal - start))
        samples += len(middle)
        if not pairs.names:
            break
        smallest = pairs.distance_mm.min(axis=1)
        index = int(np.argmin(smallest))
        if smallest[index] < best.distance_mm:
            best, where = pairs.nearest(index), float(middle[index])
        if best.distance_mm < required_mm:
            return PathClearance(best.distance_mm, best, where, samples)
        change = half * pairs.levers @ effort
        bound = (pairs.distance_mm - change).min(axis=1)
        settled = bound >= min(best.distance_mm - resolution_mm, _PLENTY_MM)
        floor = min(floor, float(bound[settled].min(initial=np.inf)))
        half /= 2
        open_middles = middle[~settled]
        middle = np.concatenate([open_middles - half, open_middles + half])
    return PathClearance(min(floor, best.distance_mm), best, where, samples)


@dataclass(frozen=True, eq=False)
class JointPath:
    """A path of straight joint moves.

    Attributes:
        waypoints: (k, dof), from where the arm stands to the goal.
        clearance: the closest approach of the whole path.
        via: what the way round is, in the user's words; empty for a straight move.
    """

    waypoints: FloatArray
    clearance: PathClearance
    via: str = ""


@dataclass(frozen=True)
class NoPath:
    """Every way that was tried touches something."""

    tried: tuple[tuple[str, Nearest], ...]

    @property
    def reason(self) -> str:
        """One sentence with the bodies that collide."""
        ways = [f"{w}: {n.body} against {n.other}" for w, n in self.tried]
        return "no clear path: " + "; ".join(ways)


def find_path(
    bodies: CellBodies,
    start: FloatArray,
    goal: FloatArray,
    *,
    home: FloatArray | None = None,
    required_mm: float = 0.0,
    resolution_mm: float = 2.0,
    seed: int = 0,
) -> JointPath | NoPath:
    """A clear path from start to goal: the simplest of several kinds.

    Straight, through home, over raised points, and at last a search in joint space,
    which finds most ways there are but proves nothing when it finds none.

    Args:
        bodies: the cell.
        start: (dof,) where the arm stands.
        goal: (dof,) where it shall go.
        home: (dof,) a place to pass through, if any.
        required_mm: clearance that every moment must keep.
        resolution_mm: see ``segment_clearance``.
        seed: of the search in joint space.
    """
    ends = _ends(bodies, start, goal, required_mm)
    if ends is not None:
        return ends
    tried: list[tuple[str, Nearest]] = []
    ways = chain(
        _ways(bodies, start, goal, home),
        _searched(bodies, start, goal, required_mm, seed),
    )
    for words, middle in ways:
        waypoints = np.array([start, *middle, goal], dtype=np.float64)
        clearance = _along(bodies, waypoints, required_mm, resolution_mm)
        if clearance.certified_mm >= required_mm:
            return JointPath(waypoints, clearance, words)
        tried.append((words or "straight", clearance.nearest))
    return NoPath(tuple(tried))


def _ends(
    bodies: CellBodies, start: FloatArray, goal: FloatArray, required_mm: float
) -> NoPath | None:
    """No way can help when the start or the goal itself is too close."""
    for words, joints in (("at the start", start), ("at the goal", goal)):
        nearest = bodies.nearest(np.asarray(joints, np.float64))
        if nearest.distance_mm < required_mm:
            return NoPath(((words, nearest),))
    return None


def _searched(
    bodies: CellBodies,
    start: FloatArray,
    goal: FloatArray,
    required_mm: float,
    seed: int,
) -> Iterator[tuple[str, list[FloatArray]]]:
    """The search, begun only when everything simpler has failed."""
    explorer = Explorer(bodies, required_mm, seed=seed)
    way = explorer.way(np.asarray(start, np.float64), np.asarray(goal, np.float64))
    if way is not None:
        yield f"{len(way)} searched points", way


def _ways(
    bodies: CellBodies, start: FloatArray, goal: FloatArray, home: FloatArray | None
) -> list[tuple[str, list[FloatArray]]]:
    """Candidate ways in the order of preference, with their intermediate points."""
    ways: list[tuple[str, list[FloatArray]]] = [("", [])]
    for height in _RAISE_MM:
        up = [raised(bodies, q, height) for q in (start, goal)]
        if up[1] is not None:
            ways.append((f"{height:.0f} mm above the goal", [up[1]]))
        if up[0] is not None and up[1] is not None:
            ways.append((f"{height:.0f} mm above both ends", [up[0], up[1]]))
        if home is not None and up[0] is not None and up[1] is not None:
            ways.append((f"{height:.0f} mm up and home", [up[0], home, up[1]]))
    if home is not None:
        ways.insert(1, ("home", [home]))
    return ways


def raised(
    bodies: CellBodies, joints: FloatArray, height_mm: float
) -> FloatArray | None:
    """The configuration next to ``joints`` with the flange ``height_mm`` higher."""
    pose = bodies.model.forward(np.asarray(joints, np.float64))
    up = np.array([0.0, 0.0, height_mm])
    above = Pose("base", "tool", pose.rotation, pose.translation_mm + up)
    choices = inverse(bodies.model, above, near=joints)
    if not choices:
        return None
    return min(choices, key=lambda q: float(np.abs(q - joints).max()))


def _along(
    bodies: CellBodies,
    waypoints: FloatArray,
    required_mm: float,
    resolution_mm: float,
) -> PathClearance:
    """The worst of the segments of a path; stops at the first that is too close."""
    worst: PathClearance | None = None
    samples = 0
    for start, goal in pairwise(waypoints):
        one = segment_clearance(
            bodies,
            start,
            goal,
            required_mm=required_mm,
            resolution_mm=resolution_mm,
        )
        samples += one.samples
        if worst is None or one.certified_mm < worst.certified_mm:
            worst = one
        if one.certified_mm < required_mm:
            break
    if worst is None:
        raise ValueError("a path has at least two points")
    return PathClearance(worst.certified_mm, worst.nearest, worst.fraction, samples)
