"""A way round obstacles when no simple one is clear: two trees that grow together.

Rapidly-exploring random trees from both ends, with a fixed seed, then shortcuts. Edges
are judged at a few samples; whoever uses the path certifies it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from mvp.geometry import FloatArray
    from mvp.kinematics.clearance import CellBodies

_EDGE_SAMPLES = 8
# Steps and the window are in rad; a sliding axis counts 400 mm as one.
_STEP = 0.35
_MM_PER_RADIAN = 400.0
_BEYOND = 1.2
_SHORTCUTS = 40
_ROOM_MM = 3.0


@dataclass(eq=False)
class _Tree:
    """Configurations and where each was reached from."""

    nodes: list[FloatArray]
    parents: list[int] = field(default_factory=lambda: [-1])

    def nearest(self, point: FloatArray, scale: FloatArray) -> int:
        gaps = (np.array(self.nodes) - point) / scale
        return int(np.argmin((gaps**2).sum(axis=1)))

    def add(self, point: FloatArray, parent: int) -> int:
        self.nodes.append(point)
        self.parents.append(parent)
        return len(self.nodes) - 1

    def back(self, index: int) -> list[FloatArray]:
        """From a node to the root."""
        way = []
        while index >= 0:
            way.append(self.nodes[index])
            index = self.parents[index]
        return way


@dataclass(frozen=True, eq=False)
class Explorer:
    """Searches the joint space of one cell.

    Attributes:
        bodies: the cell.
        required_mm: clearance asked for; a little more is kept while searching.
        attempts: samples drawn before giving up.
        seed: of the samples; the same seed finds the same way.
    """

    bodies: CellBodies
    required_mm: float
    attempts: int = 300
    seed: int = 0

    @property
    def _scale(self) -> FloatArray:
        units = self.bodies.model.joint_units
        return np.array([1.0 if u == "rad" else _MM_PER_RADIAN for u in units])

    def way(self, start: FloatArray, goal: FloatArray) -> list[FloatArray] | None:
        """Waypoints strictly between start and goal, or None."""
        rng = np.random.default_rng(self.seed)
        low, high = self._window(start, goal)
        trees = [_Tree([start]), _Tree([goal])]
        for attempt in range(self.attempts):
            this, other = trees[attempt % 2], trees[1 - attempt % 2]
            new = self._extend(this, rng.uniform(low, high))
            if new is None:
                continue
            met = self._reach(other, this.nodes[new])
            if met is not None:
                whole = this.back(new)[::-1] + other.back(met)[1:]
                whole = whole if attempt % 2 == 0 else whole[::-1]
                return self._shortened(whole, rng)[1:-1]
        return None

    def _window(
        self, start: FloatArray, goal: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """The part of the joint space that is sampled."""
        model, spare = self.bodies.model, _BEYOND * self._scale
        low = np.maximum(model.joint_low, np.minimum(start, goal) - spare)
        return low, np.minimum(model.joint_high, np.maximum(start, goal) + spare)

    def _extend(self, tree: _Tree, target: FloatArray) -> int | None:
        """Grow by one step towards a target."""
        index = tree.nearest(target, self._scale)
        step = (target - tree.nodes[index]) / self._scale
        length = float(np.linalg.norm(step))
        point = tree.nodes[index] + step * min(1.0, _STEP / length) * self._scale
        return tree.add(point, index) if self._clear(tree.nodes[index], point) else None

    def _reach(self, tree: _Tree, target: FloatArray) -> int | None:
        """Grow step by step until the target is met or something is in the way."""
        while True:
            index = self._extend(tree, target)
            if index is None:
                return None
            if np.abs(tree.nodes[index] - target).max() < 1e-12:
                return index

    def _clear(self, a: FloatArray, b: FloatArray) -> bool:
        shares = np.linspace(0, 1, _EDGE_SAMPLES)[1:, None]
        smallest = self.bodies.smallest(a + shares * (b - a))
        return bool((smallest >= self.required_mm + _ROOM_MM).all())

    def _shortened(
        self, way: list[FloatArray], rng: np.random.Generator
    ) -> list[FloatArray]:
        """Leave out waypoints that are not needed."""
        for _ in range(_SHORTCUTS):
            if len(way) <= 2:
                break
            i, j = sorted(rng.choice(len(way), 2, replace=False))
            if j > i + 1 and self._straight(way[i], way[j]):
                way = way[: i + 1] + way[j:]
        return way

    def _straight(self, a: FloatArray, b: FloatArray) -> bool:
        """A long edge, judged piece by piece."""
        pieces = max(1, round(float(np.linalg.norm((b - a) / self._scale)) / _STEP))
        cuts = a + np.linspace(0, 1, pieces + 1)[:, None] * (b - a)
        return all(self._clear(cuts[k], cuts[k + 1]) for k in range(pieces))
