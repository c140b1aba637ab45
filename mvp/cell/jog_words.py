"""The words of ``mvp-cell jog``: one line in, one command out. No device, no motion."""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

from mvp.devices import AXES, Axis
from mvp.errors import UsageError

FrameName: TypeAlias = Literal["base", "tool", "camera"]
FRAMES: tuple[FrameName, ...] = get_args(FrameName)
_SHIFTS = {"x": 0, "y": 1, "z": 2}
_TURNS = {"rx": 0, "ry": 1, "rz": 2}
Quantity: TypeAlias = Literal["f", "d", "a"]
Word: TypeAlias = Literal["where", "home", "see", "help", "quit"]
_OPTICAL: tuple[Quantity, ...] = get_args(Quantity)
_PLAIN: tuple[Word, ...] = get_args(Word)
_KNOWN = (
    *(*_SHIFTS, *_TURNS, *AXES, *_OPTICAL, *_PLAIN),
    *("frame", "shot", "live", "exposure"),
)

HELP = """\
x y z NUMBER          shift the arm by mm, rx ry rz NUMBER turn it by deg, in the frame:
frame base|tool|camera   which axes those are; a turn is about the frame's origin
jN NUMBER             joint N by deg, or mm where it slides
zoom focus iris N     motor to step N; +N or -N from where it is
f d a NUMBER          lens to mm, through the lens table
exposure NUMBER       of the next pictures, ms
see                   the picture, in this window;  shot FILE.png  into a file
live                  the picture and where all stands, again and again, until Enter
live FILE.png         that file shows what the camera sees from now on;  live off
where                 joints, pose, lens;  home  references of lens and gantry
help, quit"""


@dataclass(frozen=True)
class Shift:
    """Move the arm along, or turn it about, an axis of a frame: mm or deg."""

    axis: int
    amount: float
    turns: bool


@dataclass(frozen=True)
class Joint:
    """Move one joint (from 0) by deg or mm."""

    index: int
    amount: float


@dataclass(frozen=True)
class Steps:
    """Move one motor of the lens: to a step, or by steps."""

    axis: Axis
    steps: int
    relative: bool


@dataclass(frozen=True)
class Optical:
    """Set f, d or a, mm."""

    quantity: Quantity
    value_mm: float


@dataclass(frozen=True)
class UseFrame:
    """Shift and turn in these axes from now on."""

    frame: FrameName


@dataclass(frozen=True)
class Expose:
    """Exposure of the next pictures, s."""

    seconds: float


@dataclass(frozen=True)
class Shot:
    """Take a picture into a file."""

    file: str


@dataclass(frozen=True)
class Live:
    """Pictures one after the other: into a file, or here where that is empty."""

    file: str = ""


@dataclass(frozen=True)
class LiveOff:
    """No more of them."""


@dataclass(frozen=True)
class Plain:
    """A word that needs nothing more."""

    word: Word


JogCommand: TypeAlias = (
    Shift | Joint | Steps | Optical | UseFrame | Expose | Shot | Live | LiveOff | Plain
)


def parse(line: str) -> JogCommand:
    """Understand one line.

    Raises:
        UsageError: unknown word, or a number that is missing or none.
    """
    word, _, rest = line.strip().partition(" ")
    word, rest = word.lower(), rest.strip()
    if word in ("q", "exit"):
        word = "quit"
    for plain in _PLAIN:
        if word == plain and not rest:
            return Plain(plain)
    if word == "frame":
        return _frame(rest)
    if word == "shot":
        return _shot(rest)
    if word == "live":
        return _live(rest)
    if word in _SHIFTS or word in _TURNS:
        turns = word in _TURNS
        along = _TURNS[word] if turns else _SHIFTS[word]
        return Shift(along, _number(word, rest), turns)
    if word[:1] == "j" and word[1:].isdecimal() and int(word[1:]) > 0:
        return Joint(int(word[1:]) - 1, _number(word, rest))
    for axis in AXES:
        if word == axis:
            return _steps(axis, rest)
    for quantity in _OPTICAL:
        if word == quantity:
            return Optical(quantity, _number(word, rest))
    if word == "exposure":
        return Expose(_number(word, rest) / 1000)
    raise _unknown(line, word)


def _frame(rest: str) -> UseFrame:
    for frame in FRAMES:
        if rest == frame:
            return UseFrame(frame)
    raise UsageError(f"there is no frame {rest!r}", hint=f"frames: {', '.join(FRAMES)}")


def _steps(axis: Axis, rest: str) -> Steps:
    steps = _number(axis, rest)
    if steps != round(steps):
        raise UsageError(f"{axis} moves in whole steps, not {rest}")
    return Steps(axis, round(steps), relative=rest[:1] in ("+", "-"))


def _shot(rest: str) -> Shot:
    if not rest.lower().endswith(".png"):
        raise UsageError("shot needs the name of a .png file", hint="shot picture.png")
    return Shot(rest)


def _live(rest: str) -> Live | LiveOff:
    if rest.lower() == "off":
        return LiveOff()
    if rest and not rest.lower().endswith(".png"):
        raise UsageError(
            f"live shows the picture here, in a .png file, or is off, not {rest!r}",
            hint="live, live picture.png, or live off",
        )
    return Live(rest)


def _number(word: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if value - value != 0:
        raise UsageError(
            f"{word} needs a number, not {text!r}", hint=f"for instance: {word} 5"
        )
    return value


def _unknown(line: str, word: str) -> UsageError:
    close = difflib.get_close_matches(word, _KNOWN, n=1)
    meant = f"did you mean {close[0]!r}? " if close else ""
    return UsageError(
        f"cannot understand {line.strip()!r}", hint=f"{meant}help lists the words"
    )
