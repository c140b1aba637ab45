"""What the motors do beside zoom and focus: play between motor and glass, and the iris.

Play: one picture after an approach from each side, twice, the arm standing; how large
the target is tells zoom and focus, how bright the picture is tells the iris. One more
picture a little further on tells how much a step is.
Iris: a tilted target at several focus settings, so that its edges lie on both sides of
the sharp place; how fast they blur is the pupil.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from calibration.lens_table import BothSides, Hysteresis, measure_hysteresis
from calibration.wizard.lens_plan import iris_steps, node_at
from calibration.wizard.lookout import camera_at, focus_at
from calibration.wizard.next_pose import NoView, ViewRange, candidate_views, first_of
from calibration.wizard.session_store import Sample
from mvp.devices import AXES
from mvp.wizard import Say, Word, Working

if TYPE_CHECKING:
    from collections.abc import Generator, Sequence

    from calibration.wizard.lens_plan import NodePlan
    from calibration.wizard.lookout import Goal, Lookout
    from calibration.wizard.next_pose import Refused, TargetViews
    from calibration.wizard.next_pose_aim import Aim
    from calibration.wizard.session_store import SessionStore
    from mvp.devices import Axis
    from mvp.wizard import Answer, SessionFacts, Step

SIDES, IRIS = "sides", "iris"
BELOW, ABOVE, FURTHER = "from_below", "from_above", "further"
_ROUTE = (BELOW, FURTHER, ABOVE, BELOW, ABOVE)
_PLACES: dict[Axis, tuple[float, ...]] = {
    "zoom": (0.5,),
    "focus": (0.35, 0.65),
    "iris": (0.5,),
}
_RUN_SHARE, _RUN_BACKLASH, _RUN_LEAST = 0.04, 4, 8
_BLUR_PX = 5.0
_IRIS_TILT_RAD = float(np.radians(28))
_DIM = 0.8


@dataclass(frozen=True)
class Side:
    """One motor at one step, for the measurement of play.

    Attributes:
        axis: the motor.
        step: where.
        run_steps: how far it comes from; more than any play.
        by_steps: how far the picture is that tells what a step is.
    """

    axis: Axis
    step: int
    run_steps: int
    by_steps: int

    @property
    def name(self) -> str:
        """For samples."""
        return f"{self.axis} {self.step}"


def plan_sides(facts: SessionFacts, nodes: Sequence[NodePlan]) -> tuple[Side, ...]:
    """Where play is measured: inside the steps of the nodes."""
    found: list[Side] = []
    model = facts.lens_table
    tables = {
        "zoom": model.zoom_f_mm,
        "focus": model.focus_extension_mm,
        "iris": model.iris_a_mm,
    }
    ends: dict[Axis, tuple[int, int]] = {
        "zoom": (min(n.zoom for n in nodes), max(n.zoom for n in nodes)),
        "focus": (min(n.focus for n in nodes), max(n.focus for n in nodes)),
        "iris": facts.table.iris.range_steps,
    }
    for axis in AXES:
        low, high = ends[axis]
        if low == high:
            continue
        run = max(
            int(_RUN_SHARE * (high - low)),
            _RUN_BACKLASH * tables[axis].backlash_steps,
            _RUN_LEAST,
        )
        run = min(run, (high - low) // 4)
        found += [
            Side(axis, low + int(share * (high - low)), run, max(run // 2, 1))
            for share in _PLACES[axis]
        ]
    return tuple(found)


def facing(lookout: Lookout, node: NodePlan, *, tilt_rad: float) -> Goal | NoView:
    """The first place from where the target is seen well at a node."""
    facts = lookout.facts
    lens = facts.lens_at(node.steps)
    every = [s for s in lookout.store.samples if s.usable]
    aim = lookout.aim(every[-10:], lens.d_mm)
    within = ViewRange(
        0.95 * node.sharp_mm,
        1.05 * node.sharp_mm,
        tilt_rad=tilt_rad,
        places=0.15,
        share=0.3,
        fill=0.3,
    )
    views = candidate_views(
        camera_at(facts, lens),
        lookout.size_px,
        lookout.points_mm,
        within,
        lookout.bench.rng(lookout.store.next_number),
        focus=focus_at(facts, lens, 6.0),
    )
    one = partial(_goal, lookout, aim, views, lens.d_mm)
    return first_of(len(views), one)


def _goal(
    lookout: Lookout, aim: Aim, views: TargetViews, d_mm: float, index: int
) -> Goal | Refused:
    return lookout.goal(aim, views.camera_from_target[index : index + 1], d_mm)


def both_sides(
    lookout: Lookout, node: NodePlan, sides: Sequence[Side]
) -> Generator[Step, Answer, Word | None]:
    """Pictures after approaches from both sides; the arm stands at one place."""
    store = lookout.store
    left = [side for side in sides if not _is_read(store, side)]
    if not left:
        return None
    lookout.set_lens(node.steps)
    goal = facing(lookout, node, tilt_rad=0.1)
    if isinstance(goal, NoView):
        yield Say(f"play cannot be measured: {goal.reason}", "warning")
        return None
    told = yield from lookout.take(
        goal,
        name="play, first picture",
        role="first",
        words="to where the play of the motors is measured",
    )
    if not isinstance(told, Sample):
        return told
    for number, side in enumerate(left):
        yield Working(f"play of {side.axis}", number, len(left))
        exposure = _DIM * told.exposure_s if side.axis == "iris" else None
        word = yield from _one_place(lookout, node, side, exposure)
        if word is not None:
            return word
    lookout.set_lens(node.steps)
    return None


def _one_place(
    lookout: Lookout, node: NodePlan, side: Side, exposure_s: float | None
) -> Generator[Step, Answer, Word | None]:
    here = side.step
    for stop in _ROUTE:
        if stop == FURTHER:
            _straight(lookout, node, side.axis, here + side.by_steps)
        else:
            sign = -1 if stop == BELOW else 1
            _straight(lookout, node, side.axis, here + sign * side.run_steps)
            _straight(lookout, node, side.axis, here)
        sample = yield from lookout.take(
            None,
            name=f"{side.name} {stop}",
            role=SIDES,
            words="",
            extra={"place": side.name, "stop": stop},
            exposure_s=exposure_s,
            sharp=False,
        )
        if isinstance(sample, Word):
            return sample
    return None


def _straight(lookout: Lookout, node: NodePlan, axis: Axis, step: int) -> None:
    lookout.set_lens({**node.steps, axis: step}, straight=True)


def _is_read(store: SessionStore, side: Side) -> bool:
    """From both sides twice, and how much a step is."""
    counts = [len(readings_of(store, side, stop)) for stop in (BELOW, ABOVE, FURTHER)]
    return min(counts[:2]) >= 2 and counts[2] >= 1


def readings_of(store: SessionStore, side: Side, stop: str) -> list[Sample]:
    """Usable samples of one place and stop."""
    return [
        s
        for s in store.usable(SIDES)
        if s.extra.get("place") == side.name and s.extra.get("stop") == stop
    ]


def hysteresis_of(store: SessionStore, sides: Sequence[Side]) -> dict[Axis, Hysteresis]:
    """Play of every motor that was looked at from both sides."""
    found: dict[Axis, Hysteresis] = {}
    for axis in AXES:
        rows = [_row(store, side) for side in sides if side.axis == axis]
        good = [row for row in rows if row is not None]
        if good:
            steps, below, above, slope = zip(*good, strict=True)
            order = np.argsort(steps)
            found[axis] = measure_hysteresis(
                BothSides(
                    np.array(steps, dtype=np.int64)[order],
                    np.array(below)[order],
                    np.array(above)[order],
                    np.array(slope)[order],
                )
            )
    return found


def _row(
    store: SessionStore, side: Side
) -> tuple[int, list[float], list[float], float] | None:
    groups = [readings_of(store, side, stop) for stop in (BELOW, ABOVE, FURTHER)]
    if min(len(group) for group in groups[:2]) < 2 or not groups[2]:
        return None
    every = [sample for group in groups for sample in group]
    common = set(every[0].ids).intersection(*(s.ids for s in every[1:]))
    if side.axis != "iris" and len(common) < 6:
        return None
    below, above, further = (
        [_reading(store, s, side.axis, common) for s in group] for group in groups
    )
    slope = (float(np.mean(further)) - float(np.mean(below))) / side.by_steps
    return (side.step, below[:2], above[:2], slope) if slope else None


def _reading(
    store: SessionStore, sample: Sample, axis: Axis, common: set[int]
) -> float:
    """What follows the glass: the logarithm of the target's size, or of the pupil."""
    if axis == "iris":
        picture = store.image(sample).astype(np.float64)
        return float(0.5 * np.log(max(picture.mean(), 1e-6)))
    rows = [i for i, number in enumerate(sample.ids) if number in common]
    pixels = sample.found_pixels[rows]
    return float(0.5 * np.log(((pixels - pixels.mean(axis=0)) ** 2).mean()))


