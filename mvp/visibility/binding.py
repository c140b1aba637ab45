"""Why a region is small: which faces take the most view points away."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import qmc

from mvp.visibility.culling import OwnFaces, feature_samples

if TYPE_CHECKING:
    from mvp.geometry import Box, FloatArray
    from mvp.visibility.occluders import Occluders

_VIEWPOINTS_LOG2 = 9
_NAMED = 3


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
        sequence = qmc.Sobol(3, scramble=False).random_base2(_VIEWPOINTS_LOG2)
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
    def words(self) -> str:
        """One sentence for a report."""
        parts = []
        if self.own_faces_share > 0:
            parts.append(f"its own faces hide {self.own_faces_share:.0%}")
        for face, share in list(self.face_shares.items())[:_NAMED]:
            parts.append(f"face {face} hides {share:.0%}")
        return ", ".join(parts) or "nothing is in the way"
