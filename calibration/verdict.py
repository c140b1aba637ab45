"""GO, MARGINAL or NO-GO, with causes and what to do next, as data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from collections.abc import Iterable

Grade = Literal["go", "marginal", "no-go"]
_RANK: dict[Grade, int] = {"go": 0, "marginal": 1, "no-go": 2}


@dataclass(frozen=True)
class Cause:
    """One thing that speaks against a result.

    Attributes:
        code: stable name for programs, such as ``target-nearly-parallel``.
        grade: how bad it is by itself.
        message: what was found, with the figure and the limit.
        action: what to do about it.
    """

    code: str
    grade: Grade
    message: str
    action: str


@dataclass(frozen=True)
class Verdict:
    """The worst of all causes; GO when there is none."""

    causes: tuple[Cause, ...] = ()

    @property
    def grade(self) -> Grade:
        """The grade of the worst cause."""
        return max((c.grade for c in self.causes), key=_RANK.__getitem__, default="go")

    @property
    def reasons(self) -> list[str]:
        """One sentence for each cause, the worst first."""
        return [cause.message for cause in self.ordered]

    @property
    def next_action(self) -> str:
        """What to do about the worst cause; empty when nothing is to be done."""
        return self.ordered[0].action if self.causes else ""

    @property
    def ordered(self) -> tuple[Cause, ...]:
        """The causes, the worst first, otherwise in the order found."""
        return tuple(sorted(self.causes, key=lambda cause: -_RANK[cause.grade]))

    def codes(self) -> set[str]:
        """The codes of all causes."""
        return {cause.code for cause in self.causes}


@dataclass(frozen=True)
class Limit:
    """A figure that must stay below (or above) two limits.

    Attributes:
        code: of the cause when it does not.
        what: the figure in words.
        unit: of the figure and the limits.
        marginal: beyond it the result is marginal.
        no_go: beyond it the result is not to be used.
        action: what to do.
        at_least: the limits are lower ones.
    """

    code: str
    what: str
    unit: str
    marginal: float
    no_go: float
    action: str
    at_least: bool = False

    def check(self, value: float) -> tuple[Cause, ...]:
        """No cause, or the one that this figure gives; nan is a NO-GO."""
        grade: Grade = "go"
        for limit, name in ((self.marginal, "marginal"), (self.no_go, "no-go")):
            within = value >= limit if self.at_least else value <= limit
            if not within:
                grade = "marginal" if name == "marginal" else "no-go"
        if grade == "go":
            return ()
        limit = self.marginal if grade == "marginal" else self.no_go
        side = "below" if self.at_least else "above"
        space = "" if self.unit in ("", "%") else " "
        message = (
            f"{self.what} is {value:.3g}{space}{self.unit}, {side} "
            f"{limit:.3g}{space}{self.unit}"
        )
        return (Cause(self.code, grade, message, self.action),)


def judged(*findings: Iterable[Cause]) -> Verdict:
    """All findings in one verdict."""
    return Verdict(tuple(cause for finding in findings for cause in finding))
