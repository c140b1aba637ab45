"""Seeded pictures with one fault each: for tests, the confusion matrix and the bench."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import cv2
import numpy as np

from mvp.geometry import Box, FloatArray, Pose, TriangleMesh, box_mesh
from mvp.imaging import (
    Illumination,
    RenderBody,
    RenderedImage,
    RenderScene,
    Requirement,
    SensorNoise,
    ViewExpectation,
    ViewTolerance,
    expect_view,
    expose,
    render,
)
from mvp.imaging.edge_samples import Picture
from mvp.imaging.measure_exposure import feature_band
from mvp.optics import Intrinsics, Sensor
from mvp.optics.thick_lens import focus_distance_mm, image_distance_mm
from mvp.scene import EdgeFeature, cad_edges, edge_feature, paper_object

PAPER = Sensor(512, 480, 0.01625, 0.0135)
FINE = Sensor(1280, 1024, 0.005, 0.005)
F_MM, A_MM, C_MM = 12.5, 0.78125, 0.0135
HALF_DEPTH_MM = C_MM * 13.07 / A_MM
CLASSES = (
    "none",
    "defocus",
    "zoom",
    "hand-eye",
    "part shift",
    "motion",
    "occluder",
    "over",
    "under",
)
CAUSE_OF = {
    "none": None,
    "defocus": "defocus",
    "zoom": "zoom",
    "hand-eye": "misalignment",
    "part shift": "misalignment",
    "motion": "motion",
    "occluder": "occlusion",
    "over": "overexposed",
    "under": "underexposed",
}
_VIEWS = {
    "V_f": ((107.58, -231.43, 258.68), (-0.389, 0.694, -0.608), 13.07),
    "V_f1": ((197.10, 100.58, 330.45), (-0.513, -0.255, -0.820), 12.84),
    "V_f2": ((112.78, 110.49, 159.77), (-0.444, -0.583, -0.680), 13.25),
}
VIEW_NAMES = tuple(_VIEWS)


@dataclass(frozen=True)
class Setting:
    """Camera pose and lens of one picture, part frame."""

    pose: Pose
    f_mm: float
    d_mm: float
    a_mm: float
    e_mm: float = 0.0


def look_along(position_mm: FloatArray, direction: FloatArray) -> Pose:
    """A camera with a level horizon (part z up)."""
    forward = direction / np.linalg.norm(direction)
    up = np.array([0.0, 0.0, 1.0]) if abs(forward[2]) < 0.99 else np.array([0.0, 1, 0])
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward], axis=1)
    return Pose("part", "camera", rotation, position_mm)


def paper_setting(view: str, *, e_mm: float = 0.0) -> Setting:
    """One of the three published results."""
    position, direction, d = _VIEWS[view]
    pose = look_along(np.array(position), np.array(direction))
    return Setting(pose, F_MM, d, A_MM, e_mm)


def intrinsics_of(sensor: Sensor) -> Intrinsics:
    """Principal point in the middle, some barrel distortion."""
    return Intrinsics(
        sensor, (sensor.width_px - 1) / 2, (sensor.height_px - 1) / 2, k1=-0.1
    )


@dataclass(frozen=True, eq=False)
class Stage:
    """A part, its two feature edges, a light and a sensor."""

    mesh: TriangleMesh
    sensor: Sensor
    light: Illumination = field(default_factory=Illumination)
    tolerance: ViewTolerance = field(
        default_factory=lambda: ViewTolerance(0.5, 0.1, 0.02)
    )
    light_known: bool = True
    kept: dict[tuple[str, float], tuple[Setting, ViewExpectation, float]] = field(
        default_factory=dict
    )

    @cached_property
    def scene(self) -> RenderScene:
        return RenderScene([RenderBody(self.mesh)])

    @cached_property
    def features(self) -> tuple[EdgeFeature, ...]:
        return (
            edge_feature("horizontal", (-12.7, 0, 12.7), (12.7, 0, 12.7), self.mesh),
            edge_feature("vertical", (12.7, 0, -12.7), (12.7, 0, 12.7), self.mesh),
        )

    def expectation(self, setting: Setting, *, auxiliary: int = 13) -> ViewExpectation:
        """What plan and CAD say, with some edges besides those of the features."""
        return expect_view(
            self.features,
            self.mesh,
            cad_edges(self.mesh),
            setting.pose,
            f_mm=setting.f_mm,
            d_mm=setting.d_mm,
            a_mm=setting.a_mm,
            e_mm=setting.e_mm,
            intrinsics=intrinsics_of(self.sensor),
            c_mm=C_MM,
            tolerance=self.tolerance,
            requirements={f.id: Requirement(1.0, 1.0) for f in self.features},
            light=self.light if self.light_known else None,
            auxiliary=auxiliary,
        )

    def planned(self, view: str, e_mm: float) -> tuple[Setting, ViewExpectation, float]:
        """A published view, what it must show, and its metered exposure; kept."""
        if (view, e_mm) not in self.kept:
            setting = paper_setting(view, e_mm=e_mm)
            expectation = self.expectation(setting)
            exposure_s = metered_s(self.picture(setting), expectation)
            self.kept[view, e_mm] = setting, expectation, exposure_s
        return self.kept[view, e_mm]

    def picture(
        self, setting: Setting, scene: RenderScene | None = None
    ) -> RenderedImage:
        """What the camera would see."""
        return render(
            scene or self.scene,
            setting.pose,
            d_mm=setting.d_mm,
            f_mm=setting.f_mm,
            a_mm=setting.a_mm,
            e_mm=setting.e_mm,
            intrinsics=intrinsics_of(self.sensor),
            light=self.light,
        )


def paper_stage(sensor: Sensor = PAPER, *, light_known: bool = True) -> Stage:
    return Stage(paper_object(), sensor, light_known=light_known)


def metered_s(image: RenderedImage, expectation: ViewExpectation) -> float:
    """Exposure that puts the feature band's 95th percentile at 60 %."""
    grey = np.asarray(image.grey, np.float64)
    band = feature_band(Picture(grey, expectation.plane), expectation)
    level = float(np.percentile(band, 95))
    return 0.6 / level / SensorNoise().full_wells_per_s / image.brightness


