"""Pixels that are wider than high blur an upright edge more than a level one."""

from __future__ import annotations

import numpy as np
import pytest

from mvp.geometry import Pose, TriangleMesh
from mvp.imaging import Illumination, RenderBody, RenderQuality, render
from mvp.optics import Intrinsics, Sensor
from mvp.optics.thick_lens import signed_blur_mm

SIZE, HEIGHT_MM, Z_MM = 48, 0.005, 300.0
F_MM, D_MM = 12.5, 13.0
FLAT = Illumination(ambient=1.0, lamps=(), gloss=0.0, background=0.0)


def plate(*, upright: bool, edge_mm: float) -> RenderBody:
    """Covers one half of the picture, up to a line through x or y = edge_mm."""
    corners = np.array([[-50, -50], [edge_mm, -50], [edge_mm, 50], [-50, 50.0]])
    if not upright:
        corners = corners[::-1, ::-1]
    vertices = np.column_stack([corners, np.full(4, Z_MM)])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    return RenderBody(TriangleMesh(vertices, faces, np.zeros(2, np.int64)), 1.0)


def covered(place_px: np.ndarray, blur_px: float) -> np.ndarray:
    """Share of a blur disc and a pixel's width on the near side: many samples."""
    within = (np.arange(400) + 0.5) / 400 - 0.5
    t = np.clip(2 * (place_px[:, None] + within) / max(blur_px, 1e-6), -1, 1)
    return (0.5 - (t * np.sqrt(1 - t * t) + np.arcsin(t)) / np.pi).mean(axis=1)


def spread_px2(place_px: np.ndarray, profile: np.ndarray) -> float:
    """Variance of an edge's profile; a blur circle adds b^2 / 16."""
    share, middle = -np.diff(profile), (place_px[1:] + place_px[:-1]) / 2
    mean = np.sum(share * middle)
    return float(np.sum(share * (middle - mean) ** 2))


@pytest.mark.parametrize("upright", [True, False])
@pytest.mark.parametrize("pitch_ratio", [1.2, 1.7, 0.8])
@pytest.mark.parametrize("blur_mm", [0.0, 0.004, 0.011, 0.03])
def test_the_profile_of_an_edge_has_the_pixel_width_across_it(
    pitch_ratio: float, blur_mm: float, *, upright: bool
) -> None:
    pitch_mm = pitch_ratio * HEIGHT_MM if upright else HEIGHT_MM
    sensor = Sensor(SIZE, SIZE, pitch_ratio * HEIGHT_MM, HEIGHT_MM)
    per_a = abs(float(signed_blur_mm(Z_MM, D_MM, F_MM, 1.0, 0.0)))
    edge_px = 0.3
    grey = render(
        [plate(upright=upright, edge_mm=edge_px * pitch_mm * Z_MM / D_MM)],
        Pose.identity("world", "camera"),
        d_mm=D_MM,
        f_mm=F_MM,
        a_mm=max(blur_mm, 1e-4) / per_a,
        intrinsics=Intrinsics(sensor, (SIZE - 1) / 2, (SIZE - 1) / 2),
        light=FLAT,
        quality=RenderQuality(diffraction=False),
    ).grey
    profile = grey[SIZE // 2] if upright else grey[:, SIZE // 2]
    place = np.arange(SIZE) - (SIZE - 1) / 2 - edge_px
    blur_px = blur_mm / pitch_mm
    truth = covered(place, blur_px)
    assert profile == pytest.approx(truth, abs=0.012)
    wider = 16 * (spread_px2(place, profile) - spread_px2(place, truth))
    # Drawn blur diameters are rounded to 1.5 %.
    assert wider == pytest.approx(0, abs=0.06 + 0.03 * blur_px**2)
