"""The virtual camera's picture of a scene through a real lens setting.

``render`` draws linear grey; ``expose`` (sensor_noise) makes the frame of it. Pixels far
from any edge take one ray; what lies within reach of an edge is mixed exactly or
sampled jointly over pixel area, pupil and diffraction.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import cv2
import numpy as np

from mvp.imaging.diffraction import THIRD_RING
from mvp.imaging.light import Illumination
from mvp.imaging.pupil import (
    WAVELENGTH_MM,
    PupilOptics,
    independent_parts,
    joint_samples,
)
from mvp.imaging.render_mix import margin_px, mix_borders, spread_of
from mvp.imaging.render_plain import plain_picture
from mvp.imaging.render_sampled import sampled_pixels
from mvp.imaging.render_scene import RenderScene
from mvp.imaging.render_texture import blurred_prints
from mvp.imaging.render_view import CameraView
from mvp.imaging.render_visible import visible_pieces

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.geometry import BoolArray, IntArray, Pose
    from mvp.imaging.light import Float32Array
    from mvp.imaging.pupil import JointSamples
    from mvp.imaging.render_body import RenderBody
    from mvp.imaging.render_visible import Pieces
    from mvp.optics import Intrinsics


@dataclass(frozen=True)
class RenderQuality:
    """How a picture is drawn.

    Attributes:
        method: "borders" mixes both sides of every border in closed form, free of
            noise; "sampled" draws everything near a border by joint samples, right
            even where a blurred background shows from behind a foreground, and slow.
        edge_samples: joint samples per sampled pixel, a power of 2.
        print_samples: joint samples of a printed target, a power of 2, 4 or more.
        defocus: draw the blur circle.
        diffraction: draw the Airy pattern.
        wavelength_mm: of the light.
    """

    method: Literal["borders", "sampled"] = "borders"
    edge_samples: int = 64
    print_samples: int = 64
    defocus: bool = True
    diffraction: bool = True
    wavelength_mm: float = WAVELENGTH_MM


@dataclass(frozen=True, eq=False)
class RenderedImage:
    """What falls on the sensor.

    Attributes:
        grey: (rows, columns) radiance seen by each pixel, linear, 1 = white at full
            light; not yet dimmed by the aperture.
        brightness: (a / f_cal)^2, the factor to image irradiance.
        view: camera, lens and scene of the picture.
    """

    grey: Float32Array
    brightness: float
    view: CameraView

    @cached_property
    def depth_mm(self) -> Float32Array:
        """(rows, columns) z under each pixel's centre; inf where nothing is hit."""
        return self.view.depth_mm

    @cached_property
    def face_id(self) -> IntArray:
        """(rows, columns) face id, distinct over all bodies; -1 for none."""
        return np.asarray(self.view.scene.face_ids[self.view.triangles])

    @cached_property
    def body_id(self) -> IntArray:
        """(rows, columns) index of the body; -1 for none."""
        return np.asarray(self.view.scene.body_ids[self.view.triangles])


def render(
    bodies: Sequence[RenderBody] | RenderScene,
    world_from_camera: Pose,
    *,
    d_mm: float,
    f_mm: float,
    a_mm: float,
    intrinsics: Intrinsics,
    e_mm: float = 0.0,
    light: Illumination | None = None,
    quality: RenderQuality | None = None,
) -> RenderedImage:
    """Draw one picture; the camera's origin is the entrance pupil.

    Args:
        bodies: the scene; pass a ``RenderScene`` to draw it many times.
        world_from_camera: pose of the camera, z forward.
        d_mm: back nodal point to image plane.
        f_mm: focal length.
        a_mm: entrance pupil diameter.
        e_mm: entrance pupil in front of the front nodal point.
        intrinsics: sensor, principal point, distortion.
        light: standard light when None.
        quality: standard quality when None.
    """
    scene = bodies if isinstance(bodies, RenderScene) else RenderScene(bodies)
    quality = quality or RenderQuality()
    optics = PupilOptics(d_mm, f_mm, a_mm, e_mm, quality.wavelength_mm)
    light = light or Illumination()
    view = CameraView(scene, world_from_camera, optics, intrinsics, light)
    grey = plain_picture(view)
    _prints(view, grey, quality)
    _edges(view, grey, quality)
    return RenderedImage(grey, optics.brightness, view)


