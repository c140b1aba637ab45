"""The part wizard: where a part lies, found from its own edges and holes.

The views are the plan's own and others from aside; the drawing of the part says which
line is which. Every picture improves the belief that the next view is aimed by.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from calibration.wizard.part_held_out import HELD_OUT, VERIFICATION, not_wanted
from calibration.wizard.part_page import page_of
from calibration.wizard.part_result import (
    KEY,
    found_of,
    middle_sigma_mm,
    outcome_of,
    remember_plan,
)
from calibration.wizard.part_sight import look
from calibration.wizard.phases import in_phases
from calibration.wizard.preflight import temperature_told
from calibration.wizard.session_store import SessionStore
from mvp.errors import LimitError
from mvp.wizard import (
    Allow,
    Covered,
    Forecast,
    Outcome,
    Refusal,
    Sampled,
    Say,
    Word,
    Working,
)

if TYPE_CHECKING:
    from collections.abc import Generator

    from calibration.wizard.part_result import Found
    from calibration.wizard.session_store import Sample
    from mvp.geometry import Pose
    from mvp.wizard import Answer, Bench, Shot, SightView, Step, WizardOptions

FEWEST_VIEWS = 3
BAR_MM = 0.3
_METERING_FRAMES = 6
_CLOSE_ENOUGH = 1.3
_WHAT = "how well the middle of the features is known (95 %)"


class PartWizard:
    """``mvp-cell calibrate part``."""

    key: ClassVar[str] = KEY
    writes: ClassVar[str] = "part_pose"
    sessions: ClassVar[type[SessionStore]] = SessionStore

    def steps(
        self, bench: Bench, store: SessionStore, options: WizardOptions
    ) -> Generator[Step, Answer, Outcome]:
        """The plan's views, then others from aside; see ``Wizard``."""
        yield from temperature_told(store)
        yield Working("planning views of the part")
        views = list(bench.sights.views())
        if not store.count:
            remember_plan(store, views)
            store.remember(HELD_OUT, options.verify)
        yield Say(
            f"the part is looked at from up to {len(views)} sides; it is expected where "
            "part_pose of the cell says, to some millimetres"
        )
        kept_apart = int(not not_wanted(store) and len(views) > 1)
        most = min(len(views) - kept_apart, options.most_samples or len(views))
        session = _Session(bench, store, views)
        phases = [partial(_telling_views, session, most)]
        if kept_apart:
            phases.append(partial(_kept_apart, session))
        yield from in_phases(store, *phases)
        return self.outcome(store)

    def outcome(self, store: SessionStore) -> Outcome:
        """From the folder alone; see ``Wizard``."""
        return outcome_of(store)

    def page(self, store: SessionStore, outcome: Outcome) -> str:
        """The report of the located part; see ``Wizard``."""
        return page_of(store, outcome)


@dataclass(frozen=True, eq=False)
class _Session:
    """What the phases share.

    Attributes:
        bench: moves and looks.
        store: keeps the pictures.
        views: where to look from, in this order.
        unwanted: names of views that the arm cannot or should not take.
    """

    bench: Bench
    store: SessionStore
    views: list[SightView]
    unwanted: set[str] = field(default_factory=set)

    def next(self) -> SightView | None:
        """The first view that nobody refused and that has no picture."""
        return self._without({sample.name for sample in self.store.samples})

    def again(self) -> SightView | None:
        """A view whose picture was of no use while nobody knew where the part lies."""
        samples = self.store.samples
        return self._without(
            {s.name for s in samples if s.usable or s.role == VERIFICATION}
        )

    def _without(self, names: set[str]) -> SightView | None:
        left = (v for v in self.views if v.name not in names | self.unwanted)
        return next(left, None)


