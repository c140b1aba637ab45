"""Prints on planes: looked up by plane coordinates, averaged over the pixel.

The picture of a print needs no rays: each joint sample shifts the lookup by the same
part of a pixel everywhere, by the pupil in proportion to the local blur.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np
from scipy.fft import fftfreq, irfft2, next_fast_len, rfft2, rfftfreq

from mvp.imaging.diffraction import airy_transfer
from mvp.imaging.print_lookup import averaged_lookup

if TYPE_CHECKING:
    from mvp.geometry import BoolArray, FloatArray, IntArray, Pose
    from mvp.imaging.light import Float32Array
    from mvp.imaging.pupil import JointSamples
    from mvp.imaging.render_body import PlanarTexture, RenderBody
    from mvp.imaging.render_view import CameraView

_PARALLEL = 1e-3
_RINGS = 12.0


def print_albedo(
    view: CameraView, triangles: IntArray, points: Float32Array
) -> Float32Array:
    """Factor (n,) that the prints put on the grey of single points (camera frame)."""
    factor = np.ones(len(triangles), dtype=np.float32)
    for number, body in enumerate(view.scene.bodies):
        if body.texture is None:
            continue
        printed = np.flatnonzero(printed_triangles(view, number)[triangles])
        texels = _texels(view, body, body.texture, points[printed])
        factor[printed] = _lookup(body.texture.albedo, texels[:, 0], texels[:, 1])
    return factor


def printed_triangles(view: CameraView, number: int) -> BoolArray:
    """(m + 1,) which triangles carry the print of one body; the last is "none"."""
    body, scene = view.scene.bodies[number], view.scene
    printed = np.zeros(len(scene.mesh.faces) + 1, dtype=bool)
    if body.texture is None:
        return printed
    own = np.flatnonzero(scene.body_of_triangle == number)
    frame = body.texture.mesh_from_texture.inverse()
    corners = frame.apply(body.mesh.triangles_mm)
    tolerance = _PARALLEL * body.texture.mm_per_texel + 1e-6
    printed[own] = (np.abs(corners[..., 2]) < tolerance).all(axis=1)
    return printed


def _texture_from_camera(
    view: CameraView, body: RenderBody
) -> tuple[FloatArray, FloatArray]:
    """Rotation and translation from the camera frame to the print's frame."""
    pose = view.world_from_camera
    rotation, translation = pose.rotation, pose.translation_mm
    steps: list[Pose] = [] if body.world_from_mesh is None else [body.world_from_mesh]
    if body.texture is not None:
        steps.append(body.texture.mesh_from_texture)
    for step in steps:
        inverse = step.inverse()
        rotation = inverse.rotation @ rotation
        translation = inverse.apply(translation)
    return rotation, translation


def _texels(
    view: CameraView, body: RenderBody, texture: PlanarTexture, points: Float32Array
) -> Float32Array:
    """Texel coordinates (n, 2) of points, integer at texel centres."""
    rotation, translation = _texture_from_camera(view, body)
    plane = points @ rotation[:2].T.astype(np.float32) + translation[:2]
    return np.asarray(plane / texture.mm_per_texel - 0.5, dtype=np.float32)