def _prints(view: CameraView, grey: Float32Array, quality: RenderQuality) -> None:
    if view.has_prints:
        half = joint_samples(
            quality.print_samples // 2,
            view.optics,
            defocus=quality.defocus,
            diffraction=False,
        )
        samples = independent_parts(half)
        blurred_prints(view, grey, samples, diffraction=quality.diffraction)


def _edges(view: CameraView, grey: Float32Array, quality: RenderQuality) -> None:
    """Borders in closed form; samples where no line of the mesh explains a border."""
    missed = border_pixels(view)
    if quality.method == "borders":
        lens = {"defocus": quality.defocus, "diffraction": quality.diffraction}
        pieces = visible_pieces(view, margin_px(view, **lens))
        strong = pieces.strong()
        near = _drawn(view, pieces)
        mix_borders(view, grey, strong, spread_of(view, strong, **lens), near)
        missed &= ~near
    if missed.any():
        pixels = np.flatnonzero(_grown(missed, _reach_px(view, quality)))
        samples = _samples(view, quality.edge_samples, quality)
        grey.reshape(-1)[pixels] = sampled_pixels(view, pixels, samples)


def _drawn(view: CameraView, pieces: Pieces) -> BoolArray:
    """Pixels within about two pixels of a border piece."""
    mask = np.zeros(view.shape, dtype=np.uint8)
    ends = np.stack([pieces.start_px, pieces.end_px], axis=1)
    limit = 4.0 * max(view.shape)
    corners = np.rint(np.clip(ends, -limit, limit)).astype(np.int32)
    cv2.polylines(mask, list(corners), isClosed=False, color=1, thickness=5)
    return mask > 0


def _samples(view: CameraView, count: int, quality: RenderQuality) -> JointSamples:
    return joint_samples(
        count, view.optics, defocus=quality.defocus, diffraction=quality.diffraction
    )


def border_pixels(view: CameraView) -> BoolArray:
    """(rows, columns) pixels whose neighbour shows another plane."""
    planes = view.plane_ids
    seeds = np.zeros(view.shape, dtype=bool)
    across = planes[:, 1:] != planes[:, :-1]
    down = planes[1:] != planes[:-1]
    seeds[:, 1:] |= across
    seeds[:, :-1] |= across
    seeds[1:] |= down
    seeds[:-1] |= down
    return seeds


def _reach_px(view: CameraView, quality: RenderQuality) -> Float32Array:
    """(rows, columns) how far an edge at this depth spreads."""
    pitch = view.pitch_mm.min()
    reach = np.full(view.shape, 0.5, dtype=np.float32)
    if quality.diffraction:
        reach += THIRD_RING * view.optics.airy_unit_mm / pitch
    if quality.defocus:
        blur = view.optics.blur_mm(view.depth_mm) / (2 * pitch)
        reach += blur.astype(np.float32)
    return reach


def _grown(seeds: BoolArray, reach_px: Float32Array) -> BoolArray:
    """Seeds grown by their own reach, rounded up in a few steps."""
    band = seeds.copy()
    limit = 1.0
    rest = band.copy()
    while rest.any():
        now = rest & (reach_px <= limit)
        if now.any():
            size = 2 * int(np.ceil(limit)) + 1
            disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
            band |= cv2.dilate(now.astype(np.uint8), disc) > 0
        rest &= ~now
        limit = limit * 1.3 + 0.5
        if limit > max(reach_px.shape):
            band[:] = True
            break
    return band
