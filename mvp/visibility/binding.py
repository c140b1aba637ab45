"""Why a region is small: which faces take the most view points away."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from mvp.geometry import FeaturePiece, sobol_points
from mvp.visibility.culling import OwnFaces, feature_samples

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.geometry import Box, Facing, FloatArray
    from mvp.visibility.occluders import Occluders

_VIEWPOINTS = 512
_NAMED = 3
_ASKED = 16

FaceName: TypeAlias = Callable[[int], str]
"""How to call a face id of the scene."""


@dataclass(frozen=True, eq=False)
class Binding:
    """What stands between a feature piece and the view points of a workspace.

    Shares are estimates over 512 evenly spread view points and a few points of the
    feature; the first face met from the feature is the one that is named.

    Attributes:
        occluders: the scene.
        feature_mm: (n, 3) the feature piece.
        own: its own faces.
        workspace: where view points are looked for.
    """

    occluders: Occluders
    feature_mm: FloatArray
    own: OwnFaces
    workspace: Box

    @cached_property
    def _viewpoints(self) -> FloatArray:
        sequence = sobol_points(3, _VIEWPOINTS)
        inside = self.workspace.low_mm + sequence * self.workspace.size_mm
        return np.asarray(inside)

    @cached_property
    def own_faces_share(self) -> float:
        """Share of the workspace that the feature's own faces hide."""
        return float(self.own.hides(self._viewpoints).mean())

    @cached_property
    def face_shares(self) -> dict[int, float]:
        """Share of the workspace that each face id hides, largest first."""
        points = self._viewpoints[~self.own.hides(self._viewpoints)]
        samples = feature_samples(self.feature_mm)[:3]
        gap = 2e-5 * self.occluders.extent_mm
        hits: list[tuple[int, int]] = []
        for sample in samples:
            away = points - sample
            length = np.linalg.norm(away, axis=1, keepdims=True)
            start = sample + gap * away / np.maximum(length, 1e-300)
            hit = self.occluders.rays.first_hit(start, points)
            rows = np.flatnonzero(hit >= 0)
            ids = self.occluders.face_ids[hit[rows]]
            hits += zip(rows.tolist(), ids.tolist(), strict=True)
        ids, counts = np.unique([i for _, i in set(hits)], return_counts=True)
        order = np.argsort(-counts, kind="stable")
        total = len(self._viewpoints)
        return {int(ids[i]): float(counts[i]) / total for i in order}

    @property
    def piece(self) -> FeaturePiece:
        """The feature piece with its own faces."""
        facing: Facing = "any" if self.own.any_suffices else "all"
        return FeaturePiece(self.feature_mm, self.own.planes, facing)


def in_the_way(bindings: Sequence[Binding], name_face: FaceName) -> str:
    """What takes most view points from some feature pieces, in words for a report.

    Args:
        bindings: of the pieces; of very many, evenly chosen ones answer for all.
        name_face: how to call a face id of the scene.
    """
    chosen = bindings[:: len(bindings) // _ASKED + 1]
    own = max((binding.own_faces_share for binding in chosen), default=0.0)
    shares: dict[int, float] = {}
    for binding in chosen:
        for face, share in binding.face_shares.items():
            shares[face] = max(share, shares.get(face, 0.0))
    worst = sorted(shares, key=lambda face: -shares[face])[:_NAMED]
    names = ", ".join(f"{name_face(face)} ({shares[face]:.0%})" for face in worst)
    parts = [f"blocked by {names}"] if names else []
    if own > 0:
        parts.append(f"its own faces hide {own:.0%}")
    return ", ".join(parts) or "nothing is in the way"
