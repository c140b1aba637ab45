"""The next best view: which pose tells most about what the task needs.

Greedy on the information matrix: of all candidates the one is taken after which the
expected error of the task is smallest (V-optimality: the trace of the covariance under
the task's weight), among those where the arm can stand, with a clear way, with the target
in focus. The same sum foretells the error after further views, which is the stop rule.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, TypeVar

import numpy as np

from calibration.wizard.next_pose_candidates import (
    FocusBand,
    TargetViews,
    ViewRange,
    candidate_views,
    views_of,
)
from calibration.wizard.next_pose_information import (
    HandEyeBelief,
    camera_information,
    camera_task,
    hand_eye_information,
    hand_eye_task,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from mvp.geometry import FloatArray

__all__ = [
    "Choice",
    "FocusBand",
    "HandEyeBelief",
    "Knowledge",
    "NoView",
    "Refused",
    "TargetViews",
    "ViewRange",
    "camera_information",
    "camera_task",
    "candidate_views",
    "choose",
    "first_of",
    "hand_eye_information",
    "hand_eye_task",
    "views_of",
    "views_until",
]

Place = TypeVar("Place")

_MOST_ASKED = 80


@dataclass(frozen=True, eq=False)
class Knowledge:
    """What the views so far tell, and what it is needed for.

    Attributes:
        information: (k, k), of priors and of all views taken.
        weight: (k, k): trace(C weight) is the mean squared error of the task, mm^2.
    """

    information: FloatArray
    weight: FloatArray

    @property
    def error_mm(self) -> float:
        """Expected error (root mean square) of the task now."""
        return float(self.errors_after(np.zeros((1, *self.information.shape)))[0])

    def errors_after(self, more: FloatArray) -> FloatArray:
        """(n,): expected error after each of n views (n, k, k)."""
        total = self.information + more
        scale = np.sqrt(np.einsum("nii->ni", total))
        scale = np.where(scale > 0, scale, 1.0)
        scaled = total / (scale[:, :, None] * scale[:, None, :])
        weight = self.weight / (scale[:, :, None] * scale[:, None, :])
        floor = 1e-14 * np.eye(total.shape[-1])
        spread = np.linalg.solve(scaled + floor, weight)
        return np.asarray(np.sqrt(np.maximum(np.einsum("nii->n", spread), 0.0)))

    def after(self, more: FloatArray) -> Knowledge:
        """With one view (k, k), or several (n, k, k), added."""
        return Knowledge(
            self.information + more.reshape(-1, *self.information.shape).sum(axis=0),
            self.weight,
        )


@dataclass(frozen=True)
class Refused:
    """A place where the arm cannot or must not go.

    Attributes:
        reason: in words.
    """

    reason: str


@dataclass(frozen=True, eq=False)
class Choice(Generic[Place]):
    """The next view.

    Attributes:
        index: of the candidate.
        place: what was made of it by who can drive there.
        now_mm: expected error of the task before it.
        forecast_mm: and after it.
        refused: better ones that could not be had, by reason.
    """

    index: int
    place: Place
    now_mm: float
    forecast_mm: float
    refused: Counter[str]


@dataclass(frozen=True, eq=False)
class NoView:
    """None of the candidates can be had; how often and why."""

    refused: Counter[str]

    @property
    def reason(self) -> str:
        """The most frequent reasons in one sentence."""
        if not self.refused:
            return "no view shows enough of the target in focus"
        return "; ".join(reason for reason, _ in self.refused.most_common(3))


def choose(
    knowledge: Knowledge,
    more: FloatArray,
    place: Callable[[int], Place | Refused],
    *,
    most_asked: int = _MOST_ASKED,
) -> Choice[Place] | NoView:
    """The candidate after which the task's error is smallest, among those to be had.

    Args:
        knowledge: so far.
        more: (n, k, k), information of every candidate.
        place: asks whether a candidate can be driven to; called from the best on.
        most_asked: give up after so many refusals.
    """
    errors = knowledge.errors_after(more)
    refused: Counter[str] = Counter()
    for index in np.argsort(errors, kind="stable")[:most_asked]:
        there = place(int(index))
        if isinstance(there, Refused):
            refused[there.reason] += 1
            continue
        return Choice(
            int(index), there, knowledge.error_mm, float(errors[index]), refused
        )
    return NoView(refused)


def first_of(count: int, place: Callable[[int], Place | Refused]) -> Place | NoView:
    """The first of some candidates, in their order, that can be had."""
    refused: Counter[str] = Counter()
    for index in range(count):
        there = place(index)
        if not isinstance(there, Refused):
            return there
        refused[there.reason] += 1
    return NoView(refused)


def views_until(
    knowledge: Knowledge, more: FloatArray, bar_mm: float, *, most: int = 40
) -> int | None:
    """How many more views it takes until the expected error meets the bar.

    A forecast: every candidate may be had, and had again. None: more than ``most``.
    """
    for taken in range(most + 1):
        if knowledge.error_mm <= bar_mm:
            return taken
        if not len(more):
            return None
        errors = knowledge.errors_after(more)
        knowledge = knowledge.after(more[int(np.argmin(errors))])
    return None
