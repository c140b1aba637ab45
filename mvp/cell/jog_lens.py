"""Jog the lens: in motor steps, or in mm through the lens table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from mvp.errors import LimitError, UsageError
from mvp.kinematics import MountedCamera
from mvp.optics import LensTable

if TYPE_CHECKING:
    from mvp.cell.engine import CellDevices
    from mvp.cell.jog_words import Optical, Steps
    from mvp.cell.plan_job import Setting
    from mvp.cell.standstill import UnderWay
    from mvp.geometry import Pose
    from mvp.optics import LensSetting

LENS_S = 120.0


@dataclass(frozen=True, eq=False)
class JogLens:
    """Moves the motors of one lens.

    Attributes:
        setting: the cell.
        devices: opened.
        under_way: told what is being moved.
    """

    setting: Setting
    devices: CellDevices
    under_way: UnderWay

    def steps(self, command: Steps) -> str:
        """One motor to a step, or by steps; says what was reached.

        Raises:
            UsageError: not homed.
            DeviceError: refused, failed or stopped.
        """
        target = self._homed_steps()
        before = target[command.axis] if command.relative else 0
        target[command.axis] = before + command.steps
        return self._set(target)

    def optical(self, command: Optical) -> str:
        """f, d or a to mm; says what was reached.

        Raises:
            UsageError: not homed, or outside of the table.
            DeviceError: refused, failed or stopped.
        """
        target = self._homed_steps()
        now = self.at(target)
        if now is None:
            raise UsageError(
                "the lens stands outside of its table, where it has no f, d and a",
                hint="give steps first: zoom, focus and iris",
            )
        wanted = {"f": now.f_mm, "d": now.d_mm, "a": now.a_mm}
        wanted[command.quantity] = command.value_mm
        try:
            steps = self._table.steps(wanted["f"], wanted["d"], wanted["a"])
        except ValueError as error:
            raise LimitError(
                str(error), device="lens", hint="nothing has moved"
            ) from error
        return self._set({"zoom": steps.zoom, "focus": steps.focus, "iris": steps.iris})

    def home(self) -> str:
        """To its references; says where it stands."""
        with self.under_way.moving("the lens, homing", LENS_S):
            state = self.devices.lens.home(timeout_s=LENS_S)
        return self.words(state.steps())

    def words(self, steps: dict[str, int]) -> str:
        """Steps, and f, d and a there."""
        at = self.at(steps)
        optical = (
            f"f {at.f_mm:.3f}, d {at.d_mm:.3f}, a {at.a_mm:.3f} mm"
            if at
            else "outside of the lens table"
        )
        motors = ", ".join(f"{axis} {step}" for axis, step in steps.items())
        return f"{motors} steps; {optical}"

    def at(self, steps: dict[str, int]) -> LensSetting | None:
        """f, d and a at these steps; None outside of the table."""
        table = self._table
        inside = all(
            low <= steps[motor.name] <= high
            for motor in (table.zoom, table.focus, table.iris)
            for low, high in [motor.range_steps]
        )
        return table.setting(**steps) if inside else None

    def tool_from_camera(self) -> Pose:
        """Where the camera is on the flange with the lens as it stands now."""
        found = self.setting.cell.calibrations
        setting = self.at(self.devices.lens.state().steps())
        if setting is None:
            return found.tool_from_camera
        mounted = MountedCamera.of(found.camera, found.lens_table, found.hand_eye)
        return mounted.tool_from_camera_at(setting)

    @property
    def _table(self) -> LensTable:
        cell = self.setting.cell
        return LensTable.from_calibration(
            cell.calibrations.lens_table, tube_mm=cell.config.optics.mounted_tube_mm
        )

    def _homed_steps(self) -> dict[str, int]:
        state = self.devices.lens.state()
        if not state.homed:
            raise UsageError("the lens is not homed", hint="say home first")
        return state.steps()

    def _set(self, target: dict[str, int]) -> str:
        with self.under_way.moving("the lens", LENS_S):
            state = self.devices.lens.move_steps(**target, timeout_s=LENS_S)
        return self.words(state.steps())
