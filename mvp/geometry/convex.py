"""Convex pieces of features: what must be seen whole, and the faces it belongs to."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np

from mvp.geometry.arrays import FloatArray, as_points

Facing: TypeAlias = Literal["any", "all"]


@dataclass(frozen=True, eq=False)
class FeaturePiece:
    """A convex piece that must be seen whole.

    Attributes:
        vertices_mm: (n, 3): a point, a segment, or a convex planar polygon in order.
        planes: (k, 4) rows (n, o) of the own faces, n the outward unit normal and
            n . x = o on the face. The viewpoint x faces one when n . x > o.
        facing: ``"any"``: one facing plane suffices (convex edge); ``"all"``: every
            plane must face (reflex edge, face, hole mouth). No planes: no such rule,
            and every triangle occludes from both sides.
        mouth: of a hole: where something stands in it, its rim alone must be seen.
    """

    vertices_mm: FloatArray
    planes: FloatArray = field(default_factory=lambda: np.zeros((0, 4)))
    facing: Facing = "all"
    mouth: bool = False

    def __post_init__(self) -> None:
        vertices = np.array(as_points(self.vertices_mm, name="vertices_mm"))
        planes = np.array(self.planes, dtype=np.float64).reshape(-1, 4)
        object.__setattr__(self, "vertices_mm", vertices.reshape(-1, 3))
        object.__setattr__(self, "planes", planes)
