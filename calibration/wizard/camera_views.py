"""Which views a camera calibration takes: what they would tell, and what is missing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibration.bundle import BundleState, Freedom, freedom
from calibration.camera import CameraOptions, calibrate_camera
from calibration.poses import Poses
from calibration.target_shape import ShapePrior
from calibration.wizard.coverage import Coverage, coverage, fields_of
from calibration.wizard.lookout import camera_at, focus_at, layout_of, target_of
from calibration.wizard.next_pose import (
    Knowledge,
    TargetViews,
    ViewRange,
    camera_information,
    camera_task,
    candidate_views,
    views_of,
)

if TYPE_CHECKING:
    from calibration.projection import PinholeCamera
    from calibration.wizard.lookout import Lookout
    from calibration.wizard.next_pose_aim import Aim
    from calibration.wizard.session_store import Sample
    from calibration.wizard.working import Setting
    from mvp.geometry import FloatArray
    from mvp.wizard import SessionFacts, TargetFacts

FREE = ("fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2", "p1", "p2")
_SIGMA_PX, _LEAST_PX = 0.15, 0.03
LARGEST_NOISE_PX = 0.2
_NEAR, _FAR = 0.7, 1.4
_TILT_RAD = float(np.radians(38.0))
_CALM_TILT_RAD = float(np.radians(25.0))
_PLACES, _SHARE = 0.75, 0.6
# Higher terms of real lenses; they keep views that say nothing of them from guessing.
_PLAUSIBLE = (("k2", 0.0, 0.5), ("p1", 0.0, 3e-3), ("p2", 0.0, 3e-3))


def result_options(facts: SessionFacts) -> CameraOptions:
    """How the result is computed: one principal distance, as the pixels are known."""
    sensor = facts.sensor
    return camera_options(sensor.pitch_x_mm / sensor.pitch_y_mm, shape_prior(facts))


def camera_options(aspect: float, shape: ShapePrior) -> CameraOptions:
    """The same for pixels of one aspect, and a target that is known so well."""
    return CameraOptions(
        free=FREE,
        tied_focal=True,
        aspect=aspect,
        priors=_PLAUSIBLE,
        shape=shape,
        largest_noise_px=LARGEST_NOISE_PX,
    )


def shape_prior(facts: SessionFacts) -> ShapePrior:
    """What is known of the cell's target before it is seen.

    Its two sides are known as well as its squares are: the error of a ratio is that of
    both. Readings of a caliper along and across may differ by more than that.
    """
    target = target_of(facts)
    either = np.sqrt(2) * target.square_sigma_mm
    if target.measured is not None:
        readings = target.measured.readings_mm
        either = np.hypot(either, np.ptp(readings) / target.measured.squares)
    return ShapePrior.of_a_print(layout_of(target).points_mm).known(
        flat_mm=target.flat_sigma_mm,
        stretch=None if _one_reading(target) else float(either) / target.square_mm,
    )


def _one_reading(target: TargetFacts) -> bool:
    """A caliper was put to one side only."""
    return target.measured is not None and len(target.measured.readings_mm) < 2


def _guess_options(facts: SessionFacts, nominal: PinholeCamera) -> CameraOptions:
    """While views are few, what was believed before helps out; widely."""
    centre = 0.02 * facts.sensor.width_px
    before = (
        ("fx_px", nominal.fx_px, 0.03 * nominal.fx_px),
        ("cx_px", nominal.cx_px, centre),
        ("cy_px", nominal.cy_px, centre),
        ("k1", nominal.k1, 0.15),
    )
    options = result_options(facts)
    return CameraOptions(
        free=options.free,
        tied_focal=True,
        aspect=options.aspect,
        sigma_px=_SIGMA_PX,
        priors=before + _PLAUSIBLE,
        folds=0,
    )


@dataclass(frozen=True, eq=False)
class Progress:
    """What the session knows between two views.

    Attributes:
        setting: of the lens.
        camera: the best guess so far.
        sigma_px: how well a coordinate is found, by what is left in the views so far.
        aim: where camera and target are.
        knowledge: information so far, and the task: a point at the working distance.
        covered: None before the first view.
    """

    lookout: Lookout
    setting: Setting
    camera: PinholeCamera
    sigma_px: float
    aim: Aim
    free: Freedom
    knowledge: Knowledge
    covered: Coverage | None

    @classmethod
    def now(cls, lookout: Lookout, setting: Setting) -> Progress:
        """From all usable samples so far."""
        facts, samples = lookout.facts, lookout.store.usable()
        lens = facts.lens_at(setting.by_name)
        nominal = camera_at(facts, lens)
        options = _guess_options(facts, nominal)
        camera, covered, poses, sigma_px = nominal, None, None, _SIGMA_PX
        if samples:
            seen = lookout.store.observations(samples)
            sights = [lookout.sight(sample) for sample in samples]
            start = BundleState(
                nominal,
                np.concatenate([one.rotation for one in sights]),
                np.concatenate([one.translation_mm for one in sights]),
            )
            found = calibrate_camera(seen, options, start=start)
            state, camera = found.state, found.camera
            sigma_px *= float(np.sqrt(found.estimate.variance_factor))
            sigma_px = max(sigma_px, _LEAST_PX)
            poses = Poses(state.rotation, state.translation_mm)
            covered = coverage(seen, poses)
        free = freedom(camera, options.free, tied_focal=True)
        information = _prior_information(free, options)
        if poses is not None:
            views = _taken(lookout, camera, poses, samples)
            more = camera_information(camera, free, views, sigma_px)
            information = information + more.sum(axis=0)
        distance = setting.stand_off_mm(facts)
        weight = camera_task(camera, free, lookout.size_px, distance)
        aim = lookout.aim(list(samples), lens.d_mm)
        known = Knowledge(information, weight)
        return cls(lookout, setting, camera, sigma_px, aim, free, known, covered)

    @property
    def mm_per_px(self) -> float:
        """At the working distance."""
        facts = self.lookout.facts
        return self.setting.stand_off_mm(facts) / self.camera.fx_px

    def candidates(self, *, calm: bool = False) -> TargetViews:
        """Views that show the target in focus.

        Args:
            calm: as work is done, for verification: less tilt, in the middle.
        """
        lookout, facts = self.lookout, self.lookout.facts
        lens = facts.lens_at(self.setting.by_name)
        focus = focus_at(facts, lens, self.setting.limit_px)
        near, far = focus.range_mm()
        middle = self.setting.stand_off_mm(facts)
        within = ViewRange(
            max(near, _NEAR * middle),
            max(min(far, _FAR * middle), near),
            tilt_rad=_CALM_TILT_RAD if calm else _TILT_RAD,
            places=0.5 if calm else _PLACES,
            share=lookout.least_share(_SHARE),
        )
        rng = lookout.bench.rng(lookout.store.next_number)
        return candidate_views(
            self.camera, lookout.size_px, lookout.points_mm, within, rng, focus=focus
        )

    def information(self, views: TargetViews) -> FloatArray:
        """(n, k, k): what each would tell about the camera."""
        return camera_information(self.camera, self.free, views, self.sigma_px)

    def new_fields(self, views: TargetViews) -> FloatArray:
        """(n, 1, 1): how many empty fields of the picture each would fill."""
        if self.covered is None:
            return np.ones((len(views), 1, 1))
        empty = self.covered.counts == 0
        filled = []
        for pixels, seen in zip(views.pixels, views.seen, strict=True):
            places = fields_of(pixels[seen], self.lookout.size_px)
            hit = np.zeros_like(empty)
            hit[tuple(places.T)] = True
            filled.append(float((hit & empty).sum()))
        return np.array(filled).reshape(-1, 1, 1)


def _prior_information(free: Freedom, options: CameraOptions) -> FloatArray:
    """(k, k) of what was believed before."""
    found = np.zeros((len(free.names), len(free.names)))
    for name, _, sigma in options.priors:
        place = free.names.index(name)
        found[place, place] += sigma**-2
    return found


def _taken(
    lookout: Lookout,
    camera: PinholeCamera,
    poses: Poses,
    samples: tuple[Sample, ...],
) -> TargetViews:
    """The views so far, with the points that were found in them."""
    views = views_of(camera, lookout.size_px, lookout.points_mm, poses)
    seen = np.zeros_like(views.seen)
    for row, sample in zip(seen, samples, strict=True):
        row[np.asarray(sample.ids, dtype=np.int64)] = True
    return TargetViews(poses, views.points_target_mm, views.pixels, seen)
