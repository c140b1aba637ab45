"""Choose roll and branch of the arm for a planned view, and say why when none will do."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from mvp.kinematics.camera_pose import camera_rotation, roll_of
from mvp.kinematics.clearance import CellBodies, Nearest, blocked_sight
from mvp.kinematics.model import singularity_margin

if TYPE_CHECKING:
    from collections.abc import Callable

    from mvp.geometry import BoolArray, FloatArray, IntArray, Pose

    Rank: TypeAlias = Callable[[FloatArray], FloatArray]

ROLLS = 24
_COMFORT_RAD = np.radians(20.0)
_COMFORT_MM = 40.0
_AT_ONCE = 64


@dataclass(frozen=True)
class ReachMargin:
    """Slack to the nearest joint limit or end of reach.

    Attributes:
        value: in ``unit``.
        unit: deg for turning axes, mm for sliding ones.
        label: which axis or which end of reach.
    """

    value: float
    unit: str
    label: str


@dataclass(frozen=True, eq=False)
class Realisation:
    """A view that the arm can take.

    Attributes:
        joints: (dof,) rad or mm.
        base_from_tool: where the flange is then.
        part_from_camera: the view, with the roll that was chosen.
        roll_rad: that roll, as ``camera_rotation`` counts it.
        reach: the smallest joint margin.
        nearest: the closest pair of bodies there.
        score: min of reach and clearance over what is comfortable, at most 1.
    """

    joints: FloatArray
    base_from_tool: Pose
    part_from_camera: Pose
    roll_rad: float
    reach: ReachMargin
    nearest: Nearest
    score: float


@dataclass(frozen=True)
class Unreachable:
    """No roll and no branch will do; ``reasons`` says why, the most frequent first."""

    reasons: tuple[str, ...]

    @property
    def reason(self) -> str:
        """One sentence."""
        return "; ".join(self.reasons)


@dataclass(frozen=True, eq=False)
class Placement:
    """What a view has to be realised with.

    Attributes:
        bodies: arm, tool bodies and obstacles, base frame.
        base_from_part: the part's pose.
        tool_from_camera: hand-eye, at the lens setting of the view.
        joint_margin: (dof,) slack asked of every joint limit, rad or mm.
        clearance_mm: distance asked between any two bodies.
        reference: (dof,) configuration to stay near; None: the middle of the range.
        targets_part_mm: (n, 3) points that arm and camera must not hide.
        singularity_margin: asked of ``singularity_margin``; zero asks nothing.
    """

    bodies: CellBodies
    base_from_part: Pose
    tool_from_camera: Pose
    joint_margin: FloatArray
    clearance_mm: float = 5.0
    reference: FloatArray | None = None
    targets_part_mm: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    singularity_margin: float = 0.0

    @property
    def near(self) -> FloatArray:
        """The reference configuration."""
        model = self.bodies.model
        middle = (model.joint_low + model.joint_high) / 2
        return middle if self.reference is None else np.asarray(self.reference)


def margin_of(bodies: CellBodies, joints: FloatArray) -> ReachMargin:
    """The smallest slack of one configuration, compared by degrees or millimetres."""
    model = bodies.model
    values = model.margins(np.asarray(joints)[None])[0]
    shown = np.array(
        [
            np.degrees(v) if u == "rad" else v
            for v, u in zip(values, model.margin_units, strict=True)
        ]
    )
    k = int(np.argmin(shown))
    unit = "deg" if model.margin_units[k] == "rad" else "mm"
    return ReachMargin(float(shown[k]), unit, model.margin_labels[k])


def realisations(
    placement: Placement,
    part_from_camera: Pose,
    *,
    free_roll: bool = True,
    rolls: int = ROLLS,
    rank: Rank | None = None,
) -> tuple[Realisation, ...] | Unreachable:
    """Every acceptable way to take a view, best first.

    Best is the largest rank, then the largest min(reach, clearance) in comfortable
    units; above comfort all are equal and the one nearest to the reference
    configuration comes first.

    Args:
        placement: the cell.
        part_from_camera: the planned view (its roll counts when ``free_roll`` is off).
        free_roll: any roll will do: ``rolls`` of them are tried, among them the two of
            the paper's (24).
        rolls: number of rolls tried.
        rank: from part_from_camera rotations (M, 3, 3) to values (M,); what counts
            before the arm's own comfort.
    """
    asked = _asked_rotations(part_from_camera, rolls if free_roll else 0)
    joints, exists, given = _branches(placement, part_from_camera, asked)
    reasons: Counter[str] = Counter()
    if not exists.any():
        return Unreachable((_out_of_reach(placement, asked, joints),))
    found = joints[exists]
    ranks = _ranks(placement, given, rank)[np.nonzero(exists)[0]]
    slack = _reach_slack(placement, found, reasons)
    order = _preferred(placement, found, slack, ranks)
    accepted: list[Realisation] = []
    worth: list[float] = []
    for start in range(0, len(order), _AT_ONCE):
        part = order[start : start + _AT_ONCE]
        clear = placement.bodies.pairs(found[part])
        for row, k in enumerate(part):
            near = clear.nearest(row) if clear.names else _nothing(placement)
            one = _judged(placement, found[k], float(slack[k]), near, reasons)
            if one is not None:
                accepted.append(one)
                worth.append(float(ranks[k]))
        if accepted:
            return _best_first(placement, accepted, worth)
    return Unreachable(tuple(reason for reason, _ in reasons.most_common()))


def _best_first(
    placement: Placement, accepted: list[Realisation], worth: list[float]
) -> tuple[Realisation, ...]:
    """By rank, score, then the time that the slowest axis needs from the reference."""
    speed = placement.bodies.model.joint_speed
    away = [float(np.abs((a.joints - placement.near) / speed).max()) for a in accepted]
    best = np.lexsort(
        (away, [-round(a.score, 3) for a in accepted], [-value for value in worth])
    )
    return tuple(accepted[k] for k in best)


def _nothing(placement: Placement) -> Nearest:
    return Nearest(placement.bodies.far_mm, "arm", "nothing")


def _asked_rotations(part_from_camera: Pose, rolls: int) -> FloatArray:
    """(M, 3, 3) part_from_camera rotations to try; the view's own when rolls is 0."""
    if not rolls:
        return part_from_camera.rotation[None]
    turn = np.linspace(0.0, 2 * np.pi, rolls, endpoint=False)
    return camera_rotation(part_from_camera.rotation[:, 2], turn)