def _lookup(
    albedo: Float32Array, columns: Float32Array, rows: Float32Array
) -> Float32Array:
    """Bilinear lookup at (n,) or (h, w) texel coordinates, edge texels repeated."""
    shape = columns.shape
    maps = (
        np.atleast_2d(columns).astype(np.float32),
        np.atleast_2d(rows).astype(np.float32),
    )
    # OpenCV takes at most 32767 columns per map.
    if maps[0].shape[1] > 32_000:
        pieces = range(0, maps[0].shape[1], 32_000)
        return np.concatenate(
            [
                _lookup(albedo, columns[p : p + 32_000], rows[p : p + 32_000])
                for p in pieces
            ]
        )
    if maps[0].size == 0:
        return np.zeros(shape, dtype=np.float32)
    found = cv2.remap(
        albedo, *maps, interpolation=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return np.asarray(found, dtype=np.float32).reshape(shape)


def blurred_prints(
    view: CameraView,
    grey: Float32Array,
    samples: JointSamples,
    *,
    diffraction: bool = True,
) -> BoolArray:
    """Multiply the blurred prints into a picture, in place.

    Args:
        view: camera and scene.
        grey: (rows, columns), without the prints.
        samples: of pixel and pupil.
        diffraction: spread the print by the pattern of a round pupil as well.

    Returns:
        (rows, columns) the pixels whose centre shows a print.
    """
    anywhere = np.zeros(view.shape, dtype=bool)
    for number, body in enumerate(view.scene.bodies):
        if body.texture is None:
            continue
        shown = printed_triangles(view, number)[view.triangles]
        anywhere |= shown
        if shown.any():
            _blurred_print(
                view, body, body.texture, shown, grey, samples, diffraction=diffraction
            )
    return anywhere


def _blurred_print(
    view: CameraView,
    body: RenderBody,
    texture: PlanarTexture,
    shown: BoolArray,
    grey: Float32Array,
    samples: JointSamples,
    *,
    diffraction: bool,
) -> None:
    rows, columns = np.flatnonzero(shown.any(axis=1)), np.flatnonzero(shown.any(axis=0))
    crop = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
    texels, blur = _plane_maps(view, body, texture, crop)
    along_y, along_x = (
        np.gradient(texels, axis=(0, 1))
        if min(texels.shape[:2]) > 1
        else (np.zeros_like(texels), np.zeros_like(texels))
    )
    by_pupil = blur[..., None] * np.stack([along_x, along_y])
    pupil = samples.pupil_mm / view.optics.a_mm / view.pitch_mm
    ones = np.ones(len(pupil))
    shares = np.column_stack([ones, samples.pixel_px, pupil]).astype(np.float32)
    ways = np.stack([texels, along_x, along_y, *by_pupil])
    total = averaged_lookup(texture, ways, shares)
    if diffraction:
        total = _diffracted(total, view.optics.airy_unit_mm / view.pitch_mm)
    inside = shown[crop]
    grey[crop][inside] *= total[inside]


def _diffracted(picture: Float32Array, airy_px: FloatArray) -> Float32Array:
    """A picture spread by a round pupil, by its transfer function.

    Args:
        picture: (h, w), averaged over the pixels.
        airy_px: (2,) lambda N_w by the pixel's width and height.
    """
    pad = int(np.ceil(_RINGS * float(airy_px.max()))) + 1
    wide = np.pad(picture, pad, mode="edge")
    shape = [next_fast_len(size) for size in wide.shape]
    across = rfftfreq(shape[1]) * airy_px[0]
    down = fftfreq(shape[0]) * airy_px[1]
    transfer = airy_transfer(np.hypot(across[None], down[:, None])).astype(np.float32)
    spread = irfft2(rfft2(wide, shape) * transfer, shape)
    rows, columns = picture.shape
    return np.asarray(spread[pad : pad + rows, pad : pad + columns], np.float32)


def _plane_maps(
    view: CameraView,
    body: RenderBody,
    texture: PlanarTexture,
    crop: tuple[slice, slice],
) -> tuple[Float32Array, Float32Array]:
    """Texel coordinates (h, w, 2) and signed blur (h, w) mm over a crop."""
    rotation, translation = _texture_from_camera(view, body)
    directions = view.rays.directions[crop].astype(np.float64)
    slope = directions @ rotation[2]
    slope = np.where(np.abs(slope) < 1e-9, 1e-9, slope)
    depth = -translation[2] / slope
    plane = depth[..., None] * (directions @ rotation[:2].T) + translation[:2]
    optics = view.optics
    # The pupil point that sees the sample moves it against the sign of b = a (m - f'/z).
    signed = optics.a_mm * (
        optics.inverse_focus_per_mm * optics.f_cal_mm - optics.f_cal_mm / depth
    )
    texels = plane / texture.mm_per_texel - 0.5
    return texels.astype(np.float32), -signed.astype(np.float32)
