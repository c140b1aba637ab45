"""The camera wizard: from a rough idea of the lens to measured intrinsics.

Pre-flight (target, its size, one lens setting, a sharp and well exposed first picture);
then the views that tell most about where points are seen at the working distance, until
the expected error meets the bar and the picture is covered to its border; then held-out
views that have no part in the result.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from calibration.poses import Poses
from calibration.targets import Rejection
from calibration.targets.gather import examined
from calibration.wizard.camera_result import (
    FEWEST,
    outcome_of,
    page_of,
)
from calibration.wizard.camera_views import Progress
from calibration.wizard.lookout import Lookout, focus_at, target_of
from calibration.wizard.next_pose import (
    Knowledge,
    NoView,
    Refused,
    choose,
    views_until,
)
from calibration.wizard.phases import in_phases
from calibration.wizard.preflight import before_pictures, temperature_told
from calibration.wizard.session_store import SessionStore
from calibration.wizard.working import setting_of
from mvp.errors import CalibrationError
from mvp.wizard import Covered, Forecast, Say, Word

if TYPE_CHECKING:
    from collections.abc import Callable, Generator

    from numpy.typing import NDArray

    from calibration.wizard.lookout import Goal
    from calibration.wizard.next_pose import TargetViews
    from calibration.wizard.session_store import Sample
    from calibration.wizard.working import Setting
    from mvp.geometry import FloatArray
    from mvp.wizard import Answer, Bench, Outcome, Step, WizardOptions

FEWEST_VIEWS, MOST_VIEWS, HELD_OUT_VIEWS = 10, 24, 4
BAR_PX = 0.5
_ENOUGH_FIELDS = 0.9
_FAILURES = 12
_SHARP_RISE_PX = 2.0  # of an edge in best focus
_FIRST_FILL = 0.8
_SEARCH_SIGMAS = 2.0
_WHAT = "expected error of a point at the working distance"


class CameraWizard:
    """``mvp-cell calibrate camera``."""

    key: ClassVar[str] = "camera"
    writes: ClassVar[str] = "camera"
    sessions: ClassVar[type[SessionStore]] = SessionStore

    def steps(
        self, bench: Bench, store: SessionStore, options: WizardOptions
    ) -> Generator[Step, Answer, Outcome]:
        """Pre-flight, views by what they tell, held-out views; see ``Wizard``."""
        lookout = Lookout(bench, store)
        yield from _pre_flight(lookout)
        setting = setting_of(store)
        bench.set_lens(zoom=setting.zoom, focus=setting.focus, iris=setting.iris)
        most = options.most_samples or MOST_VIEWS
        yield from in_phases(
            store,
            partial(_first_view, lookout, setting),
            partial(_telling_views, lookout, setting, most),
            partial(_held_out_views, lookout, setting),
        )
        return self.outcome(store)

    def outcome(self, store: SessionStore) -> Outcome:
        """From the folder alone; see ``Wizard``."""
        return outcome_of(store)

    def page(self, store: SessionStore, outcome: Outcome) -> str:
        """The report; see ``Wizard``."""
        return page_of(store, outcome)


# ------------------------------------------------------------------- pre-flight


def _pre_flight(lookout: Lookout) -> Generator[Step, Answer, None]:
    """What is looked at, how large it is, and at which lens setting."""
    store, facts = lookout.store, lookout.facts
    target = target_of(facts)
    setting = setting_of(store)
    lens = facts.lens_at(setting.by_name)
    yield Say(
        f"target: {target.kind}, {target.columns} x {target.rows}, "
        f"{target.square_mm:g} mm; lens locked at f {lens.f_mm:.2f}, d {lens.d_mm:.3f}, "
        f"a {lens.a_mm:.2f} mm, sharp at {setting.stand_off_mm(facts):.0f} mm"
    )
    yield from temperature_told(store)
    yield from before_pictures(store)


def _first_view(
    lookout: Lookout, setting: Setting
) -> Generator[Step, Answer, Word | None]:
    """The whole target from the front; beside it where it is not found at once.

    Raises:
        CalibrationError: it is not found, or not seen well enough.
    """
    store = lookout.store
    reason, action = "no picture was taken", "allow the motion"
    for shift in _search(lookout):
        if store.usable():
            return None
        goal = _frontal(lookout, setting, shift)
        if isinstance(goal, Refused):
            reason = goal.reason
            action = "give the arm more room, or move the target"
            continue
        sample = yield from lookout.take(
            goal,
            name=f"view {store.next_number}",
            role="calibration",
            words="to a first view of the whole target",
        )
        if sample is Word.UNDO:
            return Word.UNDO
        if sample is None or isinstance(sample, Word):
            continue
        if sample.usable:
            yield from _looked_at(lookout, setting, sample)
            return None
        reason, action = sample.reason, sample.action
    if store.usable():
        return None
    raise CalibrationError(
        f"the target is not seen: {reason}",
        hint=f"{action}; check where [target] of the cell file says that it lies",
        where=lookout.facts.cell,
    )


def _looked_at(
    lookout: Lookout, setting: Setting, sample: Sample
) -> Generator[Step, Answer, None]:
    """Is the first picture as sharp as the lens table says, and well exposed?"""
    found = examined(_grey(lookout, sample), lookout.layout)
    if isinstance(found, Rejection):
        return
    figures = found[1]
    facts = lookout.facts
    focus = focus_at(facts, facts.lens_at(setting.by_name), setting.limit_px)
    depth = lookout.sight(sample).translation_mm[:, 2]
    foreseen = float(focus.blur_px(depth)[0]) + _SHARP_RISE_PX
    text = (
        f"exposure {1000 * sample.exposure_s:.1f} ms; edges are {figures.rise_px:.1f} px "
        f"wide, {foreseen:.1f} px were foreseen"
    )
    if figures.rise_px > foreseen + setting.limit_px:
        text += ": the lens is focused elsewhere than its table says"
        yield Say(f"{text}; corners are found, but less well", "warning")
    else:
        yield Say(text, "good")


def _grey(lookout: Lookout, sample: Sample) -> NDArray[np.uint8]:
    pixels = lookout.store.image(sample)
    scaled = pixels.astype(np.float64) * (255 / sample.full_scale)
    return np.clip(np.rint(scaled), 0, 255).astype(np.uint8)


def _search(lookout: Lookout) -> FloatArray:
    """Where the target may be instead, (n, 2) mm in its plane; first where it should."""
    step = _SEARCH_SIGMAS * target_of(lookout.facts).position_sigma_mm + 20.0
    return step * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]], np.float64)


def _frontal(
    lookout: Lookout, setting: Setting, shift_mm: FloatArray
) -> Goal | Refused:
    """The target's middle on the axis, square to it, so far away that it fits."""
    progress = Progress.now(lookout, setting)
    facts = lookout.facts
    lens = facts.lens_at(setting.by_name)
    points = lookout.points_mm
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    middle[:2] += shift_mm
    span = np.ptp(points[:, :2], axis=0)
    camera = progress.camera
    fitting = (
        span * [camera.fx_px, camera.fy_px] / (_FIRST_FILL * np.array(lookout.size_px))
    )
    near, far = focus_at(facts, lens, setting.limit_px).range_mm()
    distance = float(np.clip(fitting.max(), near, far))
    reason: Refused | None = None
    for roll in np.radians([0, 90, 180, 270]):
        turn = np.array(
            [
                [np.cos(roll), -np.sin(roll), 0],
                [np.sin(roll), np.cos(roll), 0],
                [0, 0, 1],
            ]
        )
        there = Poses(turn[None], (np.array([0, 0, distance]) - turn @ middle)[None])
        goal = lookout.goal(progress.aim, there, lens.d_mm)
        if not isinstance(goal, Refused):
            return goal
        reason = goal
    return reason or Refused("no roll was tried")