@dataclass(frozen=True, eq=False)
class Trial:
    """A picture, what it was expected to be, and the fault that is in it."""

    view: str
    fault: str
    amount: str
    image: np.ndarray
    expectation: ViewExpectation


def make_trial(stage: Stage, fault: str, seed: int, *, noise: bool = True) -> Trial:
    """One seeded picture: a view, small errors everywhere, and one fault."""
    rng = np.random.default_rng([seed, CLASSES.index(fault)])
    view = VIEW_NAMES[rng.integers(3)]
    planned, expectation, exposure = stage.planned(view, float(rng.choice([0.0, 2.4])))
    true = _small_errors(planned, rng)
    true, scene, factor, path, amount = _faulty(stage, true, fault, rng)
    image = stage.picture(true, scene)
    if path is not None:
        image = replace(image, grey=smeared(image.grey, path))
    frame = expose(image, exposure * factor, rng=rng if noise else None)
    return Trial(view, fault, amount, frame, expectation)


def _small_errors(setting: Setting, rng: np.random.Generator) -> Setting:
    turn = Pose.from_rotvec(
        "camera",
        "camera",
        np.deg2rad(0.03) * rng.standard_normal(3),
        0.12 * rng.standard_normal(3),
    )
    return replace(
        setting,
        pose=setting.pose @ turn,
        d_mm=setting.d_mm + 0.005 * rng.standard_normal(),
        a_mm=setting.a_mm * (1 + 0.02 * rng.standard_normal()),
    )