def _telling_views(
    session: _Session, most: int
) -> Generator[Step, Answer, Word | None]:
    """Views until it is known well enough where the part lies."""
    store, fewest = session.store, min(FEWEST_VIEWS, most)
    found = found_of(store)
    while len(store.usable()) < most:
        if len(store.usable()) >= fewest and _error_mm(found) <= BAR_MM:
            break
        view = session.next()
        if view is None:
            break
        word = yield from _taken(session, view, _believed(store, found))
        if word is not None:
            return word
        found = found_of(store)
        yield _covered(len(store.usable()) / fewest, found)
    return None


def _kept_apart(session: _Session) -> Generator[Step, Answer, Word | None]:
    """One more view, which takes no part in the result, and tests it."""
    store = session.store
    if not store.usable():
        return None
    yield Say("a held-out view: it takes no part in the result, and tests it")
    while not store.usable(VERIFICATION):
        view = session.next() or session.again()
        if view is None:
            yield Say("no view is left to be kept apart", "warning")
            return None
        believed = _believed(store, found_of(store))
        word = yield from _taken(session, view, believed, role=VERIFICATION)
        if word is not None:
            return word
    return None


def _taken(
    session: _Session,
    view: SightView,
    believed: Pose,
    *,
    role: str = "calibration",
) -> Generator[Step, Answer, Word | None]:
    """Look from there; the word when one was said instead."""
    told = yield from _looked(session.bench, session.store, view, believed, role=role)
    if isinstance(told, Word):
        return told
    if told is None:
        session.unwanted.add(view.name)
    return None


def _looked(
    bench: Bench,
    store: SessionStore,
    view: SightView,
    believed: Pose,
    *,
    role: str,
) -> Generator[Step, Answer, Sample | Word | None]:
    """Drive there and look; None when the arm cannot or should not."""
    goal = believed @ view.part_from_camera
    stand = bench.joints_for(goal, d_mm=view.d_mm)
    if isinstance(stand, Refusal):
        yield Say(f"{view.name} is left out: {stand.reason}")
        return None
    way = bench.way_to(stand.joints)
    if isinstance(way, Refusal):
        yield Say(f"{view.name} is left out: {way.reason}")
        return None
    allowed = yield Allow(f"to look at the part: {view.name}", way.seconds)
    if isinstance(allowed, Word):
        return allowed
    if not allowed:
        return None
    bench.move(stand.joints)
    steps = view.lens_steps
    bench.set_lens(zoom=steps["zoom"], focus=steps["focus"], iris=steps["iris"])
    shot, there = _shot(bench, believed)
    yield Working(f"measuring the part in {view.name}")
    seen = look(bench.sights, shot, store.facts, there)
    sample = store.add(shot, seen.finding(shot), name=view.name, role=role)
    yield Sampled(
        sample.number, sample.name, sample.usable, sample.reason, sample.action
    )
    return sample


def _shot(bench: Bench, believed: Pose) -> tuple[Shot, Pose]:
    """A picture exposed for the part's features, and where they should be in it."""
    facts, shot = bench.facts, bench.shoot()
    d_mm = facts.lens_at(dict(shot.lens_steps)).d_mm
    camera = shot.base_from_tool @ facts.tool_from_camera(d_mm)
    there = camera.inverse() @ believed
    for _ in range(_METERING_FRAMES):
        factor = bench.sights.exposure_factor(shot, there)
        if 1 / _CLOSE_ENOUGH < factor < _CLOSE_ENOUGH:
            break
        try:
            shot = bench.shoot(shot.exposure_s * factor)
        except LimitError:
            break  # the camera cannot; what there is may do
    return shot, there


def _believed(store: SessionStore, found: Found | None) -> Pose:
    """Where the part lies by all pictures so far."""
    return store.facts.base_from_part if found is None else found.located.base_from_part


def _error_mm(found: Found | None) -> float:
    return np.inf if found is None else 1.96 * middle_sigma_mm(found)


def _covered(share: float, found: Found | None) -> Covered:
    error = _error_mm(found)
    return Covered(
        bars=(("views", min(share, 1.0)),),
        forecast=Forecast(_WHAT, error if np.isfinite(error) else None, BAR_MM, "mm"),
    )
