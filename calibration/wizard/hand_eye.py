"""The hand-eye wizard: where the camera sits on the hand, in millimetres at the work.

One lens setting, the intrinsics of camera and lens calibration with their uncertainty,
views that turn about all axes, chosen one by one by what they teach about a point at the
working distance, and held-out views at the end.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from calibration.poses import Poses
from calibration.wizard.camera_prior import camera_prior
from calibration.wizard.coverage import coverage
from calibration.wizard.hand_eye_result import (
    KEY,
    SIGMA_PX,
    outcome_of,
    page_of,
    robot_of,
)
from calibration.wizard.lookout import Lookout, focus_at, target_of
from calibration.wizard.next_pose import (
    HandEyeBelief,
    Knowledge,
    NoView,
    TargetViews,
    ViewRange,
    candidate_views,
    choose,
    first_of,
    hand_eye_information,
    hand_eye_task,
    views_of,
    views_until,
)
from calibration.wizard.phases import in_phases
from calibration.wizard.preflight import before_pictures, temperature_told
from calibration.wizard.session_store import Sample, SessionStore
from calibration.wizard.touch import touched, with_touch
from calibration.wizard.working import setting_of
from mvp.cell.calibration_gates import IMPORTED
from mvp.wizard import Covered, Forecast, Outcome, Say, Word

if TYPE_CHECKING:
    from collections.abc import Generator

    from calibration.wizard.coverage import Coverage
    from calibration.wizard.lookout import Goal
    from calibration.wizard.next_pose import Refused
    from calibration.wizard.next_pose_aim import Aim
    from calibration.wizard.working import Setting
    from mvp.wizard import Answer, Bench, SessionFacts, Step, WizardOptions

FEWEST_VIEWS, MOST_VIEWS, HELD_OUT_VIEWS = 14, 24, 4
BAR_MM = 0.3
_MOST_FAILURES = 12
_NEAR, _FAR, _SHARE = 0.75, 1.3, 0.6
_WHAT = "the expected error at the working distance"


class HandEyeWizard:
    """``mvp-cell calibrate hand-eye``."""

    key: ClassVar[str] = KEY
    writes: ClassVar[str] = "hand_eye"
    sessions: ClassVar[type[SessionStore]] = SessionStore

    def steps(
        self, bench: Bench, store: SessionStore, options: WizardOptions
    ) -> Generator[Step, Answer, Outcome]:
        """Views by information, then held-out ones; see ``Wizard``."""
        setting = setting_of(store)
        lookout = Lookout(bench, store)
        yield from _before(store.facts, setting)
        yield from temperature_told(store)
        yield from before_pictures(store)
        lookout.set_lens(setting.by_name)
        most = options.most_samples or MOST_VIEWS
        told = yield from in_phases(
            store,
            partial(_calibration_views, lookout, setting, most),
            partial(_held_out_views, lookout, setting),
        )
        if told is not Word.FINISH:
            yield from touched(store)
        return self.outcome(store)

    def outcome(self, store: SessionStore) -> Outcome:
        """From the folder alone; see ``Wizard``."""
        return with_touch(store, outcome_of(store))

    def page(self, store: SessionStore, outcome: Outcome) -> str:
        """The report; see ``Wizard``."""
        return page_of(store, outcome)


def _before(facts: SessionFacts, setting: Setting) -> Generator[Step, Answer, None]:
    target_of(facts)
    lens = facts.lens_at(setting.by_name)
    yield Say(
        f"lens at f = {lens.f_mm:.2f} mm, d = {lens.d_mm:.3f} mm, a = {lens.a_mm:.2f} "
        f"mm; errors are stated at {setting.stand_off_mm(facts):.0f} mm"
    )
    for name, found in (("camera", facts.camera), ("lens", facts.lens_table)):
        if found.provenance.origin == "nominal":
            imported = any(cause.code == IMPORTED for cause in found.quality.causes)
            why = (
                "was imported, and nobody says when it was measured and with which "
                f"{name}: the result may be poor"
                if imported
                else "was not calibrated yet: its data sheet is used, and the result will "
                "be poor"
            )
            yield Say(
                f"the {name} {why}; run `mvp-cell calibrate {name}` first", "warning"
            )


@dataclass(frozen=True, eq=False)
class _Session:
    """What is known while views are chosen."""

    lookout: Lookout
    setting: Setting
    aim: Aim
    belief: HandEyeBelief
    knowledge: Knowledge

    @classmethod
    def now(cls, lookout: Lookout, setting: Setting) -> _Session:
        """From all usable samples so far."""
        facts = lookout.facts
        lens = facts.lens_at(setting.by_name)
        samples = list(lookout.store.usable())
        aim = lookout.aim(samples, lens.d_mm)
        belief = HandEyeBelief(
            aim.tool_from_camera,
            aim.base_from_target,
            camera_prior(facts, setting),
            robot_of(facts),
            SIGMA_PX,
        )
        weight = hand_eye_task(belief, setting.stand_off_mm(facts))
        knowledge = Knowledge(belief.before, weight)
        if samples:
            taken = _taken(lookout, belief, samples)
            knowledge = knowledge.after(hand_eye_information(belief, taken))
        return cls(lookout, setting, aim, belief, knowledge)

    @property
    def covered(self) -> Coverage | None:
        """Picture, tilts and sizes; None without a view."""
        store = self.lookout.store
        samples = store.usable()
        if not samples:
            return None
        tool = Poses.of([sample.pose for sample in samples])
        return coverage(store.observations(samples), self.aim.seen_from(tool))

    def candidates(self, *, tilt_rad: float) -> TargetViews:
        """Views that show the target in focus."""
        facts, lookout = self.lookout.facts, self.lookout
        lens = facts.lens_at(self.setting.by_name)
        focus = focus_at(facts, lens, self.setting.limit_px)
        near, far = focus.range_mm()
        middle = self.setting.stand_off_mm(facts)
        within = ViewRange(
            max(near, _NEAR * middle),
            min(far, _FAR * middle),
            tilt_rad=tilt_rad,
            share=lookout.least_share(_SHARE),
        )
        return candidate_views(
            self.belief.prior.camera,
            lookout.size_px,
            lookout.points_mm,
            within,
            lookout.bench.rng(lookout.store.next_number),
            focus=focus,
        )

    def goal(self, views: TargetViews, index: int) -> Goal | Refused:
        """Whether the arm gets to a candidate."""
        one = views.camera_from_target[index : index + 1]
        d_mm = self.lookout.facts.lens_at(self.setting.by_name).d_mm
        return self.lookout.goal(self.aim, one, d_mm)


def _taken(
    lookout: Lookout, belief: HandEyeBelief, samples: list[Sample]
) -> TargetViews:
    """The views so far, with the points that were found in them."""
    tool = Poses.of([sample.pose for sample in samples])
    there = (tool @ belief.tool_from_camera).inverse() @ belief.base_from_target
    views = views_of(belief.prior.camera, lookout.size_px, lookout.points_mm, there)
    seen = np.zeros_like(views.seen)
    for row, sample in zip(seen, samples, strict=True):
        row[np.asarray(sample.ids, dtype=np.int64)] = True
    return replace(views, seen=seen)


def _calibration_views(
    lookout: Lookout, setting: Setting, most: int
) -> Generator[Step, Answer, Word | None]:
    store, failures = lookout.store, 0
    while len(store.usable()) < most and failures < _MOST_FAILURES:
        session = _Session.now(lookout, setting)
        yield _covered(session)
        count = len(store.usable())
        if count >= FEWEST_VIEWS and session.knowledge.error_mm <= BAR_MM:
            return None
        views = session.candidates(tilt_rad=float(np.radians(38)))
        more = hand_eye_information(session.belief, views)
        found = choose(session.knowledge, more, partial(session.goal, views))
        if isinstance(found, NoView):
            yield from lookout.complain(found.reason)
            return None
        left = views_until(session.knowledge, more, BAR_MM)
        words = (
            f"to view {count + 1}: the error falls from {found.now_mm:.2f} to "
            f"{found.forecast_mm:.2f} mm{_outlook(left)}"
        )
        sample = yield from lookout.take(
            found.place, name=f"view {count + 1}", role="calibration", words=words
        )
        if isinstance(sample, Word):
            return sample
        failures += not _good(sample)
    return None


def _good(sample: Sample | None) -> bool:
    return sample is not None and sample.usable


def _outlook(left: int | None) -> str:
    if left is None or left == 0:
        return ""
    return f"; about {left} more until it meets {BAR_MM} mm"


def _covered(session: _Session) -> Covered:
    count = len(session.lookout.store.usable())
    error = session.knowledge.error_mm
    views = ("views", min(count / FEWEST_VIEWS, 1.0))
    forecast = Forecast(_WHAT, error if count else None, BAR_MM, "mm")
    covered = session.covered
    if covered is None:
        return Covered((), (views,), forecast)
    return Covered(covered.grid, (views, *covered.bars), forecast)


def _held_out_views(
    lookout: Lookout, setting: Setting
) -> Generator[Step, Answer, Word | None]:
    """Views at random where the work is done: none of them is the most telling one."""
    store, failures = lookout.store, 0
    yield Say("held-out views: they take no part in the result, and test it")
    while (
        len(store.usable("verification")) < HELD_OUT_VIEWS and failures < _MOST_FAILURES
    ):
        session = _Session.now(lookout, setting)
        views = session.candidates(tilt_rad=float(np.radians(25)))
        found = first_of(len(views), partial(session.goal, views))
        if isinstance(found, NoView):
            yield from lookout.complain(found.reason)
            return None
        number = len(store.usable("verification")) + 1
        sample = yield from lookout.take(
            found,
            name=f"held-out view {number}",
            role="verification",
            words=f"to held-out view {number}",
        )
        if isinstance(sample, Word):
            return sample if sample is Word.UNDO else None
        failures += not _good(sample)
    return None
