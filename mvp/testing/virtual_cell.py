"""A small virtual cell for tests: three devices, one world, a fast clock."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, cast

import numpy as np

from mvp.calibrated import (
    AxisTable,
    CameraCalibration,
    LensTableCalibration,
    Provenance,
    Quality,
)
from mvp.devices import (
    Arm,
    Camera,
    Clock,
    DeviceContext,
    Lens,
    ScaledClock,
    WorldBelief,
    load_driver,
    load_world,
)
from mvp.geometry import Box, Pose, TriangleMesh, box_mesh

if TYPE_CHECKING:
    from collections.abc import Mapping

    from mvp.devices import Device, Role

_START: dict[str, tuple[float, ...]] = {
    "ur5e": tuple(np.radians([0.0, -90.0, 90.0, -90.0, -90.0, 0.0]).tolist()),
    "gantry_xyz_pan_tilt": (0.0, 0.0, 530.0, 0.0, 0.0),
}
_PLACE = {
    "ur5e": (-491.9, -133.3, 60.0),
    "gantry_xyz_pan_tilt": (0.0, 0.0, 60.0),
}


@dataclass(frozen=True, eq=False)
class VirtualCell:
    """What ``virtual_cell`` builds; ``world`` is the truth of the ``virtual`` kind."""

    belief: WorldBelief
    clock: Clock
    context: DeviceContext
    world: object
    arm: Arm
    lens: Lens
    camera: Camera


def block(low_mm: tuple[float, ...], high_mm: tuple[float, ...]) -> TriangleMesh:
    """A closed block between two corners, mm."""
    return box_mesh(Box(np.array(low_mm), np.array(high_mm)), name="block")


def example_belief(
    *,
    width_px: int = 160,
    height_px: int = 128,
    e_mm: float = 0.0,
    arm_model: Literal["ur5e", "gantry_xyz_pan_tilt"] = "ur5e",
) -> WorldBelief:
    """A 60 mm block under an arm at home, seen by a small camera looking down."""
    stamp = Provenance(
        date="2026-01-01", device_serial="", method="example", simulated=True
    )
    good = Quality(verdict="go")
    camera = CameraCalibration(
        schema="mvp-cell/camera/1",
        provenance=stamp,
        quality=good,
        width_px=width_px,
        height_px=height_px,
        pitch_x_um=6400.0 / width_px,
        pitch_y_um=6400.0 / width_px,
        centre_x_px=(width_px - 1) / 2,
        centre_y_px=(height_px - 1) / 2,
    )
    lens = LensTableCalibration(
        schema="mvp-cell/lens-table/1",
        provenance=stamp,
        quality=good,
        zoom_f_mm=_axis(8.0, 25.0, 2000, 20),
        focus_extension_mm=_axis(0.1, 1.2, 4000, 30),
        iris_a_mm=_axis(0.4, 4.0, 400, 6),
        pupil_offset_mm=e_mm,
    )
    return WorldBelief(
        block((-30.0, -30.0, 0.0), (30.0, 30.0, 40.0)),
        (),
        arm_model,
        _START[arm_model],
        camera,
        lens,
        Pose.from_rotvec("tool", "camera", [0.0, 0.0, 0.0], [0.0, 0.0, 90.0]),
        13.0,
        Pose.from_rotvec("base", "part", [0.0, 0.0, 0.0], _PLACE[arm_model]),
    )


def virtual_cell(
    *,
    belief: WorldBelief | None = None,
    settings: Mapping[str, object] | None = None,
    clock_speed: float = 50.0,
) -> VirtualCell:
    """Build world and devices through the registry; nothing is opened.

    Args:
        belief: the cell; the example when None.
        settings: keys of ``[world]``.
        clock_speed: how much faster than the wall.
    """
    belief = belief or example_belief()
    clock = ScaledClock(clock_speed)
    kind = load_world("virtual")
    config = kind.Config.model_validate(dict(settings or {}))
    world = kind.from_config(config, belief, clock=clock)
    context = DeviceContext(clock=clock, world=world)
    return VirtualCell(
        belief,
        clock,
        context,
        world,
        cast("Arm", _device("arm", context)),
        cast("Lens", _device("lens", context)),
        cast("Camera", _device("camera", context)),
    )


def _device(role: Role, context: DeviceContext) -> Device:
    driver = load_driver(f"virtual-{role}", role)
    return driver.from_config(driver.Config(), context, name=role)


def _axis(low: float, high: float, steps: int, backlash: int) -> AxisTable:
    nodes = np.linspace(0, steps, 9)
    return AxisTable(
        steps=nodes.astype(int).tolist(),
        values_mm=np.linspace(low, high, 9).tolist(),
        backlash_steps=backlash,
    )
