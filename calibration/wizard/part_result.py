"""From the samples of a part session to where the part lies, and what that is worth."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from calibration.part_pose import (
    HandEye,
    LocatedPart,
    judge_located,
    judge_resection,
    locate,
)
from calibration.results import quality_of
from calibration.verdict import Cause, Limit, Verdict, judged
from calibration.wizard.before import kept, line_of
from calibration.wizard.camera_prior import camera_prior
from calibration.wizard.comparison import compare_rigid
from calibration.wizard.part_held_out import held_out, left_out, not_wanted
from calibration.wizard.part_pictured import (
    Pictured,
    chain_of,
    hand_eye_of,
    pictured_of,
    points_of_part,
    rms_px_of,
    setting_of_sample,
)
from calibration.wizard.provenance import provenance_of, validity_of
from mvp.calibrated import Quality, RigidCalibration, ViewResidual
from mvp.calibrated.content import content_sha256
from mvp.errors import CalibrationError
from mvp.fileedge import FileModel
from mvp.geometry import Pose
from mvp.optics import single_view
from mvp.planning.probability_errors import CameraSpread, camera_spread
from mvp.wizard import Outcome

if TYPE_CHECKING:
    from collections.abc import Sequence

    from pydantic import JsonValue

    from calibration.wizard.session_store import SessionStore
    from calibration.wizard.verification import Verification
    from mvp.geometry import FloatArray
    from mvp.wizard import SightView

KEY = "part"
PLANNED = "planned_views"
_NORMAL_95 = 1.96
_IMPROBABLE = 1e-3
_OPEN_IN_ONE = ("mirror-ambiguity", "few-features", "weakly-determined")


class PlannedRoom(FileModel):
    """One view of the plan: where the camera will be, and how far it may be off."""

    name: str
    part_from_camera: list[list[float]]
    d_mm: float
    position_mm: float
    angle_deg: float


@dataclass(frozen=True)
class Arrival:
    """Where the camera will stand at one view of the plan, against what it may.

    Attributes:
        name: of the view.
        spread: of the camera about its place.
        position_mm: how far it may be off.
        angle_rad: how far it may be turned.
    """

    name: str
    spread: CameraSpread
    position_mm: float
    angle_rad: float

    @property
    def share(self) -> float:
        """What the errors (95 %) take of the room that there is."""
        return max(
            self.spread.position_95_mm / max(self.position_mm, 1e-9),
            self.spread.angle_95_rad / max(self.angle_rad, 1e-9),
        )


@dataclass(frozen=True, eq=False)
class Found:
    """The part, and everything that the verdict rests on.

    Attributes:
        pictured: the samples.
        hand_eye: through which they were seen.
        located: where the part lies.
        moved_mm: how far from where it was believed to lie.
        moved_rad: how much it is turned against that.
        arrivals: at the views of the plan.
        verdict: with its causes.
    """

    pictured: tuple[Pictured, ...]
    hand_eye: HandEye
    located: LocatedPart
    moved_mm: float
    moved_rad: float
    arrivals: tuple[Arrival, ...]
    verdict: Verdict


def found_of(store: SessionStore) -> Found | None:
    """From all usable samples; None without any."""
    facts, samples = store.facts, store.usable()
    if not samples:
        return None
    hand_eye = hand_eye_of(facts, samples[0])
    pictured = tuple(pictured_of(facts, sample, hand_eye) for sample in samples)
    covariance = camera_prior(facts, setting_of_sample(samples[0])).covariance
    located = locate([p.view for p in pictured], hand_eye, covariance)
    before, now = facts.base_from_part, located.base_from_part
    arrivals = _arrivals(store, located)
    moved_mm = float(np.linalg.norm(now.translation_mm - before.translation_mm))
    verdict = _verdict(pictured, located, arrivals)
    return Found(
        pictured,
        hand_eye,
        located,
        moved_mm,
        now.angle_to_rad(before),
        arrivals,
        verdict,
    )


def outcome_of(store: SessionStore) -> Outcome:
    """The result of a session.

    Raises:
        CalibrationError: no picture shows the part.
    """
    found = found_of(store)
    if found is None:
        raise CalibrationError(
            "no picture shows enough of the part to find out where it lies",
            hint="check the light, and where part_pose of the cell file says it lies",
            where=str(store.path),
        )
    held = held_out(store, found.located, found.hand_eye)
    if held.views or not not_wanted(store):
        found = replace(found, verdict=judged(found.verdict.causes, held.causes()))
    others = left_out(store.facts, found.pictured, found.hand_eye)
    quality = _quality(found, held if held.views else others)
    document = _file(store, found, quality)
    before = compare_rigid(store.facts.part_pose, document, at_source_mm=_middle(found))
    lines = (*_lines(found), *_tested(store, held, others), line_of(before))
    details = {"found": found, "verification": held}
    points = tuple(points_of_part(one) for one in found.pictured)
    return Outcome(KEY, document, quality, lines, details, points, kept(before))


def _tested(
    store: SessionStore, held: Verification, others: Verification
) -> tuple[str, ...]:
    """How well the result foretells pictures, in words and mm."""
    by_others = (
        f"each of the {len(others.views)} views by what the others say: {others.what} "
        f"off by {others.error:.3g} mm (root mean square), {others.ratio:.1f} times what "
        "was to be expected"
    )
    lines = (by_others,) if others.views else ()
    if held.views or not not_wanted(store):
        return (*lines, held.words)
    return (*lines, "no view was kept apart: the pictures of the run test the place")


def remember_plan(store: SessionStore, views: Sequence[SightView]) -> None:
    """Keep what the result is compared with."""
    rooms: list[JsonValue] = [
        PlannedRoom(
            name=view.name,
            part_from_camera=view.part_from_camera.matrix.tolist(),
            d_mm=view.d_mm,
            position_mm=view.position_mm,
            angle_deg=view.angle_deg,
        ).model_dump(mode="json")
        for view in views
        if view.position_mm is not None and view.angle_deg is not None
    ]
    if store.recall(PLANNED) != rooms:
        store.remember(PLANNED, rooms)


def _arrivals(store: SessionStore, located: LocatedPart) -> tuple[Arrival, ...]:
    facts, known = store.facts, store.recall(PLANNED)
    rooms = [PlannedRoom.model_validate(one) for one in known or ()]  # type: ignore[union-attr]
    found = []
    for room in rooms:
        chain = chain_of(facts, located, room.d_mm)
        pose = Pose.from_matrix("part", "camera", np.array(room.part_from_camera))
        views = single_view(pose, d_mm=room.d_mm, f_mm=room.d_mm, a_mm=1.0)
        spread = camera_spread(chain.covariance(views)[0])
        angle = float(np.radians(room.angle_deg))
        found.append(Arrival(room.name, spread, room.position_mm, angle))
    return tuple(found)


def _verdict(
    pictured: Sequence[Pictured], located: LocatedPart, arrivals: Sequence[Arrival]
) -> Verdict:
    """Of every picture, of their agreement, and of what the plan asks.

    What one picture leaves open does not matter where several agree on it.
    """
    found: list[Cause] = []
    settled = _settled(pictured, located)
    for one in pictured:
        for cause in judge_resection(one.sight, one.resection).causes:
            if settled and cause.code in _OPEN_IN_ONE:
                continue
            found.append(
                Cause(
                    cause.code,
                    cause.grade,
                    f"{one.sample.name}: {cause.message}",
                    cause.action,
                )
            )
    room = [cause for one in arrivals for cause in _too_little_room(one)]
    return judged(found, judge_located(located).causes, room)


def _settled(pictured: Sequence[Pictured], located: LocatedPart) -> bool:
    """Views from several sides agree on one pose, and their mirror images would not."""
    return len(pictured) > 1 and located.probability >= _IMPROBABLE


def _too_little_room(arrival: Arrival) -> tuple[Cause, ...]:
    limit = Limit(
        "plan-has-less-room",
        f"{arrival.name}: what errors of part, hand-eye and robot take (95 %) of the room "
        "that the plan has",
        "%",
        marginal=100.0,
        no_go=400.0,
        action="look at the part from more sides, improve the hand-eye calibration, or "
        "ask for less in the task",
    )
    return limit.check(100 * arrival.share)


def _quality(found: Found, tested: Verification) -> Quality:
    """In words and mm; the error is that of the features' middle."""
    first = found.pictured[0].resection.best.estimate
    residuals = np.concatenate(
        [p.resection.best.estimate.residuals for p in found.pictured]
    )
    views = [
        ViewResidual(
            name=p.sample.name,
            rms_px=rms_px_of(p),
            rms_mm=float(np.linalg.norm(off[:3])),
        )
        for p, off in zip(found.pictured, found.located.off, strict=True)
    ]
    quality = quality_of(
        found.verdict,
        first,
        weakest=_weakest(found),
        rms_px=float(np.sqrt(np.mean([rms_px_of(p) ** 2 for p in found.pictured]))),
        error_95_mm=_NORMAL_95 * middle_sigma_mm(found),
        out_of_sample_mm=tested.error if tested.views else None,
        views=views,
    )
    return quality.model_copy(
        update={
            "chi_square": float((residuals**2).sum()) + found.located.chi_square,
            "degrees_of_freedom": len(residuals) - 6,
            "chi_square_probability": found.located.probability,
        }
    )


