"""Rigid transforms whose frames are checked.

A transform is named ``target_from_source`` and maps coordinates in ``source`` to
coordinates in ``target``; ``a_from_c = a_from_b @ b_from_c`` cancels visibly.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mvp.errors import FrameError
from mvp.geometry.arrays import FloatArray, as_points

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

_ORTHONORMAL = 1e-6


@dataclass(frozen=True, eq=False)
class Pose:
    """``target_from_source``: rotation (3, 3) and translation (3,) in mm."""

    target: str
    source: str
    rotation: FloatArray
    translation_mm: FloatArray

    def __post_init__(self) -> None:
        rotation = np.array(self.rotation, dtype=np.float64)
        translation = np.array(as_points(self.translation_mm, name="translation_mm"))
        if rotation.shape != (3, 3) or translation.shape != (3,):
            raise ValueError("a pose is a (3, 3) rotation and a (3,) translation")
        if (
            not np.allclose(rotation @ rotation.T, np.eye(3), atol=_ORTHONORMAL)
            or np.linalg.det(rotation) < 0
        ):
            raise ValueError(f"{self.target}_from_{self.source} is not a rotation")
        rotation.setflags(write=False)
        translation.setflags(write=False)
        object.__setattr__(self, "rotation", rotation)
        object.__setattr__(self, "translation_mm", translation)

    @classmethod
    def identity(cls, target: str, source: str) -> Pose:
        """Two frames that coincide."""
        return cls(target, source, np.eye(3), np.zeros(3))

    @classmethod
    def from_matrix(cls, target: str, source: str, matrix: ArrayLike) -> Pose:
        """From a homogeneous (4, 4) matrix, translation in mm.

        Raises:
            ValueError: not a rigid transform.
        """
        array = np.asarray(matrix, dtype=np.float64)
        if array.shape != (4, 4) or not np.allclose(array[3], [0, 0, 0, 1]):
            raise ValueError("a homogeneous transform is (4, 4) with last row 0 0 0 1")
        return cls(target, source, array[:3, :3], array[:3, 3])

    @classmethod
    def from_rotvec(
        cls, target: str, source: str, rotvec_rad: ArrayLike, translation_mm: ArrayLike
    ) -> Pose:
        """From a rotation vector (3,) in rad and a translation (3,) in mm."""
        from scipy.spatial.transform import Rotation

        rotation = Rotation.from_rotvec(np.asarray(rotvec_rad, dtype=np.float64))
        return cls(target, source, rotation.as_matrix(), np.asarray(translation_mm))

    @property
    def matrix(self) -> FloatArray:
        """The homogeneous (4, 4) matrix, translation in mm."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.rotation
        matrix[:3, 3] = self.translation_mm
        return matrix

    @property
    def rotvec_rad(self) -> FloatArray:
        """The rotation vector (3,), rad."""
        from scipy.spatial.transform import Rotation

        return np.asarray(Rotation.from_matrix(self.rotation).as_rotvec())

    def __matmul__(self, other: Pose) -> Pose:
        """Chain two transforms.

        Raises:
            FrameError: the inner frames differ.
        """
        if self.source != other.target:
            raise FrameError(
                f"{self.target}_from_{self.source} cannot be followed by "
                f"{other.target}_from_{other.source}"
            )
        return Pose(
            self.target,
            other.source,
            self.rotation @ other.rotation,
            self.rotation @ other.translation_mm + self.translation_mm,
        )

    def inverse(self) -> Pose:
        """``source_from_target``."""
        return Pose(
            self.source,
            self.target,
            self.rotation.T,
            -self.rotation.T @ self.translation_mm,
        )

    def apply(self, points_source: ArrayLike) -> FloatArray:
        """Map points (..., 3) in ``source`` to ``target``, mm."""
        points = as_points(points_source)
        return np.asarray(points @ self.rotation.T + self.translation_mm)

    def rotate(self, vectors_source: ArrayLike) -> FloatArray:
        """Map directions (..., 3) in ``source`` to ``target``."""
        return np.asarray(as_points(vectors_source) @ self.rotation.T)

    def angle_to_rad(self, other: Pose) -> float:
        """Angle of the rotation between two poses of the same frames."""
        from scipy.spatial.transform import Rotation

        between = Rotation.from_matrix(self.rotation.T @ other.rotation)
        return float(between.magnitude())