def _ranks(placement: Placement, given: FloatArray, rank: Rank | None) -> FloatArray:
    """The rank (M,) of every roll, all equal without a ranking."""
    if rank is None:
        return np.zeros(len(given))
    return rank(placement.base_from_part.rotation.T @ given)


def _branches(
    placement: Placement, part_from_camera: Pose, asked: FloatArray
) -> tuple[FloatArray, BoolArray, FloatArray]:
    """Joints (M, B, dof) of every attainable roll, which of them exist (M, B).

    And the camera's rotation (M, 3, 3) in the base frame at those rolls.
    """
    model, hand = placement.bodies.model, placement.tool_from_camera
    cameras = placement.base_from_part.rotation @ asked
    given = model.camera_rotations(cameras[:1, :, 2], cameras[None], hand.rotation)[0]
    if model.dictates_roll and len(asked) == 1:
        same = np.abs(given - cameras).max(axis=(1, 2)) < 1e-6
        given = given[same] if same.any() else cameras
    pupil = placement.base_from_part.apply(part_from_camera.translation_mm)
    tools = given @ hand.rotation.T
    flange = pupil - tools @ hand.translation_mm
    joints, exists = model.inverse_batch(tools, flange, near=placement.near)
    return joints, exists, given


def _out_of_reach(placement: Placement, asked: FloatArray, joints: FloatArray) -> str:
    """Why no branch exists at all."""
    model = placement.bodies.model
    real = joints[np.isfinite(joints).all(axis=-1)]
    if not len(real):
        if model.dictates_roll:
            return "the head cannot look in that direction"
        return "out of the arm's reach at every roll"
    beyond: IntArray = np.argmax(
        np.maximum(model.joint_low - real, real - model.joint_high), axis=1
    )
    worst = np.maximum(model.joint_low - real, real - model.joint_high).max(axis=1)
    if worst.max() <= 0:
        return "the head cannot give that roll; leave the roll free"
    name = model.joint_names[Counter(beyond.tolist()).most_common(1)[0][0]]
    rolls = "every roll" if len(asked) > 1 else "the planned roll"
    return f"axis {name} would pass its limit at {rolls}"


def _reach_slack(
    placement: Placement, found: FloatArray, reasons: Counter[str]
) -> FloatArray:
    """Smallest slack (K,) beyond the asked joint margin over comfort; < 0: refused."""
    model = placement.bodies.model
    values = model.margins(found)
    asked = np.zeros(values.shape[1])
    asked[: model.dof] = placement.joint_margin
    comfort = [_COMFORT_RAD if u == "rad" else _COMFORT_MM for u in model.margin_units]
    beyond = (values - asked) / np.array(comfort)
    worst = beyond.argmin(axis=1)
    for k in np.flatnonzero(beyond.min(axis=1) < 0):
        reasons[f"{model.margin_labels[worst[k]]} is closer than the joint margin"] += 1
    return np.asarray(beyond.min(axis=1))


def _preferred(
    placement: Placement, found: FloatArray, slack: FloatArray, ranks: FloatArray
) -> IntArray:
    """The acceptable configurations, by rank, slack and nearness."""
    model = placement.bodies.model
    away = np.abs((found - placement.near) / model.joint_speed).max(axis=1)
    order = np.lexsort((away, -np.minimum(np.round(slack, 1), 1.0), -ranks))
    return np.asarray(order[slack[order] >= 0], dtype=np.int64)


def _too_singular(placement: Placement, joints: FloatArray) -> bool:
    asked = placement.singularity_margin
    return asked > 0 and singularity_margin(placement.bodies.model, joints) < asked


def _judged(
    placement: Placement,
    joints: FloatArray,
    slack: float,
    nearest: Nearest,
    reasons: Counter[str],
) -> Realisation | None:
    """One configuration, or None with its reason counted."""
    if nearest.distance_mm < placement.clearance_mm:
        reasons[f"{nearest.body} against {nearest.other}"] += 1
        return None
    if _too_singular(placement, joints):
        reasons["the arm would stand too close to a singular configuration"] += 1
        return None
    tool = placement.bodies.model.forward(joints)
    part_from_tool = placement.base_from_part.inverse() @ tool
    part_from_camera = part_from_tool @ placement.tool_from_camera
    if len(placement.targets_part_mm):
        blockers = blocked_sight(
            placement.bodies.moving(joints[None]),
            placement.base_from_part.apply(part_from_camera.translation_mm),
            placement.base_from_part.apply(placement.targets_part_mm),
        )
        if blockers:
            reasons[f"{blockers[0]} stands in the line of sight"] += 1
            return None
    return Realisation(
        joints,
        tool,
        part_from_camera,
        float(roll_of(part_from_camera.rotation)),
        margin_of(placement.bodies, joints),
        nearest,
        min(slack, nearest.distance_mm / _COMFORT_MM, 1.0),
    )
