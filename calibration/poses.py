"""Many rigid transforms at once, for estimators that work on whole sets of views.

Arrays carry no frame names; say ``target_from_source`` in the name of the variable, or
use ``mvp.geometry.Pose`` for a single transform.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from mvp.geometry import Pose

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.geometry import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Poses:
    """``target_from_source`` of n views: rotation (n, 3, 3), translation (n, 3) mm."""

    rotation: FloatArray
    translation_mm: FloatArray

    def __post_init__(self) -> None:
        count = len(self.rotation)
        if self.rotation.shape != (count, 3, 3) or self.translation_mm.shape != (
            count,
            3,
        ):
            raise ValueError("rotations are (n, 3, 3) and translations (n, 3)")

    @classmethod
    def of(cls, poses: Sequence[Pose]) -> Poses:
        """From single transforms.

        Raises:
            ValueError: none, or their frames differ.
        """
        if len({(pose.target, pose.source) for pose in poses}) != 1:
            raise ValueError("poses of one pair of frames, at least one")
        return cls(
            np.stack([pose.rotation for pose in poses]),
            np.stack([pose.translation_mm for pose in poses]),
        )

    @classmethod
    def from_matrices(cls, matrices: FloatArray) -> Poses:
        """From homogeneous (n, 4, 4) matrices, translation in mm."""
        return cls(matrices[:, :3, :3], matrices[:, :3, 3])

    def __len__(self) -> int:
        return len(self.rotation)

    def __getitem__(self, index: IntArray | BoolArray | slice) -> Poses:
        """Some of them."""
        return Poses(self.rotation[index], self.translation_mm[index])

    def __matmul__(self, other: Poses) -> Poses:
        """Chain one by one; a set of one goes with all of the other."""
        turned = np.einsum("...ij,...j->...i", self.rotation, other.translation_mm)
        return Poses(self.rotation @ other.rotation, turned + self.translation_mm)

    def inverse(self) -> Poses:
        """``source_from_target``."""
        back = np.swapaxes(self.rotation, 1, 2)
        return Poses(back, -np.einsum("nij,nj->ni", back, self.translation_mm))

    def apply(self, points_source_mm: FloatArray) -> FloatArray:
        """Points (n, 3), one for each transform, or (n, k, 3)."""
        if points_source_mm.ndim == 2:
            return self.apply(points_source_mm[:, None])[:, 0]
        turned = points_source_mm @ np.swapaxes(self.rotation, 1, 2)
        return np.asarray(turned + self.translation_mm[:, None])

    def pose(self, index: int, target: str, source: str) -> Pose:
        """One of them, with its frames."""
        return Pose(target, source, self.rotation[index], self.translation_mm[index])

    @property
    def rotvec_rad(self) -> FloatArray:
        """(n, 3) rotation vectors."""
        return np.asarray(Rotation.from_matrix(self.rotation).as_rotvec())


def only(pose: Pose) -> Poses:
    """A set of one."""
    return Poses(pose.rotation[None], pose.translation_mm[None])


def mean_pose(poses: Poses) -> Poses:
    """The mean, as a set of one: rotation by chordal distance, translation by parts."""
    rotation = Rotation.from_matrix(poses.rotation).mean().as_matrix()
    return Poses(rotation[None], poses.translation_mm.mean(axis=0)[None])


def difference(pose: Poses, reference: Poses) -> FloatArray:
    """(n, 6) translation (mm) and rotation vector (rad) from reference to pose.

    Both in target axes: t = t_ref + v and R = exp([w]) R_ref.
    """
    between = pose.rotation @ np.swapaxes(reference.rotation, 1, 2)
    turn = Rotation.from_matrix(between).as_rotvec()
    return np.hstack([pose.translation_mm - reference.translation_mm, turn])
