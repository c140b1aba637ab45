"""Blur, perspective, diffraction and motion in the picture."""

from __future__ import annotations

import numpy as np
import pytest

from mvp.geometry import Pose, TriangleMesh
from mvp.imaging import (
    Illumination,
    Lamp,
    LensState,
    RenderBody,
    RenderQuality,
    render,
    render_moving,
)
from mvp.optics import Intrinsics, Sensor

PITCH_MM = 0.005
F_MM = 12.5
FLAT = Illumination(ambient=1.0, lamps=(), gloss=0.0, background=0.0)
AT_ORIGIN = Pose.identity("world", "camera")
NO_AIRY = RenderQuality(diffraction=False)


def intrinsics(width: int = 96, height: int = 24) -> Intrinsics:
    sensor = Sensor(width, height, PITCH_MM, PITCH_MM)
    return Intrinsics(sensor, (width - 1) / 2, (height - 1) / 2)


def plate(corners: list[tuple[float, float, float]], albedo: float) -> RenderBody:
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    return RenderBody(
        TriangleMesh(np.array(corners), faces, np.zeros(2, np.int64)), albedo
    )


def left_half(z_mm: float, albedo: float = 1.0) -> RenderBody:
    return plate(
        [(-90, -90, z_mm), (0, -90, z_mm), (0, 90, z_mm), (-90, 90, z_mm)], albedo
    )


def wall(z_mm: float, albedo: float) -> RenderBody:
    return plate(
        [(-90, -90, z_mm), (90, -90, z_mm), (90, 90, z_mm), (-90, 90, z_mm)], albedo
    )


def crease(z_mm: float) -> list[RenderBody]:
    """Two planes that meet at x = 0 and lean away on either side."""
    left = [(-60, -90, z_mm + 40), (0, -90, z_mm), (0, 90, z_mm), (-60, 90, z_mm + 40)]
    right = [(0, -90, z_mm), (60, -90, z_mm + 40), (60, 90, z_mm + 40), (0, 90, z_mm)]
    return [plate(left, 1.0), plate(right, 0.4)]


def blur_px(z_mm: float, d_mm: float, a_mm: float, e_mm: float) -> float:
    """b = a m |z - z_f| / z, written out."""
    focus = F_MM * d_mm / (d_mm - F_MM)
    m = d_mm / focus
    return a_mm * m * abs(z_mm - (focus - e_mm)) / z_mm / PITCH_MM


def spread_variance_px2(profile: np.ndarray) -> float:
    """Variance of the line spread of an edge between two constant levels."""
    weight = np.diff(profile)
    place = np.arange(len(weight))
    mean = (weight * place).sum() / weight.sum()
    return float((weight * (place - mean) ** 2).sum() / weight.sum())


def profile_of(
    bodies: list[RenderBody], quality: RenderQuality, **lens: float
) -> np.ndarray:
    image = render(
        bodies,
        AT_ORIGIN,
        d_mm=lens["d_mm"],
        f_mm=F_MM,
        a_mm=lens["a_mm"],
        e_mm=lens.get("e_mm", 0.0),
        intrinsics=intrinsics(),
        light=FLAT,
        quality=quality,
    )
    return image.grey[12].astype(np.float64)


@pytest.mark.parametrize("scene", ["contour", "crease", "occluder"])
@pytest.mark.parametrize("e_mm", [0.0, 2.4])
@pytest.mark.parametrize("wanted_px", [1.3, 2.0, 3.7, 6.0, 12.0])
def test_blur_in_the_picture_follows_the_formula(
    scene: str, e_mm: float, wanted_px: float
) -> None:
    z_mm, a_mm = 260.0, 12.5 / 4
    d_mm = 12.9
    a_mm *= wanted_px / blur_px(z_mm, d_mm, a_mm, e_mm)
    bodies = {
        "contour": [left_half(z_mm)],
        "crease": crease(z_mm),
        "occluder": [left_half(z_mm), wall(500.0, 0.3)],
    }[scene]
    profile = profile_of(bodies, NO_AIRY, d_mm=d_mm, a_mm=a_mm, e_mm=e_mm)
    # A disc of diameter b has variance b^2 / 16; pixel and difference add 1 / 12 each.
    drawn = 4 * np.sqrt(spread_variance_px2(profile) - 1 / 6)
    assert drawn == pytest.approx(wanted_px, rel=0.05)


def test_diffraction_alone_gives_the_airy_profile_of_the_working_aperture() -> None:
    d_mm, a_mm = 13.0, 12.5 / 16
    z_mm = F_MM * d_mm / (d_mm - F_MM)
    profile = profile_of([left_half(z_mm)], RenderQuality(), d_mm=d_mm, a_mm=a_mm)
    # Independent: transfer function of a round pupil, times a pixel, at a straight edge.
    unit = 550e-6 * d_mm / a_mm / PITCH_MM
    nu = np.arange(0.0005, 1 / unit, 0.001)
    v = nu * unit
    transfer = 2 / np.pi * (np.arccos(v) - v * np.sqrt(1 - v * v)) * np.sinc(nu)
    place = np.arange(96) - 47.5
    share = 0.5 - (
        np.sin(2 * np.pi * np.outer(place, nu)) * transfer / (np.pi * nu) * 0.001
    ).sum(axis=1)
    # The 5 % of the light beyond the third dark ring are drawn nearer than they fall.
    gap = np.abs(profile - share)
    assert gap[np.abs(place) < 1].max() < 0.006
    assert gap.max() < 0.02