# ------------------------------------------------------------------- views


def _telling_views(
    lookout: Lookout, setting: Setting, most: int
) -> Generator[Step, Answer, Word | None]:
    """Views until the expected error meets the bar and the picture is covered."""
    store, failures, shown = lookout.store, 0, -1
    while len(store.usable()) < most and failures < _FAILURES:
        progress = Progress.now(lookout, setting)
        if shown != store.count:
            shown = store.count
            yield _covered(progress)
        missing = _missing(progress)
        if not missing:
            return None
        views = progress.candidates()
        found = _chosen(progress, views, missing)
        if isinstance(found, str):
            yield from lookout.complain(found)
            return None
        goal, words = found
        count = len(store.usable())
        sample = yield from lookout.take(
            goal, name=f"view {store.next_number}", role="calibration", words=words
        )
        if sample is Word.FINISH and count >= FEWEST:
            return Word.FINISH
        if sample is Word.FINISH:
            yield Say(f"at least {FEWEST} views are needed", "warning")
            continue
        if sample is Word.UNDO:
            return Word.UNDO
        failures += not getattr(sample, "usable", False)
    return None


def _missing(progress: Progress) -> str:
    """What the views do not give yet: ``error``, ``fields`` or nothing."""
    count = len(progress.lookout.store.usable())
    if count < FEWEST_VIEWS or progress.knowledge.error_mm > _bar_mm(progress):
        return "error"
    covered = progress.covered
    return "fields" if covered is None or covered.share < _ENOUGH_FIELDS else ""


