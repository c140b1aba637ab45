"""A wizard's bench over a small virtual cell: no cell file, no obstacles but a floor."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mvp.devices import DrivesStraight
from mvp.geometry import Pose
from mvp.kinematics import arm_model, inverse
from mvp.wizard import Refusal, SessionFacts, Shot, Stand, Way

if TYPE_CHECKING:
    from collections.abc import Callable

    from mvp.devices import Frame
    from mvp.geometry import FloatArray, TriangleMesh
    from mvp.kinematics import ArmModel
    from mvp.testing.virtual_cell import VirtualCell

_TIMEOUT_S = 1000.0
_BRIGHT, _WANTED = 99.5, 0.8
_GOOD = (0.6, 0.92)


class VirtualBench:
    """See ``mvp.wizard.Bench``.

    Args:
        cell: its devices are opened and homed here.
        facts: what a wizard is told.
        forbids: says why a camera pose (base frame) is refused; empty: it is not.
    """

    def __init__(
        self,
        cell: VirtualCell,
        facts: SessionFacts,
        forbids: Callable[[Pose], str] = lambda _: "",
    ) -> None:
        self._cell = cell
        self._facts = facts
        self._forbids = forbids
        self._exposure_s = 0.01
        self._model = arm_model(facts.arm_model)
        self.moves: list[FloatArray] = []
        self.refused = 0
        for device in (cell.arm, cell.lens, cell.camera):
            device.open()
        cell.lens.home(timeout_s=_TIMEOUT_S)

    def close(self) -> None:
        """Close the devices."""
        for device in (self._cell.arm, self._cell.lens, self._cell.camera):
            device.close()

    @property
    def facts(self) -> SessionFacts:
        """What is known and believed before the first picture."""
        return self._facts

    @property
    def arm(self) -> ArmModel:
        """Kinematics."""
        return self._model

    @property
    def part(self) -> TriangleMesh:
        """The part, part frame."""
        return self._cell.belief.part

    def rng(self, number: int) -> np.random.Generator:
        """Randomness of the session's seed and a number."""
        return np.random.default_rng([self._facts.seed, number])

    @property
    def drives_straight(self) -> bool:
        """The lens can be driven without a run-up."""
        return isinstance(self._cell.lens, DrivesStraight)

    def standing(self) -> Stand:
        """Where the arm stands now."""
        state = self._cell.arm.state()
        tool = Pose.from_matrix("base", "tool", np.asarray(state.base_from_tool))
        return Stand(np.array(state.joints), tool)

    def joints_for(self, base_from_camera: Pose, *, d_mm: float) -> Stand | Refusal:
        """The branch next to where the arm is, above the floor."""
        why = self._forbids(base_from_camera)
        if why:
            self.refused += 1
            return Refusal(why)
        tool = base_from_camera @ self._facts.tool_from_camera(d_mm).inverse()
        here = self.standing().joints
        found = inverse(self._model, tool, near=here)
        if not found or base_from_camera.translation_mm[2] < 30:
            self.refused += 1
            return Refusal("out of reach")
        nearest = min(found, key=lambda joints: float(np.abs(joints - here).max()))
        return Stand(nearest, self._model.forward(nearest))

    def way_to(self, joints: FloatArray) -> Way | Refusal:
        """Straight there."""
        return Way(np.asarray(joints)[None], 1.0)

    def move(self, joints: FloatArray) -> Stand:
        """Move there."""
        self._cell.arm.move_joints(joints.tolist(), timeout_s=_TIMEOUT_S)
        self.moves.append(joints)
        return self.standing()

    def set_lens(
        self, *, zoom: int, focus: int, iris: int, straight: bool = False
    ) -> None:
        """Set the lens."""
        lens = self._cell.lens
        steps = {"zoom": zoom, "focus": focus, "iris": iris}
        if straight and isinstance(lens, DrivesStraight):
            lens.move_steps_straight(**steps, timeout_s=_TIMEOUT_S)
        else:
            lens.move_steps(**steps, timeout_s=_TIMEOUT_S)

    def shoot(self, exposure_s: float | None = None) -> Shot:
        """One picture; see ``mvp.wizard.Bench``."""
        if exposure_s is not None:
            return self._shot(self._frame(exposure_s))
        while True:
            frame = self._frame(self._exposure_s)
            bright = np.percentile(frame.pixels[::2, ::2], _BRIGHT)
            level = float(bright) / frame.full_scale
            if _GOOD[0] <= level <= _GOOD[1]:
                return self._shot(frame)
            factor = 0.25 if level > 0.98 else _WANTED / max(level, 0.01)
            self._exposure_s = float(np.clip(self._exposure_s * factor, 1e-4, 5.0))

    def _frame(self, exposure_s: float) -> Frame:
        camera, clock = self._cell.camera, self._cell.clock
        camera.configure(exposure_s=exposure_s)
        return camera.capture(not_before_s=clock.now_s(), timeout_s=_TIMEOUT_S)

    def _shot(self, frame: Frame) -> Shot:
        stand = self.standing()
        return Shot(
            frame.pixels,
            frame.full_scale,
            frame.exposure_s,
            frame.gain,
            stand.joints,
            stand.base_from_tool,
            self._cell.lens.state().steps(),
            {"exposure_start": frame.exposure_start_s, "received": frame.received_s},
            settled=True,
            frame_id=frame.frame_id,
        )
