"""Everything that must hold before the first motion: limits, paths, disk."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from mvp.cell.arrival import arrival_tolerance
from mvp.errors import InfeasibleError, UsageError
from mvp.kinematics import NoPath, find_path

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.cell.arm_setup import ArmSetup
    from mvp.cell.engine import CellDevices
    from mvp.geometry import FloatArray
    from mvp.planning.plan import PlannedView


def check_limits(
    devices: CellDevices, views: Sequence[PlannedView], exposure_s: float | None
) -> None:
    """Ask every device whether it could do its part of every view. Moves nothing.

    Raises:
        LimitError: it could not.
        UsageError: an exposure outside of the camera's range.
    """
    for view in views:
        devices.arm.check_joints(view.joints_rad)
        steps = view.lens_steps
        devices.lens.check_steps(zoom=steps.zoom, focus=steps.focus, iris=steps.iris)
    low, high = devices.camera.exposure_range_s()
    if exposure_s is not None and not low <= exposure_s <= high:
        raise UsageError(
            f"the task's exposure of {exposure_s:g} s is outside of the camera's range",
            hint=f"choose exposure.exposure_s between {low:g} and {high:g}",
            where="camera",
        )


@dataclass(frozen=True, eq=False)
class Routes:
    """Clear joint paths, found before the run and reused while the arm is on them."""

    arm: ArmSetup
    _known: dict[str, FloatArray] = field(default_factory=dict)

    def check_all(self, start: Sequence[float], views: Sequence[PlannedView]) -> None:
        """Find a path to every view from where the arm stands, in order.

        Raises:
            InfeasibleError: everything that was tried touches something.
        """
        here = start
        for view in views:
            self.find(here, view)
            here = view.joints_rad

    def find(self, start: Sequence[float], view: PlannedView) -> FloatArray:
        """Waypoints (k, dof) to a view, without the start.

        A path found earlier is used again only from the same start; a person may have
        moved the arm during a pause.

        Raises:
            InfeasibleError: everything that was tried touches something.
        """
        here = np.asarray(start, dtype=np.float64)
        known = self._known.get(view.id)
        near = arrival_tolerance(self.arm.cell.arm.joint_units)
        if known is not None and (np.abs(known[0] - here) <= near).all():
            return np.asarray(known[1:])
        path = find_path(
            self.arm.bodies,
            here,
            np.asarray(view.joints_rad, dtype=np.float64),
            home=np.asarray(self.arm.cell.home_joints, np.float64),
            required_mm=self.arm.clearance_mm,
        )
        if isinstance(path, NoPath):
            raise InfeasibleError(
                f"no clear way for the arm to {view.id}: {path.reason}",
                hint="move the arm by hand to a free place, or give it more room",
                where=view.id,
            )
        self._known[view.id] = path.waypoints
        return np.asarray(path.waypoints[1:])
