"""What a wizard sees and where it may look from: camera, target, aim and bench together.

The arm's own hand-eye transform may be rough: the lookout improves on it with every
picture (``Aim``) and asks the bench for the flange pose that puts the target where a
candidate wants it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from calibration.camera_start import poses_with
from calibration.observations import Observations
from calibration.poses import Poses, only
from calibration.projection import PinholeCamera, project
from calibration.targets.checks import check_picture, measure_picture
from calibration.targets.detect import Detection, Rejection, detect
from calibration.targets.gather import examined
from calibration.targets.layout import Charuco, CircleGrid, target_of_print
from calibration.wizard.next_pose import FocusBand, Refused
from calibration.wizard.next_pose_aim import Aim, Doubt
from calibration.wizard.session_store import Finding
from mvp.errors import CalibrationError
from mvp.optics import principal_distance_mm
from mvp.wizard import Allow, Refusal, Sampled, Say, Word

if TYPE_CHECKING:
    from collections.abc import Generator, Mapping

    from pydantic import JsonValue

    from calibration.targets.layout import Chessboard, Target
    from calibration.wizard.session_store import Sample, SessionStore
    from mvp.geometry import FloatArray, IntArray, Pose
    from mvp.optics import LensSetting
    from mvp.wizard import Answer, Bench, SessionFacts, Shot, Stand, Step, TargetFacts

    Taken: TypeAlias = "Generator[Step, Answer, Sample | Word | None]"

_SIGHT = Doubt(3.0, 0.006)
_CAMERA_DOUBT = Doubt(8.0, 0.04)
_SAME_MM, _SAME_RAD = 30.0, 0.1
_UNSETTLED = (
    "arm or lens moved while the picture was taken",
    "wait longer before the picture: [settle] in the cell file",
)


def layout_of(facts: TargetFacts) -> Target:
    """The target as the detector knows it."""
    return target_of_print(facts, facts.square_sigma_mm)


def target_of(facts: SessionFacts) -> TargetFacts:
    """The cell's target.

    Raises:
        CalibrationError: the cell has none.
    """
    if facts.target is None:
        raise CalibrationError(
            "this cell has no calibration target",
            hint="print one, fix it in the cell, and describe it in [target] of the "
            "cell file: kind, size, and roughly where it lies",
            where=facts.cell,
        )
    return facts.target


def camera_at(facts: SessionFacts, lens: LensSetting) -> PinholeCamera:
    """Intrinsics as believed, at a lens setting."""
    seen, sensor = facts.intrinsics_at(lens), facts.sensor
    f_cal = float(principal_distance_mm(lens.d_mm, lens.f_mm, lens.e_mm))
    return PinholeCamera(
        f_cal / sensor.pitch_x_mm,
        f_cal / sensor.pitch_y_mm,
        seen.centre_x_px,
        seen.centre_y_px,
        seen.k1,
        seen.k2,
        seen.p1,
        seen.p2,
        seen.k3,
    )


def focus_at(facts: SessionFacts, lens: LensSetting, limit_px: float) -> FocusBand:
    """How blurred a depth is at a lens setting, by the present lens table."""
    f_cal = float(principal_distance_mm(lens.d_mm, lens.f_mm, lens.e_mm))
    m = (lens.d_mm - lens.f_mm) / lens.f_mm
    return FocusBand(f_cal, m, lens.a_mm, facts.sensor.pitch_y_mm, limit_px)


def first_aim(facts: SessionFacts, d_mm: float) -> Aim:
    """What the cell's files say about hand-eye and target, and how unsure that is."""
    target = target_of(facts)
    doubt = Doubt(target.position_sigma_mm, float(np.radians(target.angle_sigma_deg)))
    return Aim(
        only(facts.tool_from_camera(d_mm)),
        only(target.base_from_target),
        _CAMERA_DOUBT,
        doubt,
        _SIGHT,
    )


@dataclass(frozen=True, eq=False)
class Goal:
    """A place that the arm can reach, with a clear way.

    Attributes:
        stand: joints and flange there.
        seconds: how long the way takes.
    """

    stand: Stand
    seconds: float


