"""Reach: can the arm take a view, and how far is it from a joint limit?

Not smooth (branches of the arm), so it filters candidates and is reported as a margin;
it has no rows for the optimiser.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from mvp.kinematics import camera_rotation

if TYPE_CHECKING:
    from mvp.geometry import BoolArray, FloatArray, Pose
    from mvp.kinematics import ArmModel
    from mvp.optics import Views

KIND: Literal["reach"] = "reach"
UNIT = "deg"
_AT_ONCE = 12_000
_MM_PER_DEGREE = 10.0


@dataclass(frozen=True, eq=False)
class Reach:
    """The arm, and how camera and part sit in its cell.

    Attributes:
        model: the arm.
        base_from_part: the part's pose.
        tool_from_camera: hand-eye at ``reference_d_mm``.
        reference_d_mm: None: the pupil is taken not to move with d.
        joint_margin: (dof,) slack asked of the joint limits, rad or mm.
        rolls: how many rolls are tried; 0 keeps the roll of every view.
    """

    model: ArmModel
    base_from_part: Pose
    tool_from_camera: Pose
    reference_d_mm: float | None
    joint_margin: FloatArray
    rolls: int = 24

    def margins_deg(self, views: Views) -> FloatArray:
        """Best slack (N,) over rolls and branches beyond the joint margin.

        -inf where there is no branch at all. Sliding axes count 10 mm as one degree.
        """
        return self._best(views, np.arange(max(self.rolls, 1), dtype=np.float64))

    def reachable(self, views: Views) -> BoolArray:
        """Which views (N,) the arm can take at some roll."""
        order = _spread(max(self.rolls, 1))
        few, rest = order[: len(order) // 4 + 1], order[len(order) // 4 + 1 :]
        found = self._best(views, few) >= 0
        left = np.flatnonzero(~found)
        if len(left) and len(rest):
            found[left] = self._best(views[left], rest) >= 0
        return found

    def _best(self, views: Views, which: FloatArray) -> FloatArray:
        chunk = max(1, _AT_ONCE // len(which))
        parts = [
            self._chunk(views[k : k + chunk], which)
            for k in range(0, len(views), chunk)
        ]
        return np.concatenate([np.zeros(0), *parts])

    def _chunk(self, views: Views, which: FloatArray) -> FloatArray:
        tools, flange = self._flange(views, which)
        n, m = tools.shape[:2]
        joints, exists = self.model.inverse_batch(
            tools.reshape(n * m, 3, 3), flange.reshape(n * m, 3)
        )
        best = np.full(exists.shape, -np.inf)
        slack = self.model.margins(joints[exists])
        slack[:, : self.model.dof] -= self.joint_margin
        units = np.array(
            [
                np.degrees(1.0) if u == "rad" else 1 / _MM_PER_DEGREE
                for u in self.model.margin_units
            ]
        )
        best[exists] = (slack * units).min(axis=1)
        return np.asarray(best.reshape(n, -1).max(axis=1))

    def _flange(self, views: Views, which: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Flange rotations (N, M, 3, 3) and points (N, M, 3), base frame."""
        asked = views.rotation[:, None]
        if self.rolls:
            turn = which * (2 * np.pi / self.rolls)
            asked = camera_rotation(views.direction[:, None], turn[None])
        part, hand = self.base_from_part, self.tool_from_camera
        cameras = part.rotation @ asked
        axis = part.rotate(views.direction)
        given = self.model.camera_rotations(axis, cameras, hand.rotation)
        moved = np.zeros(len(views))
        if self.reference_d_mm is not None:
            moved = views.d_mm - self.reference_d_mm
        pupil = part.apply(views.position_mm) - moved[:, None] * axis
        tools = given @ hand.rotation.T
        return tools, pupil[:, None] - tools @ hand.translation_mm


def _spread(count: int) -> FloatArray:
    """0 .. count - 1 so that every beginning is spread over the circle."""
    return np.argsort((np.arange(count) * 0.6180339887498949) % 1.0).astype(np.float64)
