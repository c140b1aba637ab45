"""Phases of a session that go on from what there is, and what "undo" does to them."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

from mvp.wizard import Say, Word

if TYPE_CHECKING:
    from collections.abc import Callable, Generator

    from calibration.wizard.session_store import Sample, SessionStore
    from mvp.wizard import Answer, Step

    Phase: TypeAlias = Callable[[], Generator[Step, Answer, Word | None]]

_OF_THE_RESULT = "calibration"  # role of samples that the others only test


def take_back(store: SessionStore) -> Generator[Step, Answer, Sample | None]:
    """Take the last sample back, and say which; None when there is none."""
    undone = store.undo()
    if undone is None:
        yield Say("there is nothing to take back", "warning")
    else:
        yield Say(f"{undone.name} is taken back")
    return undone


def in_phases(
    store: SessionStore, *phases: Phase
) -> Generator[Step, Answer, Word | None]:
    """One phase after the other; back to the first when a sample of it is taken back.

    Args:
        store: of the session.
        phases: each takes what is still missing by what the store has, and ends with
            the word that was said, if any; the last one takes the held-out views.

    Returns:
        ``Word.FINISH`` when a phase ended with it, and those after it were left out.
    """
    at = 0
    while at < len(phases):
        word = yield from phases[at]()
        if word is Word.FINISH:
            return word
        if word is None:
            at += 1
            continue
        undone = yield from take_back(store)
        if undone is not None and undone.role == _OF_THE_RESULT:
            at = 0
    return None
