"""A rendered edge against the exact area it covers of every pixel."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mvp.geometry import Pose, TriangleMesh
from mvp.imaging import Illumination, RenderBody, RenderQuality, render
from mvp.optics import Intrinsics, Sensor

SIZE = 48
PITCH_MM = 0.005
SENSOR = Sensor(SIZE, SIZE, PITCH_MM, PITCH_MM)
INTRINSICS = Intrinsics(SENSOR, (SIZE - 1) / 2, (SIZE - 1) / 2)
F_MM, D_MM, A_MM = 12.5, 13.0, 12.5 / 16
Z_MM = 300.0
FLAT = Illumination(ambient=1.0, lamps=(), gloss=0.0, background=0.0)
SHARP = RenderQuality(defocus=False, diffraction=False)
AT_ORIGIN = Pose.identity("world", "camera")
CENTRE = (SIZE - 1) / 2


def half_plane(angle_rad: float, offset_px: float) -> RenderBody:
    """A plate on the side n . p < offset of a line through the picture's middle."""
    normal = np.array([np.cos(angle_rad), np.sin(angle_rad)])
    along = np.array([-normal[1], normal[0]])
    corners_px = [
        offset_px * normal + side * 200 * along + depth * normal
        for side, depth in ((-1, 0), (1, 0), (1, -400), (-1, -400))
    ]
    scale = PITCH_MM * Z_MM / D_MM
    vertices = np.column_stack([np.array(corners_px) * scale, np.full(4, Z_MM)])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    return RenderBody(TriangleMesh(vertices, faces, np.zeros(2, np.int64)), 1.0)


def picture(angle_rad: float, offset_px: float, quality: RenderQuality) -> np.ndarray:
    return render(
        [half_plane(angle_rad, offset_px)],
        AT_ORIGIN,
        d_mm=D_MM,
        f_mm=F_MM,
        a_mm=A_MM,
        intrinsics=INTRINSICS,
        light=FLAT,
        quality=quality,
    ).grey.astype(np.float64)


def coverage(angle_rad: float, offset_px: float) -> np.ndarray:
    """Exact share of each pixel on the side n . p < offset: integral of two ramps."""
    y, x = np.mgrid[:SIZE, :SIZE] - CENTRE
    c, s = sorted(np.abs([np.cos(angle_rad), np.sin(angle_rad)]))
    t = offset_px - np.cos(angle_rad) * x - np.sin(angle_rad) * y
    if c < 1e-9:
        return np.clip(t / s + 0.5, 0, 1)

    def ramp(u: np.ndarray) -> np.ndarray:
        return np.maximum(u, 0.0) ** 2 / 2

    outer, inner = (s + c) / 2, (s - c) / 2
    return (ramp(t + outer) - ramp(t + inner) - ramp(t - inner) + ramp(t - outer)) / (
        s * c
    )


def place_errors_px(angle_rad: float, offset_px: float, grey: np.ndarray) -> np.ndarray:
    """Normal offset of the edge, line by line, from the light it lets through."""
    gap = grey - coverage(angle_rad, offset_px)
    steep = abs(np.cos(angle_rad)) >= abs(np.sin(angle_rad))
    per_line = gap.sum(axis=1 if steep else 0)
    return per_line * max(abs(np.cos(angle_rad)), abs(np.sin(angle_rad)))


@settings(max_examples=20, deadline=None)
@given(
    angle_rad=st.floats(-np.pi, np.pi),
    offset_px=st.floats(-4.0, 4.0),
)
def test_an_edge_at_any_angle_is_in_its_place(
    angle_rad: float, offset_px: float
) -> None:
    grey = picture(angle_rad, offset_px, SHARP)
    error = place_errors_px(angle_rad, offset_px, grey)
    assert np.abs(error).max() < 0.05
    assert abs(error.mean()) < 0.01


@pytest.mark.parametrize("degrees", [0.0, 90.0, 180.0, 270.0, 0.4, 89.6])
@pytest.mark.parametrize("offset_px", [-0.5, 0.0, 0.25, 0.4999, 0.5, 0.73])
def test_an_axis_parallel_edge_is_in_its_place(
    degrees: float, offset_px: float
) -> None:
    angle = np.deg2rad(degrees)
    error = place_errors_px(angle, offset_px, picture(angle, offset_px, SHARP))
    assert np.abs(error).max() < 0.02


def test_the_errors_of_many_edges_have_a_small_rms() -> None:
    rng = np.random.default_rng(5)
    errors = []
    for angle, offset in zip(
        rng.uniform(0, 2 * np.pi, 12), rng.uniform(-3, 3, 12), strict=True
    ):
        errors.append(place_errors_px(angle, offset, picture(angle, offset, SHARP)))
    assert np.sqrt(np.mean(np.concatenate(errors) ** 2)) < 0.01


def test_every_pixel_on_a_sharp_edge_shows_the_area_that_is_covered() -> None:
    for degrees in (0.0, 12.0, 30.0, 45.0, 77.0):
        angle = np.deg2rad(degrees)
        gap = picture(angle, 0.3, SHARP) - coverage(angle, 0.3)
        assert np.abs(gap).max() < 0.03


@pytest.mark.parametrize("degrees", [0.0, 33.0, 90.0])
def test_blur_and_diffraction_do_not_move_an_edge(degrees: float) -> None:
    angle = np.deg2rad(degrees)
    grey = picture(angle, 0.37, RenderQuality())
    inner = slice(14, -14)
    error = place_errors_px(angle, 0.37, grey)[inner]
    assert np.abs(error).max() < 0.01
