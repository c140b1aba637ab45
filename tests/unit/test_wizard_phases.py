"""Phases of a session that go on from what there is, and what "undo" does to them."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest

from calibration.wizard.phases import in_phases
from mvp.wizard import Allow, Word
from tests.wizard_play import broken_off, motions_of, taken_back

if TYPE_CHECKING:
    from collections.abc import Generator

    from mvp.wizard import Answer, Step


@dataclass
class Kept:
    """Names and roles of samples, in memory."""

    samples: list[Any] = field(default_factory=list)

    def undo(self) -> Any:
        return self.samples.pop() if self.samples else None

    def count(self, role: str) -> int:
        return sum(sample.role == role for sample in self.samples)


def taken(store: Kept, role: str, most: int) -> Generator[Step, Answer, Word | None]:
    """Samples of a role until there are enough."""
    while store.count(role) < most:
        name = f"{role} {store.count(role) + 1}"
        told = yield Allow(f"to {name}", 1.0)
        if isinstance(told, Word):
            return told
        store.samples.append(SimpleNamespace(name=name, role=role))
    return None


U, F = Word.UNDO, Word.FINISH


@pytest.mark.parametrize(
    ("answers", "asked", "undone"),
    [
        ([1, 1, 1, 1], "c1 c2 v1 v2", ""),
        ([U, 1, F], "c1 c1 c2", "nothing"),
        ([1, 1, U, 1, F], "c1 c2 v1 c2 v1", "c2"),
        ([1, 1, 1, U, U, U, 1, 1, F], "c1 c2 v1 v2 v1 c2 c1 c2 v1", "v1 c2 c1"),
        ([1, 1, 1, U, 1, 1], "c1 c2 v1 v2 v1 v2", "v1"),
    ],
)
def test_who_takes_back_a_sample_is_asked_for_it_again(
    answers: list[Any], asked: str, undone: str
) -> None:
    store: Any = Kept()
    phases = [
        partial(taken, store, role, 2) for role in ("calibration", "verification")
    ]
    given = [one if isinstance(one, Word) else True for one in answers]
    shown = broken_off(in_phases(store, *phases), *given)
    short = [way[3] + way[-1] for way in motions_of(shown)]
    assert short == asked.split()
    told = [text.removesuffix(" is taken back") for text in taken_back(shown)]
    assert [
        "nothing" if "nothing" in name else name[0] + name[-1] for name in told
    ] == undone.split()
    assert store.count("calibration") + store.count("verification") == sum(
        one == 1 for one in answers
    ) - len([one for one in undone.split() if one != "nothing"])
