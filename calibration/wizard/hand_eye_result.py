"""From the samples of a hand-eye session to its result, verified on held-out views."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from calibration.hand_eye import (
    HandEyeData,
    HandEyeLimits,
    HandEyeResult,
    RobotNoise,
    calibrate_hand_eye,
    hand_eye_calibration,
)
from calibration.poses import Poses, difference, only
from calibration.report import about_session, hand_eye_report, render_report
from calibration.results import refused
from calibration.verdict import Verdict
from calibration.wizard.before import kept, line_of
from calibration.wizard.camera_prior import camera_prior
from calibration.wizard.comparison import compare_rigid
from calibration.wizard.lookout import target_of
from calibration.wizard.points import points_of
from calibration.wizard.provenance import provenance_of, validity_of
from calibration.wizard.verification import Verification, verify_hand_eye
from calibration.wizard.working import Setting, setting_of
from mvp.errors import CalibrationError
from mvp.wizard import Outcome

if TYPE_CHECKING:
    from calibration.wizard.session_store import Sample, SessionStore
    from mvp.wizard import SessionFacts

KEY = "hand-eye"
SIGMA_PX = 0.15
_VIEWS_ALIKE = 2


def outcome_of(store: SessionStore) -> Outcome:
    """The result of a session.

    Raises:
        CalibrationError: no usable view.
    """
    facts, samples = store.facts, store.usable()
    if not samples:
        raise CalibrationError(
            "no picture shows the target well enough to calibrate hand-eye",
            hint="check the light, and where [target] of the cell file says it lies",
            where=str(store.path),
        )
    setting = setting_of(store)
    data = _data(store, samples)
    limits = HandEyeLimits(stand_off_mm=setting.stand_off_mm(facts))
    result = calibrate_hand_eye(
        data, camera_prior(facts, setting), robot_of(facts), limits
    )
    if result.solution is None:
        return _nothing(result, data)
    result = _with_alike(_with_scale(result, data, setting, facts, limits))
    held = _held_out(store, result)
    verdict = Verdict((*result.verdict.causes, *held.causes()))
    result = replace(result, verdict=verdict)
    return _told(store, setting, result, data, held)


def robot_of(facts: SessionFacts) -> RobotNoise:
    """What the cell file says of the arm's poses."""
    return RobotNoise(facts.robot.position_mm, float(np.radians(facts.robot.angle_deg)))


def _data(store: SessionStore, samples: tuple[Sample, ...]) -> HandEyeData:
    return HandEyeData(
        Poses.of([sample.pose for sample in samples]),
        store.observations(samples),
        sigma_px=SIGMA_PX,
        settled=tuple(sample.settled for sample in samples),
    )


def _with_scale(
    result: HandEyeResult,
    data: HandEyeData,
    setting: Setting,
    facts: SessionFacts,
    limits: HandEyeLimits,
) -> HandEyeResult:
    """Add what an error of the target's size does: all views share it."""
    solution, target = result.solution, target_of(facts)
    if solution is None:
        return result
    relative = target.square_sigma_mm / target.square_mm
    seen = data.seen
    larger = replace(seen, points_target_mm=seen.points_target_mm * (1 + relative))
    other = calibrate_hand_eye(
        replace(data, seen=larger),
        camera_prior(facts, setting),
        robot_of(facts),
        limits,
    )
    if other.solution is None:
        return result
    moved = difference(
        only(other.solution.moving_from_camera), only(solution.moving_from_camera)
    )[0]
    covariance = solution.covariance + np.outer(moved, moved)
    return replace(result, solution=replace(solution, covariance=covariance))


def _with_alike(result: HandEyeResult) -> HandEyeResult:
    """Add what views have in common because the arm errs alike where it stands alike.

    Errors of an arm's geometry change smoothly with its pose. What all views share of
    them turns up in the result; two views count as one fact about it here. Two was
    chosen on sessions whose arms err over seven to thirty degrees of a joint: with every
    view a fact of its own 91 to 93 % of the errors lie in the 95 % interval, with four
    99 %. On sessions of other seeds 97 to 99 % lie in it.
    """
    solution = result.solution
    if solution is None:
        return result
    variance = np.repeat(solution.robot_sigmas**2, 3)
    share = (_VIEWS_ALIKE - 1) / len(solution.slack)
    covariance = solution.covariance + share * np.diag(variance)
    return replace(result, solution=replace(solution, covariance=covariance))


def _held_out(store: SessionStore, result: HandEyeResult) -> Verification:
    samples = store.usable("verification")
    if result.solution is None or not samples:
        return Verification("the target's place by robot and hand-eye", ())
    return verify_hand_eye(result.solution, _data(store, samples))


def _told(
    store: SessionStore,
    setting: Setting,
    result: HandEyeResult,
    data: HandEyeData,
    held: Verification,
) -> Outcome:
    facts, solution = store.facts, result.solution
    if solution is None:
        return _nothing(result, data)
    lens = facts.lens_at(setting.by_name)
    stand_off = setting.stand_off_mm(facts)
    document = hand_eye_calibration(
        result,
        data,
        provenance=provenance_of(store, "arm", "views chosen by information"),
        stand_off_mm=stand_off,
        reference_d_mm=lens.d_mm,
        reference_f_mm=lens.f_mm,
        validity=validity_of(store),
    )
    before = compare_rigid(facts.hand_eye, document, at_source_mm=(0.0, 0.0, stand_off))
    error = solution.error_mm(stand_off)
    place, turn = solution.robot_sigmas[0], np.degrees(solution.robot_sigmas[1])
    lines = (
        f"a point at {stand_off:.0f} mm is known to {error:.2f} mm (one sigma), "
        f"{1.96 * error:.2f} mm (95 %)",
        f"the robot's poses agree to {place:.3f} mm and {turn:.4f} deg (one sigma on "
        "each axis)",
        held.words,
        line_of(before),
    )
    return Outcome(
        KEY,
        document,
        document.quality,
        lines,
        {
            "result": result,
            "data": data,
            "verification": held,
            "stand_off_mm": stand_off,
        },
        points=points_of(store.usable(), solution.errors_px),
        comparison=kept(before),
    )


def page_of(store: SessionStore, outcome: Outcome) -> str:
    """The report of a result, also of one without a transform."""
    result, data = outcome.details["result"], outcome.details["data"]
    if not (isinstance(result, HandEyeResult) and isinstance(data, HandEyeData)):
        raise TypeError("not the outcome of a hand-eye session")
    stand_off = setting_of(store).stand_off_mm(store.facts)
    page = hand_eye_report(
        result,
        data,
        about_session(store, outcome.document, distance_mm=stand_off),
        robot=robot_of(store.facts),
        stand_off_mm=stand_off,
    )
    held = outcome.details.get("verification")
    words = (held.words,) if isinstance(held, Verification) else ()
    return render_report(replace(page, notes=(*page.notes, *words)))


def _nothing(result: HandEyeResult, data: HandEyeData) -> Outcome:
    quality = refused(result.verdict)
    lines = ("these views give no transform from the camera to the tool",)
    return Outcome(KEY, None, quality, lines, {"result": result, "data": data})
