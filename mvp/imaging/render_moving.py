"""Pictures taken while something moves: the mean of short still pictures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mvp.imaging.render import RenderedImage, RenderQuality, render
from mvp.imaging.render_scene import RenderScene

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.geometry import Pose
    from mvp.imaging.light import Illumination
    from mvp.imaging.render_body import RenderBody
    from mvp.optics import Intrinsics


@dataclass(frozen=True)
class LensState:
    """A lens setting at one instant.

    Attributes:
        d_mm: back nodal point to image plane.
        f_mm: focal length.
        a_mm: entrance pupil diameter.
        e_mm: entrance pupil in front of the front nodal point.
    """

    d_mm: float
    f_mm: float
    a_mm: float
    e_mm: float = 0.0


def render_moving(
    bodies: Sequence[RenderBody] | RenderScene,
    world_from_camera: Sequence[Pose],
    *,
    lens: LensState | Sequence[LensState],
    intrinsics: Intrinsics,
    light: Illumination | None = None,
    quality: RenderQuality | None = None,
) -> RenderedImage:
    """The picture of an exposure during which camera or lens moved.

    Args:
        bodies: the scene.
        world_from_camera: poses at the middles of equal parts of the exposure. An edge
            that moves v px needs about v / 0.7 of them to look smooth.
        lens: one setting, or one per pose.
        intrinsics: sensor, principal point, distortion.
        light: standard light when None.
        quality: standard quality when None.

    Returns:
        Mean grey weighted by brightness; depths and ids are those of the middle pose.

    Raises:
        ValueError: no poses, or another number of lens settings.
    """
    scene = bodies if isinstance(bodies, RenderScene) else RenderScene(bodies)
    poses = list(world_from_camera)
    settings = [lens] * len(poses) if isinstance(lens, LensState) else list(lens)
    if not poses or len(settings) != len(poses):
        raise ValueError(
            "an exposure needs poses, and one lens setting or one per pose"
        )
    images = [
        render(
            scene,
            pose,
            d_mm=state.d_mm,
            f_mm=state.f_mm,
            a_mm=state.a_mm,
            e_mm=state.e_mm,
            intrinsics=intrinsics,
            light=light,
            quality=quality,
        )
        for pose, state in zip(poses, settings, strict=True)
    ]
    return _mean(images)


def _mean(images: list[RenderedImage]) -> RenderedImage:
    if len(images) == 1:
        return images[0]
    brightness = float(np.mean([image.brightness for image in images]))
    total = np.zeros_like(images[0].grey)
    for image in images:
        total += image.grey * np.float32(image.brightness / brightness / len(images))
    return RenderedImage(total, brightness, images[len(images) // 2].view)
