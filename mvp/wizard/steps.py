"""What a wizard shows and asks, as data; terminals and browsers only render it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Literal, TypeAlias


class Word(Enum):
    """What a person may say instead of an answer to ``Ask`` and ``Allow``.

    Attributes:
        UNDO: take the last sample back.
        FINISH: enough samples; compute with what there is.
    """

    UNDO = "undo"
    FINISH = "finish"


@dataclass(frozen=True)
class Say:
    """Something to read; answered with None."""

    text: str
    grade: Literal["info", "good", "warning"] = "info"


@dataclass(frozen=True)
class Ask:
    """A question; the answer has the type of its kind, or is a ``Word``.

    Attributes:
        key: stable name of the question, such as ``square_mm``.
        question: for a person, without the default.
        kind: yes-no is answered with a bool, number with a float, the others with a str.
        default: taken for an empty answer, and by ``--auto``; None: somebody must answer.
        unit: of a number.
        choices: of a choice.
    """

    key: str
    question: str
    kind: Literal["yes-no", "number", "choice", "text"] = "yes-no"
    default: bool | float | str | None = None
    unit: str = ""
    choices: tuple[str, ...] = ()


@dataclass(frozen=True)
class Allow:
    """The arm is about to move; answered with a bool or a ``Word``.

    False: not there; the wizard proposes something else.

    Attributes:
        text: where to, and what for.
        seconds: how long it should take.
    """

    text: str
    seconds: float


@dataclass(frozen=True)
class Sampled:
    """A picture was taken, and whether it counts; answered with None.

    Attributes:
        number: of the sample in its session.
        name: for reports.
        usable: it counts.
        reason: why not.
        action: what to do about it.
    """

    number: int
    name: str
    usable: bool
    reason: str = ""
    action: str = ""


@dataclass(frozen=True)
class Forecast:
    """The error to be expected if the session ended now, against what is asked.

    Attributes:
        what: the error in words.
        value: of it; None while nothing can be said yet.
        bar: what is asked.
        unit: of both.
    """

    what: str
    value: float | None
    bar: float
    unit: str

    @property
    def met(self) -> bool:
        """Good enough."""
        return self.value is not None and self.value <= self.bar


@dataclass(frozen=True)
class Covered:
    """How far the session has come; answered with None.

    Attributes:
        grid: points seen in each cell of the picture, 6 rows of 8; empty where a map
            of the picture makes no sense.
        bars: share 0 .. 1 that is done, by name.
        forecast: the error to be expected; None: no forecast.
    """

    grid: tuple[tuple[int, ...], ...] = ()
    bars: tuple[tuple[str, float], ...] = ()
    forecast: Forecast | None = None


@dataclass(frozen=True)
class Working:
    """Something takes its time; answered with None. ``total`` 0: not known."""

    text: str
    done: int = 0
    total: int = 0


@dataclass(frozen=True)
class Wait:
    """Time must pass, such as for warming up; answered with None when it has.

    Attributes:
        text: what for.
        seconds: how long.
    """

    text: str
    seconds: float


Step: TypeAlias = Say | Ask | Allow | Sampled | Covered | Working | Wait
Answer: TypeAlias = bool | float | str | Word | None