def _chosen(
    progress: Progress, views: TargetViews, missing: str
) -> tuple[Goal, str] | str:
    """Where to go and why; a reason where there is nowhere."""
    number = progress.lookout.store.next_number
    goal = _goals(progress, views)
    if missing == "fields":
        flat, more = Knowledge(np.eye(1), np.eye(1)), progress.new_fields(views)
        if not more.any():
            return "no view in focus would fill the empty fields of the picture"
        found = choose(flat, more, goal)
        words = f"to view {number}: for the empty fields of the picture"
    else:
        more = progress.information(views)
        found = choose(progress.knowledge, more, goal)
        left = views_until(progress.knowledge, more, _bar_mm(progress))
        words = f"to view {number}{_outlook(left)}"
    return found.reason if isinstance(found, NoView) else (found.place, words)


def _goals(progress: Progress, views: TargetViews) -> Callable[[int], Goal | Refused]:
    """Whether and how the arm gets to a candidate."""
    lens = progress.lookout.facts.lens_at(progress.setting.by_name)

    def goal(index: int) -> Goal | Refused:
        one = views.camera_from_target[index : index + 1]
        return progress.lookout.goal(progress.aim, one, lens.d_mm)

    return goal


def _outlook(left: int | None) -> str:
    return f"; about {left} more until the error meets its bar" if left else ""


def _bar_mm(progress: Progress) -> float:
    return BAR_PX * progress.mm_per_px


def _covered(progress: Progress) -> Covered:
    count = len(progress.lookout.store.usable())
    value = progress.knowledge.error_mm if count >= FEWEST else None
    forecast = Forecast(_WHAT, value, _bar_mm(progress), "mm")
    views = ("views", min(count / FEWEST_VIEWS, 1.0))
    covered = progress.covered
    if covered is None:
        return Covered((), (views,), forecast)
    return Covered(covered.grid, (views, *covered.bars), forecast)


def _held_out_views(
    lookout: Lookout, setting: Setting
) -> Generator[Step, Answer, Word | None]:
    """Views as the work is done: none of them is the most telling one."""
    store, failures = lookout.store, 0
    yield Say("held-out views: they take no part in the result, and test it")
    while len(store.usable("verification")) < HELD_OUT_VIEWS and failures < _FAILURES:
        progress = Progress.now(lookout, setting)
        views = progress.candidates(calm=True)
        alike = np.zeros((len(views), 1, 1))
        flat = Knowledge(np.eye(1), np.eye(1))
        found = choose(flat, alike, _goals(progress, views))
        if isinstance(found, NoView):
            yield from lookout.complain(found.reason)
            return None
        number = len(store.usable("verification")) + 1
        sample = yield from lookout.take(
            found.place,
            name=f"held-out view {number}",
            role="verification",
            words=f"to held-out view {number}",
        )
        if isinstance(sample, Word):
            return sample
        failures += not getattr(sample, "usable", False)
    return None
