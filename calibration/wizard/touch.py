"""The touch test: does the arm's tool find the target where the camera sees it?

The tool centre point is put onto the target's origin by hand, and what the arm shows is
typed in. Nothing of it takes part in the calibration, and no picture is involved: a
wrong unit, scale or frame of the whole chain shows here.
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from calibration.hand_eye import HandEyeResult
from calibration.verdict import Cause
from calibration.wizard.verification import HeldOutView, with_causes
from mvp.calibrated import RigidCalibration
from mvp.wizard import Ask, Say, Word

if TYPE_CHECKING:
    from collections.abc import Generator

    from pydantic import JsonValue

    from calibration.hand_eye import HandEyeSolution
    from calibration.wizard.session_store import SessionStore
    from mvp.geometry import FloatArray
    from mvp.wizard import Answer, Outcome, Step

TOUCHED = "touched_mm"
_BY_HAND_MM = 0.3  # on each axis, with a pointed tool
_METRES = 5.0  # nothing is so near to the base of an arm
_BEYOND = 3.0
_ORIGINS = {
    "charuco": "the outer corner of the board where its first square begins",
    "chessboard": "the first inner corner of the board",
    "circle-grid": "the middle of the first disc",
}
_ACTION = (
    "touch it once more; check the arm's tool centre point, the side of the squares and "
    "which corner is the first"
)


def touched(store: SessionStore) -> Generator[Step, Answer, None]:
    """Ask for the touched place; whoever answers with nothing goes on without."""
    target = store.facts.target
    if target is None or store.recall(TOUCHED) is not None:
        return
    while True:
        said = yield Ask(
            TOUCHED,
            "touch test: put the tool centre point onto the target's origin "
            f"({_ORIGINS[target.kind]}) by hand, and type x y z as the arm shows it, "
            "base frame, mm; nothing: no touch test",
            "text",
            "",
        )
        if isinstance(said, Word) or not str(said or "").strip():
            store.remember(TOUCHED, "no")
            return
        place = _parsed(str(said))
        if place is not None:
            store.remember(TOUCHED, place)
            return
        yield Say(
            "three numbers are needed, in mm, such as -530.2 297.4 31.0", "warning"
        )


def with_touch(store: SessionStore, outcome: Outcome) -> Outcome:
    """The outcome with what the touch test says, where there was one."""
    told, result = store.recall(TOUCHED), outcome.details.get("result")
    if not (isinstance(told, list) and isinstance(result, HandEyeResult)):
        return outcome
    if result.solution is None:
        return outcome
    place = np.array([float(str(v)) for v in told])
    found = _compared(result.solution, place, store.facts.robot.position_mm)
    quality = with_causes(outcome.quality, _causes(found))
    document = outcome.document
    if isinstance(document, RigidCalibration):
        document = document.model_copy(update={"quality": quality})
    line = (
        f"touch test: {found.error:.2f} mm from where robot and hand-eye put it, "
        f"{found.ratio:.1f} times what was to be expected"
    )
    return replace(
        outcome, document=document, quality=quality, lines=(*outcome.lines, line)
    )


def _parsed(said: str) -> list[JsonValue] | None:
    """Three numbers in mm; with a comma for a point where blanks are between them."""
    words = said.split() if len(said.split()) == 3 else re.split(r"[,;]\s*", said)
    try:
        place = [float(word.strip(",;").replace(",", ".")) for word in words]
    except ValueError:
        return None
    good = len(place) == 3 and np.isfinite(place).all()
    return [*place] if good and np.linalg.norm(place) > _METRES else None


def _compared(
    solution: HandEyeSolution, place_mm: FloatArray, robot_mm: float
) -> HeldOutView:
    """How far the touched place is from the target's origin as it was found.

    The arm's error counts twice: once for finding the target, once for touching it.
    """
    off = place_mm - solution.fixed_from_target.translation_mm
    seen = np.trace(solution.estimate.covariance[6:9, 6:9])
    arm_mm = max(float(solution.robot_sigmas[0]), robot_mm)
    variance = seen + 3 * (2 * arm_mm**2 + _BY_HAND_MM**2)
    error, expected = float(np.linalg.norm(off)), float(np.sqrt(variance))
    return HeldOutView("the touched place", error, expected)


def _causes(found: HeldOutView) -> tuple[Cause, ...]:
    if found.ratio <= _BEYOND:
        return ()
    message = (
        f"where the tool touched the target is {found.error:.2f} mm from where robot and "
        f"hand-eye put it, {found.ratio:.1f} times what was to be expected"
    )
    return (Cause("touch-test-off", "marginal", message, _ACTION),)