# --------------------------------------------------------------------------- iris


def iris_node(facts: SessionFacts, nodes: Sequence[NodePlan]) -> NodePlan:
    """Where the pupil is measured: at the shortest f, where focus blurs most."""
    zoom = min(nodes, key=lambda n: float(facts.table.zoom.value_mm(n.zoom))).zoom
    mine = sorted((n for n in nodes if n.zoom == zoom), key=lambda n: n.sharp_mm)
    return mine[(len(mine) - 1) // 2]


def iris_views(
    lookout: Lookout, nodes: Sequence[NodePlan], count: int
) -> Generator[Step, Answer, Word | None]:
    """Every iris at focus settings on both sides of the sharp place."""
    store, facts = lookout.store, lookout.facts
    node = iris_node(facts, nodes)
    wanted = [
        (iris, focus)
        for iris in iris_steps(facts, count)
        for focus in _blurring(facts, nodes, node, iris)
    ]
    have = {(s.lens_steps["iris"], s.lens_steps["focus"]) for s in store.usable(IRIS)}
    left = [pair for pair in wanted if pair not in have]
    if not left:
        return None
    lookout.set_lens(node.steps)
    goal = facing(lookout, node, tilt_rad=_IRIS_TILT_RAD)
    if isinstance(goal, NoView):
        yield Say(f"the iris cannot be measured: {goal.reason}", "warning")
        return None
    place: Goal | None = goal
    for number, (iris, focus) in enumerate(left):
        yield Working("iris", number, len(left))
        lookout.bench.set_lens(zoom=node.zoom, focus=focus, iris=iris)
        sample = yield from lookout.take(
            place,
            name=f"iris {iris} focus {focus}",
            role=IRIS,
            words="to where the iris is measured",
            sharp=False,
        )
        if not isinstance(sample, Sample):
            return sample
        place = None
    return None


def _blurring(
    facts: SessionFacts, nodes: Sequence[NodePlan], node: NodePlan, iris: int
) -> list[int]:
    """Focus steps with discs of some pixels on both sides, within those of the nodes."""
    table = facts.table
    lens = table.setting(node.zoom, node.focus, iris)
    change = _BLUR_PX * facts.sensor.pitch_y_mm / lens.a_mm * lens.f_mm
    ends = [float(table.focus.value_mm(f)) for f in {n.focus for n in nodes}]
    x = float(table.focus.value_mm(node.focus))
    places = np.clip([x - change, x, x + change], min(ends), max(ends))
    return sorted({table.focus.nearest_step(float(place)) for place in places})


def best_node(facts: SessionFacts, nodes: Sequence[NodePlan]) -> NodePlan:
    """The node in the middle of the zoom, for the play of the motors."""
    zooms = sorted({n.zoom for n in nodes})
    zoom = zooms[(len(zooms) - 1) // 2]
    mine = sorted((n for n in nodes if n.zoom == zoom), key=lambda n: n.sharp_mm)
    middle = mine[len(mine) // 2]
    return node_at(facts, middle.zoom, middle.focus)
