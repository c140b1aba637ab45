"""What each picture of a plan must show, how it is exposed, and whether it shows it.

Uses plan, CAD and calibration only; never the truth of a simulated world.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from mvp.cell.engine import Exposure
from mvp.cell.light_config import illumination
from mvp.cell.records import Captured, Verified
from mvp.cell.wording import look_first
from mvp.errors import DeviceFault
from mvp.geometry import Pose
from mvp.imaging import (
    Requirement,
    ViewExpectation,
    ViewTolerance,
    expect_view,
    foretold,
    meter_exposure,
    verify_view,
)
from mvp.scene import CadEdges, cad_edges

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from mvp.cell.plan_job import Setting
    from mvp.cell.records import DeviceRecord
    from mvp.devices import Frame
    from mvp.planning.plan import PlannedView

_FIRST_GUESS_S = 0.01
_METERING_FRAMES = 8
_CLOSE_ENOUGH = 1.25


@dataclass(frozen=True, eq=False)
class Expectations:
    """What every view of a task must show; built once per view."""

    setting: Setting
    _built: dict[str, ViewExpectation] = field(default_factory=dict)

    @cached_property
    def _edges(self) -> CadEdges:
        return cad_edges(self.setting.scene.scene.occluders)

    def of(self, view: PlannedView) -> ViewExpectation:
        """The expectation of one view."""
        if view.id not in self._built:
            self._built[view.id] = self._expect(view)
        return self._built[view.id]

    def foretold(self, view: PlannedView) -> PlannedView:
        """The view with notes about what its picture will not tell."""
        notes = [*view.notes, *foretold(self.of(view))]
        return view.model_copy(update={"notes": list(dict.fromkeys(notes))})

    def _expect(self, view: PlannedView) -> ViewExpectation:
        scene, factory = self.setting.scene, self.setting.factory
        wanted = {
            name: Requirement(need.detail_mm, need.pixels)
            for name, need in scene.requirements.items()
        }
        return expect_view(
            [scene.scene.feature(name) for name in view.features],
            scene.scene.occluders,
            self._edges,
            Pose.from_matrix("part", "camera", np.array(view.part_from_camera)),
            f_mm=view.f_mm,
            d_mm=view.d_mm,
            a_mm=view.a_mm,
            e_mm=view.pupil_offset_mm,
            intrinsics=factory.intrinsics_at(view.f_mm),
            c_mm=factory.c_mm,
            tolerance=self._tolerance(view),
            requirements=wanted,
            light=illumination(self.setting.cell.config.light),
        )

    def _tolerance(self, view: PlannedView) -> ViewTolerance:
        """The cell's stated errors, but no more than the plan is proven to bear."""
        stated = self.setting.cell.config.uncertainty
        proven = view.tolerance
        return ViewTolerance(
            position_mm=min(stated.position_mm, proven.position_mm),
            angle_deg=min(stated.angle_deg, proven.angle_deg),
            d_mm=min(stated.d_mm, proven.d_mm),
        )


@dataclass(frozen=True, eq=False)
class PictureVerifier:
    """Measures in a picture whether the promise was kept.

    Attributes:
        load: the pixels of a recorded picture.
        declared_axes: of the arm, which only a person says where they are.
    """

    expectations: Expectations
    load: Callable[[Captured], NDArray[np.uint8] | NDArray[np.uint16]]
    declared_axes: str = ""

    def __call__(self, view: PlannedView, captured: Captured) -> Verified:
        """From picture, plan and record only."""
        found = verify_view(
            self.load(captured), captured.full_scale, self.expectations.of(view)
        )
        return Verified(
            view=view.id,
            verdict=found.verdict,
            cause=found.cause,
            verification={
                **found.to_json(),
                "check_first": look_first(
                    found.cause, found.check_first, self.declared_axes
                ),
            },
        )


def declared_axes(devices: Sequence[DeviceRecord]) -> str:
    """Axes of the arm that nothing measures, as it said itself; empty for none."""
    told = [one.extra.get("declared_axes", "") for one in devices if one.role == "arm"]
    return "".join(told).removeprefix("none")


@dataclass(frozen=True, eq=False)
class TaskExposure:
    """The exposure a task fixes, or one metered on the features of the view."""

    expectations: Expectations
    exposure_s: float | None
    gain: float
    range_s: tuple[float, float]

    def __call__(
        self, view: PlannedView, shoot: Callable[[float, float], Frame]
    ) -> Exposure:
        """Meter with as many frames as a saturated or dark first one needs.

        Raises:
            DeviceFault: no exposure of the camera suits the light.
        """
        if self.exposure_s is not None:
            return Exposure(self.exposure_s, self.gain, "task")
        expectation = self.expectations.of(view)
        low, high = self.range_s
        exposure_s = float(np.clip(_FIRST_GUESS_S, low, high))
        for _ in range(_METERING_FRAMES):
            frame = shoot(exposure_s, self.gain)
            factor = meter_exposure(frame.pixels, frame.full_scale, expectation)
            better_s = float(np.clip(exposure_s * factor, low, high))
            settled = 1 / _CLOSE_ENOUGH < better_s / exposure_s < _CLOSE_ENOUGH
            exposure_s = better_s
            if settled:
                return Exposure(exposure_s, self.gain, "metered")
        raise DeviceFault(
            "no exposure was found that suits the light on the features",
            device="camera",
            hint="check the light, or give exposure.exposure_s in the task",
        )