class Lookout:
    """Proposes, drives and looks, for one wizard at one bench."""

    def __init__(self, bench: Bench, store: SessionStore) -> None:
        self.bench = bench
        self.store = store
        self._sights: dict[int, Poses] = {}
        self._told: set[str] = set()
        self._unwanted: list[Pose] = []

    @property
    def facts(self) -> SessionFacts:
        """Of the session."""
        return self.store.facts

    @property
    def layout(self) -> Target:
        """The target as the detector knows it, as large as it was measured."""
        return layout_of(target_of(self.facts))

    @property
    def points_mm(self) -> FloatArray:
        """(m, 3), of the whole target."""
        return self.layout.points_mm

    def least_share(self, share: float) -> float:
        """Of the target's points that a view must show: only ChArUco is read in part."""
        return share if isinstance(self.layout, Charuco) else 1.0

    @property
    def size_px(self) -> tuple[int, int]:
        """Columns and rows of a picture."""
        sensor = self.facts.sensor
        return sensor.width_px, sensor.height_px

    def aim(self, samples: list[Sample], d_mm: float) -> Aim:
        """The belief after some samples, for a lens setting.

        Samples at other settings count too: the pupil's shift is taken off them.
        """
        found = first_aim(self.facts, d_mm)
        tools, sights = [], []
        for sample in samples:
            if not sample.usable or len(sample.pixels) < 6:
                continue
            lens = self.facts.lens_at(sample.lens_steps)
            there = self.sight(sample)
            shift = np.array([0.0, 0.0, lens.d_mm - d_mm])
            tools.append(sample.pose)
            sights.append(Poses(there.rotation, there.translation_mm + shift[None]))
        if not tools:
            return found
        seen_from = Poses(
            np.concatenate([s.rotation for s in sights]),
            np.concatenate([s.translation_mm for s in sights]),
        )
        return found.after(Poses.of(tools), seen_from)

    def sight(self, sample: Sample) -> Poses:
        """``camera_from_target`` (a set of one) by the camera as it is believed to be."""
        if sample.number not in self._sights:
            lens = self.facts.lens_at(sample.lens_steps)
            seen = Observations.from_views(
                [sample.found_points_mm], [sample.found_pixels], size_px=self.size_px
            )
            there = poses_with(camera_at(self.facts, lens), seen)
            self._sights[sample.number] = Poses(there.rotation, there.translation_mm)
        return self._sights[sample.number]

    def _refuses(self, base_from_tool: Pose) -> bool:
        """A person did not want it there, or its picture was of no use."""
        return any(_close(base_from_tool, other) for other in self._unwanted)

    def goal(self, aim: Aim, camera_from_target: Poses, d_mm: float) -> Goal | Refused:
        """Whether and how the arm gets where one view (a set of one) is seen."""
        tool = aim.tool_for(camera_from_target).pose(0, "base", "tool")
        if self._refuses(tool):
            return Refused("it was not wanted there, or the picture was of no use")
        return self.goal_of_tool(tool, d_mm)

    def goal_of_tool(self, base_from_tool: Pose, d_mm: float) -> Goal | Refused:
        """Whether and how the arm gets to a pose of its flange."""
        believed = self.facts.tool_from_camera(d_mm)
        stand = self.bench.joints_for(base_from_tool @ believed, d_mm=d_mm)
        if isinstance(stand, Refusal):
            return Refused(stand.reason)
        way = self.bench.way_to(stand.joints)
        if isinstance(way, Refusal):
            return Refused(way.reason)
        return Goal(stand, way.seconds)

    def take(
        self,
        goal: Goal | None,
        *,
        name: str,
        role: str,
        words: str,
        extra: Mapping[str, JsonValue] | None = None,
        exposure_s: float | None = None,
        sharp: bool = True,
    ) -> Taken:
        """Ask, drive, take one picture and keep it.

        Args:
            goal: where to; None: the arm stays.
            name: of the sample.
            role: of the sample.
            words: where to and what for.
            extra: to be kept with the sample.
            exposure_s: None: searched for.
            sharp: a blurred picture does not count.

        Returns:
            The sample; a word when the person said one; None when the motion was not
            allowed.
        """
        if goal is not None:
            allowed = yield Allow(words, goal.seconds)
            if isinstance(allowed, Word):
                return allowed
            if not allowed:
                self._unwanted.append(goal.stand.base_from_tool)
                return None
            self.bench.move(goal.stand.joints)
        shot = self.bench.shoot(exposure_s)
        sample = self.store.add(
            shot, self._finding(shot, sharp=sharp, extra=extra), name=name, role=role
        )
        if goal is not None and not sample.usable:
            self._unwanted.append(goal.stand.base_from_tool)
        yield Sampled(
            sample.number, sample.name, sample.usable, sample.reason, sample.action
        )
        return sample

    def _finding(
        self, shot: Shot, *, sharp: bool, extra: Mapping[str, JsonValue] | None
    ) -> Finding:
        kept = dict(extra or {})
        found = found_in(shot, self.layout, sharp=sharp)
        if not isinstance(found, Rejection):
            found = self._in_order(found, shot)
        if isinstance(found, Rejection):
            return Finding(None, found.reason, found.action, kept)
        if not shot.settled:
            return Finding(found, *_UNSETTLED, kept)
        return Finding(found, extra=kept)

    def _in_order(self, found: Detection, shot: Shot) -> Detection:
        """Points of a target that looks the same from another end, in their order.

        Where the arm stands, and where the target lies roughly, tells its ends apart.
        """
        if isinstance(self.layout, Charuco):
            return found
        orders = _orders(self.layout)
        lens = self.facts.lens_at(dict(shot.lens_steps))
        tool = Poses.of([shot.base_from_tool])
        there = first_aim(self.facts, lens.d_mm).seen_from(tool)
        camera, points = camera_at(self.facts, lens), self.points_mm
        seen = project(camera, there.rotation[0], there.translation_mm[0], points)
        foreseen = seen - seen.mean(axis=0)
        pixels = found.pixels - found.pixels.mean(axis=0)
        off = [float(((foreseen[ids] - pixels) ** 2).sum()) for ids in orders]
        if not np.isfinite(off).all():
            return found
        ids = orders[int(np.argmin(off))]
        return replace(found, ids=ids, points_mm=points[ids])

    def set_lens(self, steps: Mapping[str, int], *, straight: bool = False) -> None:
        """Set the lens; see ``Bench.set_lens``."""
        self.bench.set_lens(
            zoom=steps["zoom"],
            focus=steps["focus"],
            iris=steps["iris"],
            straight=straight,
        )

    def complain(self, reason: str) -> Generator[Step, Answer, None]:
        """Say why a better view could not be had, once for each reason."""
        if reason not in self._told:
            self._told.add(reason)
            yield Say(f"not every view can be had: {reason}")


