"""Goes through the steps of a wizard as a person would."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mvp.wizard import Ask

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
