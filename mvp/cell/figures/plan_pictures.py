"""The pictures of a plan: regions with viewpoints, and what each view should show."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mvp.cell.durable import output_error, write_durably
from mvp.cell.figures.scene_picture import SceneParts, Viewpoint, scene_picture
from mvp.cell.light_config import illumination
from mvp.cell.run_folder import encode_png
from mvp.cell.verification import Expectations
from mvp.geometry import Pose
from mvp.imaging import RenderBody, RenderScene, meter_exposure, render

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from numpy.typing import NDArray

    from mvp.cell.plan_job import Setting
    from mvp.imaging import ViewExpectation
    from mvp.planning.plan import Plan, PlannedView

_GREY_PERCENTILE = 98.0
_WHITE = 255
_METERING_STEPS = 3


def write_plan_pictures(setting: Setting, plan: Plan, folder: Path) -> list[Path]:
    """Write ``scene.png``, ``region_<view>.png`` and ``<view>_simulated.png``.

    ``scene.png`` shows the part and every viewpoint; a region picture shows from where
    all features of one view are seen whole; a simulated picture is what the planned
    pose and lens setting would see of the CAD scene, before it is seen.

    Raises:
        OutputError: the folder cannot take them.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise output_error(folder, error) from error
    return list(_pictures(setting, plan, folder))


def _pictures(setting: Setting, plan: Plan, folder: Path) -> Iterator[Path]:
    scene = setting.scene.scene
    viewpoints = [viewpoint(view) for view in plan.views]
    outlines = [line for feature in scene.features for line in feature.outline_mm]
    yield scene_picture(
        SceneParts(scene.part, scene.fixtures, None, outlines, viewpoints),
        folder / "scene.png",
        title="Part, features and planned viewpoints",
    )
    expectations = Expectations(setting)
    bodies = RenderScene([RenderBody(scene.part), *map(RenderBody, scene.fixtures)])
    for view, point in zip(plan.views, viewpoints, strict=True):
        features = [scene.feature(name) for name in view.features]
        region = setting.factory.common_region(features)
        yield scene_picture(
            SceneParts(
                scene.part,
                scene.fixtures,
                region.mesh,
                [line for feature in features for line in feature.outline_mm],
                [point],
            ),
            folder / f"region_{view.id}.png",
            title=f"{view.id}: from where {', '.join(view.features)} are seen whole",
        )
        target = folder / f"{view.id}_simulated.png"
        write_durably(
            target, encode_png(_simulated(setting, bodies, view, expectations.of(view)))
        )
        yield target


def viewpoint(view: PlannedView) -> Viewpoint:
    """Where a planned view stands and looks."""
    return Viewpoint(view.id, np.array(view.position_mm), np.array(view.view_direction))


def _simulated(
    setting: Setting,
    bodies: RenderScene,
    view: PlannedView,
    expectation: ViewExpectation,
) -> NDArray[np.uint8]:
    """The expected picture, exposed on the features as a capture would be."""
    image = render(
        bodies,
        Pose.from_matrix("part", "camera", np.array(view.part_from_camera)),
        d_mm=view.d_mm,
        f_mm=view.f_mm,
        a_mm=view.a_mm,
        e_mm=view.pupil_offset_mm,
        intrinsics=setting.factory.intrinsics_at(view.f_mm),
        light=illumination(setting.cell.config.light),
    )
    white = max(float(np.percentile(image.grey, _GREY_PERCENTILE)), 1e-9)
    share = image.grey / white
    for _ in range(_METERING_STEPS):
        frame = np.asarray(np.clip(share, 0, 1) * _WHITE).astype(np.uint8)
        share = share * meter_exposure(frame, _WHITE, expectation)
    return np.asarray(np.clip(share, 0, 1) * _WHITE).astype(np.uint8)
