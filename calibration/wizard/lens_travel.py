"""A node where the depth of field forbids tilt: a squarely faced target and a travel.

How the travel is laid along the optical axis before hand-eye is known: a few small moves
of the tool along its own axes, without turning, tell how the camera's axes lie in the
tool; after a travel the one point of the picture that did not move tells by how much the
direction still misses the axis. It is turned by that and travelled again.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np

from calibration.camera_start import poses_with
from calibration.lens_table import (
    TravelPrior,
    TravelShots,
    camera_from_tool,
    filled_share,
    measure_travel,
    next_direction,
)
from calibration.poses import Poses
from calibration.wizard.lens_nodes import samples_of
from calibration.wizard.lookout import camera_at
from calibration.wizard.next_pose import Refused
from calibration.wizard.phases import take_back
from mvp.errors import CalibrationError
from mvp.geometry import Pose
from mvp.wizard import Say, Word

if TYPE_CHECKING:
    from collections.abc import Generator, Mapping, Sequence

    from pydantic import JsonValue

    from calibration.lens_table import TravelResult
    from calibration.wizard.lens_plan import NodePlan
    from calibration.wizard.lookout import Lookout
    from calibration.wizard.session_store import Sample, SessionStore
    from mvp.geometry import FloatArray
    from mvp.wizard import Answer, Step

    Told = Generator[Step, Answer, Word | None]

TRAVEL, AXIS = "travel", "axis"
SIGMA_PX = 0.05
_MOVE_MM, _TRIAL_STOPS, _STOPS = 12.0, 4, 7
_TRAVEL_SHARE, _ON_AXIS_RAD, _TRIALS = 0.24, float(np.radians(0.4)), 2
_FEWEST_POINTS = 12
_LEAST_CENTRE_PX, _LEAST_K1 = 1.0, 0.002


def travelled(lookout: Lookout, plan: NodePlan) -> Told:
    """Small moves, trial travels until they meet the axis, and the travel itself."""
    store = lookout.store
    if len(stops_of(store, plan)) >= _STOPS - 1:
        return None
    yield Say(
        f"{plan.name}: the depth of field forbids tilt; the camera will travel along its "
        "axis, which small moves find first"
    )
    start = _faced(lookout, plan)
    label = f"moves from {store.next_number}"
    word = yield from _moves(lookout, plan, start, label)
    if word is not None:
        return word
    turn = _camera_in_tool(store, plan, label)
    direction = turn.T[:, 2]
    for _ in range(_TRIALS):
        label = f"trial from {store.next_number}"
        word = yield from _stops(
            lookout, plan, AXIS, start, direction, _TRIAL_STOPS, label
        )
        if word is not None:
            return word
        found = _measured(store, _labelled(store, plan, AXIS, label))
        direction = next_direction(direction, turn, found.direction_camera)
        if found.off_axis_rad < _ON_AXIS_RAD:
            break
    label = f"travel from {store.next_number}"
    word = yield from _stops(lookout, plan, TRAVEL, start, direction, _STOPS, label)
    return word


def measured(store: SessionStore, plan: NodePlan) -> TravelResult:
    """What the travel of a node tells.

    Raises:
        CalibrationError: too few stops, or they have too few points in common.
    """
    return _measured(store, stops_of(store, plan))


def _measured(store: SessionStore, samples: Sequence[Sample]) -> TravelResult:
    common = set.intersection(*(set(s.ids) for s in samples)) if samples else set()
    if len(samples) < _TRIAL_STOPS - 1 or len(common) < _FEWEST_POINTS:
        raise CalibrationError(
            f"{len(samples)} stops with {len(common)} points in common do not make a "
            "travel",
            hint="let the target fill less of the picture, and light it evenly",
        )
    facts = store.facts
    sensor, camera = facts.sensor, facts.camera
    stated = camera.standard_deviation
    prior = TravelPrior(
        (camera.centre_x_px, camera.centre_y_px),
        max(
            stated.get("centre_x_px", 0.0),
            stated.get("centre_y_px", 0.0),
            _LEAST_CENTRE_PX,
        ),
        camera.k1,
        max(stated.get("k1", 0.0), _LEAST_K1),
        sensor.pitch_x_mm / sensor.pitch_y_mm,
    )
    chosen = [_rows(s, common) for s in samples]
    shots = TravelShots(
        _along(samples),
        samples[0].found_points_mm[chosen[0]],
        np.stack([s.found_pixels[r] for s, r in zip(samples, chosen, strict=True)]),
        SIGMA_PX,
        facts.robot.position_mm,
        float(np.radians(facts.robot.angle_deg)),
    )
    return measure_travel(shots, prior)


def stops_of(store: SessionStore, plan: NodePlan) -> tuple[Sample, ...]:
    """The usable stops of the last travel itself."""
    every = _mine(store, plan, TRAVEL)
    if not every:
        return ()
    return _labelled(store, plan, TRAVEL, str(every[-1].extra.get("label")))


def _labelled(
    store: SessionStore, plan: NodePlan, role: str, label: str
) -> tuple[Sample, ...]:
    """Those of one line of stops; a session that was resumed may have begun another."""
    every = _mine(store, plan, role)
    return tuple(s for s in every if s.extra.get("label") == label)


def share_of(store: SessionStore, plan: NodePlan) -> float:
    """Share of the picture's short side that the target filled."""
    return filled_share(store.observations(stops_of(store, plan)))