def _orders(layout: Chessboard | CircleGrid) -> list[IntArray]:
    """Ids of all points in every order in which a detector may give them."""
    grid = np.arange(len(layout.points_mm)).reshape(layout.rows, layout.columns)
    if isinstance(layout, CircleGrid) and layout.asymmetric:
        return [grid.ravel()]
    ways = [grid, grid[::-1, ::-1]]
    if isinstance(layout, CircleGrid):
        ways += [grid[::-1], grid[:, ::-1]]
    return [np.ascontiguousarray(way).ravel() for way in ways]


def _close(one: Pose, other: Pose) -> bool:
    """So close that the same would come of it."""
    apart = float(np.linalg.norm(one.translation_mm - other.translation_mm))
    return apart < _SAME_MM and one.angle_to_rad(other) < _SAME_RAD


def found_in(shot: Shot, layout: Target, *, sharp: bool) -> Detection | Rejection:
    """Points of the target in a picture, or why it does not count.

    Args:
        shot: the picture.
        layout: what to look for.
        sharp: blur is a reason, too.
    """
    if sharp:
        found = examined(shot.grey, layout)
        return found if isinstance(found, Rejection) else found[0]
    seen = detect(shot.grey, layout)
    if isinstance(seen, Rejection):
        return seen
    wrong = check_picture(measure_picture(shot.grey, seen), seen)
    return wrong if wrong is not None and wrong.code != "blurred" else seen
