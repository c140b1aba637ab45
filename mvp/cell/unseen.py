"""Which features no place sees, in the user's words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from mvp.visibility import closed_in

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.cell.plan_problem import ProblemFactory
    from mvp.scene import Feature
    from mvp.visibility import Region

_MOST_NAMED = 4


@dataclass(frozen=True)
class Unseen:
    """Why some features are not seen, and what would change it."""

    reason: str
    fix: str


def unseen(
    factory: ProblemFactory, features: Sequence[Feature], region: Region
) -> Unseen | None:
    """Features that are seen from nowhere, alone or together; None when all are.

    Args:
        factory: knows where each feature is seen.
        features: asked for in one view.
        region: where all of them are seen whole.
    """
    closed = [f for f in features if closed_in(factory.region(f))]
    if closed:
        many = len(closed) > 1
        return Unseen(
            f"{_listed(closed)} {'are' if many else 'is'} seen from nowhere outside: "
            f"{'they lie' if many else 'it lies'} in a closed cavity",
            "ask for a feature that can be seen from outside; no other view, lens or "
            "workspace helps",
        )
    if not region.empty:
        return None
    fix = (
        "ask for a feature that can be seen, move the fixture that hides it, or give a "
        "larger workspace"
    )
    alone = [f for f in features if factory.region(f).empty]
    if alone:
        who = f"{_listed(alone)} {'are' if len(alone) > 1 else 'is'} seen from nowhere"
        return Unseen(f"{who}: {_hidden(factory, alone)}", fix)
    who = f"{_listed(features)} are seen whole from no common place"
    return Unseen(f"{who}: {_hidden(factory, features)}", fix)


def _hidden(factory: ProblemFactory, features: Sequence[Feature]) -> str:
    """What hides each feature, with the share of the places it takes away."""
    named = len(features) > 1
    texts = []
    for feature in features[:_MOST_NAMED]:
        why = factory.region(feature).in_the_way(factory.face_name)
        texts.append(f"{feature.id}: {why}" if named else why)
    more = len(features) - _MOST_NAMED
    return "; ".join(texts) + (f"; and {more} more" if more > 0 else "")


def _listed(features: Sequence[Feature]) -> str:
    names = [f.id for f in features[:_MOST_NAMED]]
    more = len(features) - _MOST_NAMED
    if more > 0:
        return f"{', '.join(names)} and {more} more"
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