def _mine(store: SessionStore, plan: NodePlan, role: str) -> tuple[Sample, ...]:
    return samples_of(store.usable(role), plan.zoom, plan.focus)


def _rows(sample: Sample, common: set[int]) -> list[int]:
    """Rows of the common points, in the order of their ids."""
    place = {number: row for row, number in enumerate(sample.ids)}
    return [place[number] for number in sorted(common)]


def _along(samples: Sequence[Sample]) -> FloatArray:
    """(n,): how far along the line each stop is, as the arm told."""
    places = np.array([s.pose.translation_mm for s in samples])
    places = places - places.mean(axis=0)
    line = np.linalg.svd(places)[2][0]
    asked = [cast("float", s.extra.get("travel_mm", 0.0)) for s in samples]
    along = places @ line
    return np.asarray(along * np.sign(along @ np.asarray(asked)))


def _faced(lookout: Lookout, plan: NodePlan) -> Pose:
    """``base_from_tool`` where the target is faced squarely, by the aim."""
    lens = lookout.facts.lens_at(plan.steps)
    every = [s for s in lookout.store.samples if s.usable]
    aim = lookout.aim(every[-10:], lens.d_mm)
    points = lookout.points_mm
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    place = np.array([0.0, 0.0, plan.sharp_mm]) - middle
    facing = Poses(np.eye(3)[None], place[None])
    return aim.tool_for(facing).pose(0, "base", "tool")


def _moves(lookout: Lookout, plan: NodePlan, start: Pose, label: str) -> Told:
    """The start, and there and back along each axis of the tool."""
    ways = np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)])
    moves = _MOVE_MM * ways
    extras: list[dict[str, JsonValue]] = [
        {"move_mm": move.tolist(), "label": label} for move in moves
    ]
    word = yield from _line(lookout, plan, AXIS, start, moves, extras)
    return word


def _stops(
    lookout: Lookout,
    plan: NodePlan,
    role: str,
    start: Pose,
    direction: FloatArray,
    count: int,
    label: str,
) -> Told:
    """Stops along a direction (tool axes) about the start."""
    half = _TRAVEL_SHARE * plan.sharp_mm / 2
    travels = np.linspace(-half, half, count)
    extras: list[dict[str, JsonValue]] = [
        {"travel_mm": float(travel), "label": label} for travel in travels
    ]
    moves = travels[:, None] * direction
    word = yield from _line(lookout, plan, role, start, moves, extras)
    return word


def _line(
    lookout: Lookout,
    plan: NodePlan,
    role: str,
    start: Pose,
    moves_mm: FloatArray,
    extras: Sequence[Mapping[str, JsonValue]],
) -> Told:
    """A picture at each stop; one that is taken back is taken again.

    Before the first one, the word is for whoever took the picture before.
    """
    taken: list[int] = []
    number = 0
    while number < len(moves_mm):
        told = yield from _one(
            lookout, plan, role, start, moves_mm[number], number, extras[number]
        )
        if told is Word.FINISH or (told is Word.UNDO and not taken):
            return Word.FINISH if told is Word.FINISH else Word.UNDO
        if told is Word.UNDO:
            yield from take_back(lookout.store)
            number = taken.pop()
            continue
        if told is not None:
            taken.append(number)
        number += 1
    return None


def _one(
    lookout: Lookout,
    plan: NodePlan,
    role: str,
    start: Pose,
    move_mm: FloatArray,
    number: int,
    extra: Mapping[str, JsonValue],
) -> Generator[Step, Answer, Sample | Word | None]:
    """One picture at the start moved along the tool's own axes, without turning."""
    d_mm = lookout.facts.lens_at(plan.steps).d_mm
    shift = Pose("tool", "tool", np.eye(3), np.asarray(move_mm, np.float64))
    goal = lookout.goal_of_tool(start @ shift, d_mm)
    if isinstance(goal, Refused):
        yield Say(f"{plan.name}: {goal.reason}", "warning")
        return None
    sample = yield from lookout.take(
        goal,
        name=f"{plan.name} {extra['label']} {number + 1}",
        role=role,
        words=f"to stop {number + 1} of the {extra['label']} at {plan.name}",
        extra=extra,
        sharp=False,
    )
    return sample


def _camera_in_tool(store: SessionStore, plan: NodePlan, label: str) -> FloatArray:
    """(3, 3), how the camera is turned in the tool, from the small moves.

    Raises:
        CalibrationError: too few of them could be made.
    """
    samples = _labelled(store, plan, AXIS, label)
    facts = store.facts
    camera = camera_at(facts, facts.lens_at(plan.steps))
    if not samples:
        raise CalibrationError(
            f"{plan.name}: the target was not found while the axis was looked for",
            hint="check the light, and where [target] of the cell file says it lies",
        )
    there = poses_with(camera, store.observations(samples))
    middle = _middle(samples)
    places = there.rotation @ middle + there.translation_mm
    moves = np.array([cast("list[float]", s.extra["move_mm"]) for s in samples])
    return camera_from_tool(moves, places)


def _middle(samples: Sequence[Sample]) -> FloatArray:
    """(3,), the middle of the points that were found."""
    points = np.concatenate([s.found_points_mm for s in samples])
    return np.asarray((points.min(axis=0) + points.max(axis=0)) / 2)
