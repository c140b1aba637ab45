"""Generalized viewpoints, one or many: camera pose plus lens setting.

A view of the paper is V(r, nu; d, f, a); here roll is part of it. The camera's
origin is the entrance pupil; its z axis is the viewing direction nu.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mvp.geometry import BoolArray, FloatArray, IntArray, Pose, as_points
from mvp.optics.thick_lens import focus_distance_mm, principal_distance_mm

_MANY_VIEWS = 100
_FIELDS = ("rotation", "position_mm", "d_mm", "f_mm", "a_mm", "e_mm")


@dataclass(frozen=True, eq=False)
class Views:
    """N views as a structure of arrays; every array has the leading axis N.

    Attributes:
        rotation: (N, 3, 3) part_from_camera; columns are the camera's x, y and nu.
        position_mm: (N, 3) entrance pupil in the part frame.
        d_mm: (N,) back nodal point to image plane.
        f_mm: (N,) focal length.
        a_mm: (N,) entrance pupil diameter.
        e_mm: (N,) entrance pupil in front of the front nodal point (towards the
            object positive).
    """

    rotation: FloatArray
    position_mm: FloatArray
    d_mm: FloatArray
    f_mm: FloatArray
    a_mm: FloatArray
    e_mm: FloatArray

    def __post_init__(self) -> None:
        rotation = np.asarray(self.rotation, dtype=np.float64).reshape(-1, 3, 3)
        position = as_points(self.position_mm, name="position_mm").reshape(-1, 3)
        object.__setattr__(self, "rotation", rotation)
        object.__setattr__(self, "position_mm", position)
        for name in ("d_mm", "f_mm", "a_mm", "e_mm"):
            values = np.array(getattr(self, name), dtype=np.float64)
            if values.shape != (len(position),):
                values = np.array(np.broadcast_to(values, len(position)))
            object.__setattr__(self, name, values)
        if len(rotation) != len(position):
            raise ValueError("rotation and position_mm need the same leading axis")

    def _taken(self, rows: IntArray) -> Views:
        """Rows (k,) of the batch; what was checked once needs no second check."""
        taken = Views.__new__(Views)
        for name in _FIELDS:
            object.__setattr__(taken, name, getattr(self, name)[rows])
        return taken

    def __len__(self) -> int:
        return len(self.position_mm)

    def __getitem__(self, index: slice | BoolArray | IntArray | int) -> Views:
        """A subset, by slice, mask, indices or a single index (kept as N = 1)."""
        keep = np.atleast_1d(np.arange(len(self))[index])
        return self._taken(keep)

    def repeated(self, count: int) -> Views:
        """All views ``count`` times over, one whole batch after the other."""
        return self._taken(np.tile(np.arange(len(self)), count))

    @property
    def direction(self) -> FloatArray:
        """Viewing directions nu, (N, 3)."""
        return self.rotation[:, :, 2]

    @cached_property
    def f_cal_mm(self) -> FloatArray:
        """Principal distance f_cal = d - e (d - f) / f, (N,) mm."""
        return principal_distance_mm(self.d_mm, self.f_mm, self.e_mm)

    @property
    def focus_distance_mm(self) -> FloatArray:
        """D_f = f d / (d - f) from the front nodal point, (N,) mm; inf for d <= f."""
        return focus_distance_mm(self.d_mm, self.f_mm)

    def camera_points(self, points_part: FloatArray) -> FloatArray:
        """Points (M, 3) in every camera's frame, (N, M, 3) mm."""
        if len(self) < _MANY_VIEWS:
            relative = points_part[None] - self.position_mm[:, None]
            return np.asarray(np.matmul(relative, self.rotation))
        # One product with all rotations side by side, a few times faster.
        sideways = self.rotation.transpose(1, 0, 2).reshape(3, -1)
        turned = (points_part @ sideways).reshape(len(points_part), -1, 3)
        origin = np.einsum("nj,njk->nk", self.position_mm, self.rotation)
        return np.asarray((turned - origin).transpose(1, 0, 2))

    def part_from_camera(self, index: int = 0) -> Pose:
        """The pose of one view."""
        return Pose("part", "camera", self.rotation[index], self.position_mm[index])


def single_view(
    part_from_camera: Pose, *, d_mm: float, f_mm: float, a_mm: float, e_mm: float = 0.0
) -> Views:
    """A batch of one."""
    one = np.ones(1)
    return Views(
        part_from_camera.rotation[None],
        part_from_camera.translation_mm[None],
        d_mm * one,
        f_mm * one,
        a_mm * one,
        e_mm * one,
    )


def concatenated(batches: list[Views]) -> Views:
    """One batch of several."""
    return Views(
        np.concatenate([b.rotation for b in batches]),
        np.concatenate([b.position_mm for b in batches]),
        np.concatenate([b.d_mm for b in batches]),
        np.concatenate([b.f_mm for b in batches]),
        np.concatenate([b.a_mm for b in batches]),
        np.concatenate([b.e_mm for b in batches]),
    )