def test_the_closed_form_agrees_with_brute_force_samples() -> None:
    light = Illumination(lamps=(Lamp((0, 0, 0), 0.3), Lamp((-150, -110, 20), 0.6)))
    box = [
        plate([(-9, -6, 250), (8, -7, 262), (6, 7, 255), (-7, 6, 243)], 0.9),
        plate([(8, -7, 262), (16, -8, 330), (15, 9, 330), (6, 7, 255)], 0.6),
        wall(330.0, 0.5),
    ]
    pictures = [
        render(
            box,
            AT_ORIGIN,
            d_mm=13.05,
            f_mm=F_MM,
            a_mm=12.5 / 8,
            intrinsics=Intrinsics(Sensor(160, 128, 0.02, 0.016), 79.5, 63.5, k1=-0.1),
            light=light,
            quality=quality,
        ).grey
        for quality in (
            RenderQuality(),
            RenderQuality(method="sampled", edge_samples=512),
        )
    ]
    gap = pictures[0] - pictures[1]
    assert np.sqrt((gap[gap != 0] ** 2).mean()) < 0.003
    assert np.abs(gap).max() < 0.03


def test_bodies_that_cut_into_each_other_are_drawn_although_no_edge_is_there() -> None:
    bodies = [
        plate([(-40, -40, 280), (40, -40, 320), (40, 40, 320), (-40, 40, 280)], 0.9),
        wall(300.0, 0.4),
    ]
    profile = profile_of(bodies, RenderQuality(), d_mm=13.04, a_mm=12.5 / 16)
    # The tilted plate is in front where x < 0, that is left of the middle.
    left_share = (profile - 0.4) / 0.5
    assert left_share.sum() == pytest.approx(48.0, abs=0.05)
    assert left_share[:44].min() > 0.98
    assert left_share[52:].max() < 0.02


def test_a_thin_part_between_two_pixel_centres_is_not_missed() -> None:
    d_mm, z_mm = 13.0, 325.0
    px_mm = PITCH_MM * z_mm / d_mm
    x = 0.5 * px_mm  # the middle of the picture lies between two columns
    wire = [(x - 0.2 * px_mm, -90, z_mm), (x + 0.2 * px_mm, -90, z_mm)]
    wire += [(x + 0.2 * px_mm, 90, z_mm), (x - 0.2 * px_mm, 90, z_mm)]
    shifted = plate([(p[0] - x, p[1], p[2]) for p in wire], 1.0)
    for body in (plate(wire, 1.0), shifted):
        profile = profile_of([body], RenderQuality(), d_mm=d_mm, a_mm=12.5 / 16)
        assert profile.sum() == pytest.approx(0.4, abs=0.01)


def test_motion_widens_the_edge_by_the_way_it_moved() -> None:
    d_mm, z_mm, moved_px, frames = 13.0, 325.0, 6.0, 24
    px_mm = PITCH_MM * z_mm / d_mm
    places = ((np.arange(frames) + 0.5) / frames - 0.5) * moved_px * px_mm
    poses = [Pose("world", "camera", np.eye(3), np.array([p, 0, 0])) for p in places]
    image = render_moving(
        [left_half(z_mm)],
        poses,
        lens=LensState(d_mm, F_MM, 12.5 / 16),
        intrinsics=intrinsics(),
        light=FLAT,
        quality=NO_AIRY,
    )
    variance = spread_variance_px2(image.grey[12].astype(np.float64)) - 1 / 6
    assert np.sqrt(12 * variance) == pytest.approx(moved_px, rel=0.02)


def test_moving_pictures_need_as_many_lens_settings_as_poses() -> None:
    with pytest.raises(ValueError, match="one per pose"):
        render_moving(
            [left_half(300.0)],
            [AT_ORIGIN],
            lens=[LensState(13.0, F_MM, 1.0)] * 2,
            intrinsics=intrinsics(),
        )


def test_parallel_faces_at_different_depth_differ_under_the_standard_light() -> None:
    bodies = [left_half(200.0, 0.8), wall(225.0, 0.8)]
    image = render(
        bodies, AT_ORIGIN, d_mm=13.3, f_mm=F_MM, a_mm=0.8, intrinsics=intrinsics()
    )
    near, far = image.grey[12, 5], image.grey[12, -6]
    assert near > 1.08 * far


def test_ids_and_depths_name_what_each_pixel_sees() -> None:
    bodies = [left_half(200.0), wall(400.0, 0.5)]
    image = render(
        bodies, AT_ORIGIN, d_mm=13.0, f_mm=F_MM, a_mm=0.8, intrinsics=intrinsics()
    )
    assert image.body_id[3, 3] == 0
    assert image.body_id[3, -3] == 1
    assert len(np.unique(image.face_id)) == 2
    assert image.depth_mm[3, 3] == pytest.approx(200.0, rel=1e-5)
    assert image.depth_mm[3, -3] == pytest.approx(400.0, rel=1e-5)


def test_an_empty_scene_shows_background_at_infinite_depth() -> None:
    image = render([], AT_ORIGIN, d_mm=13, f_mm=F_MM, a_mm=1, intrinsics=intrinsics())
    assert (image.grey == np.float32(Illumination().background)).all()
    assert np.isinf(image.depth_mm).all()
    assert (image.face_id == -1).all()
