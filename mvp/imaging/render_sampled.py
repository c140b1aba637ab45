"""Joint samples of pixel area, pupil and diffraction: the picture by brute force.

Every sample is a ray from a point of the pupil through the point in perfect focus that
belongs to a place within the pixel. Right everywhere, occlusion inside the pupil
included, and slow: about a microsecond per sample.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mvp.imaging.render_texture import print_albedo

if TYPE_CHECKING:
    from mvp.geometry import IntArray
    from mvp.imaging.light import Float32Array
    from mvp.imaging.pupil import JointSamples
    from mvp.imaging.render_view import CameraView

_RAYS_PER_CHUNK = 1_000_000


def sampled_pixels(
    view: CameraView, pixels: IntArray, samples: JointSamples
) -> Float32Array:
    """Grey (n,) of pixels given by flat index (n,): the mean over all samples."""
    grey = np.empty(len(pixels), dtype=np.float32)
    chunk = max(1, _RAYS_PER_CHUNK // len(samples.pixel_px))
    for start in range(0, len(pixels), chunk):
        part = slice(start, start + chunk)
        grey[part] = _chunk(view, pixels[part], samples)
    return grey


def _chunk(view: CameraView, pixels: IntArray, samples: JointSamples) -> Float32Array:
    origins, directions = _rays(view, pixels, samples)
    triangles = view.scene.hit(view.world_from_camera, directions, origins)
    points = _meet(view, triangles, origins, directions)
    grey = view.shade(triangles, points) * print_albedo(view, triangles, points)
    return np.asarray(grey.reshape(len(pixels), -1).mean(axis=1))


def _rays(
    view: CameraView, pixels: IntArray, samples: JointSamples
) -> tuple[Float32Array, Float32Array]:
    """Start points and directions (n * k, 3) in the camera frame."""
    shift = (samples.pixel_px + samples.airy_mm / view.pitch_mm).astype(np.float32)
    count = len(shift)
    chief = view.rays.within(
        np.repeat(pixels, count), np.tile(shift, (len(pixels), 1))
    ).reshape(len(pixels), count, 3)
    tilt = samples.pupil_mm * view.optics.inverse_focus_per_mm
    directions = chief
    directions[..., :2] -= tilt.astype(np.float32)
    origins = np.zeros_like(directions)
    origins[..., :2] = samples.pupil_mm
    return origins.reshape(-1, 3), directions.reshape(-1, 3)


def _meet(
    view: CameraView,
    triangles: IntArray,
    origins: Float32Array,
    directions: Float32Array,
) -> Float32Array:
    """Points (n, 3) where rays meet the planes of the triangles they hit."""
    normals = view.planes.normals[triangles]
    gap = view.planes.offsets_mm[triangles] - np.einsum("nk,nk->n", normals, origins)
    travel = gap / np.einsum("nk,nk->n", normals, directions)
    travel[triangles < 0] = 0
    return np.asarray(origins + travel[:, None] * directions)
