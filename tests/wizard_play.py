"""Goes through the steps of a wizard as a person would."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from mvp.wizard import Allow, Ask, Say

if TYPE_CHECKING:
    from collections.abc import Callable, Generator

    from mvp.wizard import Answer, Step


def played(
    steps: Generator[Step, Answer, object], answers_to: Callable[[Ask], list[Answer]]
) -> list[Step]:
    """All steps that were shown.

    Args:
        steps: of the wizard, from its beginning.
        answers_to: what is left to be said to a question; the first is taken out and
            said, and the question's default where nothing is left.
    """
    shown: list[Step] = []
    answer: Answer = None
    while True:
        try:
            step = steps.send(answer)
        except StopIteration:
            return shown
        shown.append(step)
        answer = None
        if isinstance(step, Ask):
            left = answers_to(step)
            answer = left.pop(0) if left else step.default


def broken_off(steps: Generator[Step, Answer, object], *answers: Answer) -> list[Step]:
    """All steps up to the first motion that no answer is left for, as a crash ends it.

    Args:
        steps: of the wizard, from its beginning.
        answers: to every motion in turn; questions get their defaults.
    """
    shown: list[Step] = []
    left = list(answers)
    answer: Answer = None
    while True:
        try:
            step = steps.send(answer)
        except StopIteration:
            return shown
        shown.append(step)
        answer = step.default if isinstance(step, Ask) else None
        if isinstance(step, Allow):
            if not left:
                steps.close()
                return shown
            answer = left.pop(0)


def motions_of(shown: list[Step]) -> list[str]:
    """Where the arm was to move, without what is to be expected of it."""
    told = [step.text for step in shown if isinstance(step, Allow)]
    return [re.split("[:;]", text)[0] for text in told]


def taken_back(shown: list[Step]) -> list[str]:
    """What was said to be taken back."""
    told = [step.text for step in shown if isinstance(step, Say)]
    return [text for text in told if "take" in text and "back" in text]