def middle_sigma_mm(found: Found) -> float:
    """How unsure the middle of the features is in the cell, all three axes."""
    lever = found.located.base_from_part.rotate(np.array(_middle(found)))
    x, y, z = lever
    at = np.hstack([np.eye(3), -np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])])
    return float(np.sqrt(np.trace(at @ found.located.covariance @ at.T)))


def _middle(found: Found) -> list[float]:
    """The middle of the features that were seen, part frame."""
    places = np.concatenate([p.sight.places_part_mm for p in found.pictured])
    middle: list[float] = places.mean(axis=0).tolist()
    return middle


def _weakest(found: Found) -> str:
    shift, turn = _sides(found.located.covariance)
    return f"shift {shift:.2g} mm and turn {turn:.2g} deg (one sigma of the worst axis)"


def _sides(covariance: FloatArray) -> tuple[float, float]:
    shift = np.sqrt(np.linalg.eigvalsh(covariance[:3, :3])[-1])
    turn = np.sqrt(np.linalg.eigvalsh(covariance[3:, 3:])[-1])
    return float(shift), float(np.degrees(turn))


def _lines(found: Found) -> tuple[str, ...]:
    count = sum(
        len(p.sight.edges.ends_part_mm) + len(p.sight.circles.pixels)
        for p in found.pictured
    )
    lines = [
        f"the part lies {found.moved_mm:.2f} mm and {np.degrees(found.moved_rad):.2f} "
        "deg from where it was believed to lie",
        f"the middle of its features is known to {_NORMAL_95 * middle_sigma_mm(found):.2f} "
        f"mm (95 %), from {count} edges and holes in {len(found.pictured)} pictures",
    ]
    lines += [
        f"at {one.name} the camera will stand within {one.spread.position_95_mm:.2f} mm "
        f"and {np.degrees(one.spread.angle_95_rad):.2f} deg (95 %); the plan bears "
        f"{one.position_mm:.2f} mm and {np.degrees(one.angle_rad):.2f} deg"
        for one in found.arrivals
    ]
    return tuple(lines)


def _file(store: SessionStore, found: Found, quality: Quality) -> RigidCalibration:
    facts, located = store.facts, found.located
    pose = located.base_from_part
    return RigidCalibration(
        schema="mvp-cell/part-pose/1",
        provenance=provenance_of(store, "arm", "edges and holes of the part itself"),
        quality=quality,
        target=pose.target,
        source=pose.source,
        matrix=pose.matrix.tolist(),
        covariance=located.covariance.tolist(),
        by_hand_eye=located.by_hand_eye.tolist(),
        hand_eye_sha256=content_sha256(facts.hand_eye),
        validity=validity_of(store),
    )