def _faulty(
    stage: Stage, true: Setting, fault: str, rng: np.random.Generator
) -> tuple[Setting, RenderScene | None, float, FloatArray | None, str]:
    """The faulty setting, scene, exposure factor, smear path (px) and its amount."""
    if fault == "defocus":
        step = float(rng.choice([3.0, 6.0])) * HALF_DEPTH_MM
        sign = rng.choice([-1.0, 1.0]) if true.d_mm - step > true.f_mm + 0.02 else 1.0
        moved = replace(true, d_mm=true.d_mm + sign * step)
        return moved, None, 1.0, None, f"{sign * step:+.2f} mm"
    if fault == "zoom":
        share = float(rng.choice([-1, 1]) * rng.uniform(0.04, 0.12))
        return zoomed(true, share), None, 1.0, None, f"{share:+.1%}"
    if fault == "hand-eye":
        axis = rng.standard_normal(3)
        return turned_at_flange(true, axis, 3.0), None, 1.0, None, "3 deg"
    if fault == "part shift":
        angle = rng.uniform(0, 2 * np.pi)
        step = 6.0 * np.array([np.cos(angle), np.sin(angle), 0.0])
        pose = true.pose
        moved = Pose("part", "camera", pose.rotation, pose.translation_mm - step)
        return replace(true, pose=moved), None, 1.0, None, "6 mm"
    if fault == "motion":
        angle, length = rng.uniform(0, np.pi), rng.uniform(5, 9)
        path = length * np.array([np.cos(angle), np.sin(angle)])
        return true, None, 1.0, path, f"{length:.1f} px {np.rad2deg(angle):.0f} deg"
    if fault == "occluder":
        return true, _occluded(stage, true, rng), 1.0, None, "plate"
    factor = {"over": 8.0, "under": float(rng.choice([1 / 8, 1 / 20]))}.get(fault, 1.0)
    return true, None, factor, None, f"x {factor:.3g}"


def zoomed(setting: Setting, share: float) -> Setting:
    """Another focal length, focused at the same distance."""
    focus = focus_distance_mm(setting.d_mm, setting.f_mm)
    f = setting.f_mm * (1 + share)
    return replace(setting, f_mm=f, d_mm=float(image_distance_mm(focus, f)))


def turned_at_flange(setting: Setting, axis: FloatArray, angle_deg: float) -> Setting:
    """The camera turned about a flange 100 mm behind it."""
    rotvec = axis / np.linalg.norm(axis) * np.deg2rad(angle_deg)
    turn = Pose.from_rotvec("camera", "camera", rotvec, np.zeros(3))
    lever = np.array([0.0, 0.0, -100.0])
    moved = Pose("camera", "camera", turn.rotation, lever - turn.rotate(lever))
    return replace(setting, pose=setting.pose @ moved)


def _occluded(stage: Stage, true: Setting, rng: np.random.Generator) -> RenderScene:
    """A small plate in front of a part of one feature."""
    feature = stage.features[rng.integers(2)]
    place = feature.start_mm + rng.uniform(0.3, 0.7) * (
        feature.end_mm - feature.start_mm
    )
    share = rng.uniform(0.35, 0.65)
    half = (1 - share) * np.array([rng.uniform(5, 9), rng.uniform(5, 9), 0.5])
    camera = true.pose.inverse().apply(place) * share
    plate = box_mesh(Box(-half, half), name="plate").moved(
        true.pose
        @ Pose.from_rotvec("camera", "plate", [0, 0, rng.uniform(0, np.pi)], camera)
    )
    return RenderScene(
        [RenderBody(stage.mesh), RenderBody(plate, albedo=rng.uniform(0.2, 0.9))]
    )


def smeared(grey: np.ndarray, path_px: FloatArray) -> np.ndarray:
    """Uniform motion of the picture during the exposure."""
    steps = np.linspace(-0.5, 0.5, 33)
    total = np.zeros(grey.shape, dtype=np.float64)
    for share in steps:
        shift = np.array(
            [[1, 0, share * path_px[0]], [0, 1, share * path_px[1]]], dtype=np.float64
        )
        total += cv2.warpAffine(
            grey,
            shift,
            grey.shape[::-1],
            flags=cv2.INTER_CUBIC,
            borderMode=cv2.BORDER_REPLICATE,
        )
    return np.asarray(np.maximum(total / len(steps), 0), dtype=np.float32)
