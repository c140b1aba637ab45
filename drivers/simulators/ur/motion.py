"""Moves of the arm as functions of time: joint moves, lines, blended paths, brakes.

Every move has trapezoidal speed. A blend starts the next move before the corner is
reached and adds both, so that the speed never jumps.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from drivers.simulators.ur.kinematics import Kinematics, NoSolutionError
from drivers.simulators.ur.poses import (
    Floats,
    matrix_of,
    rotation_vector,
    rotations_about,
)
from drivers.virtual_motion import Ramp, StraightMove

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

_KNOT_M = 0.001
_KNOT_RAD = 0.005
_KNOTS_MAX = 3000
_JUMP_RAD = 0.5
_NEVER_S = 1e9


class ScriptError(ValueError):
    """A run-time error of a robot program: the program ends."""


class Motion(Protocol):
    """Where the joints are, seconds after the start."""

    @property
    def duration_s(self) -> float:
        """When they stand."""
        ...

    def at(self, t_s: float) -> Floats:
        """(6,) rad."""
        ...


@dataclass(frozen=True, eq=False)
class LineMove:
    """Through joint knots (n, 6) that are evenly spaced along a straight tool path."""

    knots: Floats
    ramp: Ramp

    @property
    def duration_s(self) -> float:
        """When they stand."""
        return self.ramp.duration_s

    def at(self, t_s: float) -> Floats:
        """(6,) rad."""
        last = len(self.knots) - 1
        place = self.ramp.at(t_s) * last
        k = min(int(place), last - 1)
        return np.asarray(
            self.knots[k] + (place - k) * (self.knots[k + 1] - self.knots[k])
        )


@dataclass(frozen=True, eq=False)
class Brake:
    """From joints moving at a rate (6,) rad/s down to rest in ``duration_s``."""

    start: Floats
    rate: Floats
    duration_s: float

    def at(self, t_s: float) -> Floats:
        """(6,) rad."""
        if self.duration_s <= 0:
            return self.start
        t = min(max(t_s, 0.0), self.duration_s)
        return np.asarray(self.start + self.rate * (t - t * t / (2 * self.duration_s)))


@dataclass(frozen=True, eq=False)
class Chain:
    """Moves that follow each other; ``starts_s`` may lie before the previous end."""

    parts: tuple[Motion, ...]
    starts_s: tuple[float, ...]

    @property
    def duration_s(self) -> float:
        """When they stand."""
        return max(
            start + part.duration_s
            for part, start in zip(self.parts, self.starts_s, strict=True)
        )

    def at(self, t_s: float) -> Floats:
        """(6,) rad."""
        joints = self.parts[0].at(t_s)
        for part, start in zip(self.parts[1:], self.starts_s[1:], strict=True):
            if t_s > start:
                joints = joints + part.at(t_s - start) - part.at(0.0)
        return joints

    def index(self, t_s: float) -> int:
        """Which move began last."""
        return max(0, bisect_right(self.starts_s, t_s) - 1)


@dataclass(frozen=True)
class PathEntry:
    """One line of a path: target joints or pose (6), its speeds, its blend radius."""

    kind: str
    target: tuple[float, ...]
    acceleration: float
    speed: float
    blend_m: float = 0.0
    progress: int = 0


def joint_move(
    kin: Kinematics, start: Floats, target: Floats, *, speed: float, acceleration: float
) -> StraightMove:
    """All joints in step; the one with the longest way sets the pace.

    Raises:
        ScriptError: a speed that is not above zero, or a target beyond a limit.
    """
    _check_speeds(speed, acceleration)
    if not kin.reachable(target):
        raise ScriptError("movej: target outside the joint limits")
    return StraightMove.limited(
        start,
        target,
        speed=np.minimum(speed, kin.arm.joint_speed),
        acceleration=np.full(6, acceleration),
    )


def line_move(
    kin: Kinematics,
    start: Floats,
    target: Floats,
    tcp: Sequence[float],
    *,
    speed: float,
    acceleration: float,
) -> Motion:
    """The tool centre point runs straight to a pose (6,) and turns about one axis.

    Raises:
        ScriptError: a speed that is not above zero, out of reach, or a singularity
            on the way.
    """
    _check_speeds(speed, acceleration)
    tools, length = _straight(kin.flange(start) @ matrix_of(tcp), matrix_of(target))
    try:
        knots = kin.joints_along(tools, tcp, start)
    except NoSolutionError as error:
        raise ScriptError(f"movel: {error}") from error
    if np.abs(np.diff(knots, axis=0, prepend=start[None])).max() > _JUMP_RAD:
        raise ScriptError("movel: the line leads through a singularity")
    if length < 1e-9:
        return StraightMove(start, knots[-1], Ramp(1.0, 1.0))
    ramp = Ramp(speed / length, acceleration / length)
    return LineMove(knots, ramp)


def path_move(
    kin: Kinematics, start: Floats, entries: Sequence[PathEntry], tcp: Sequence[float]
) -> Chain:
    """A whole path with its blends.

    Raises:
        ScriptError: one of its moves is impossible.
    """
    parts: list[Motion] = []
    starts: list[float] = []
    begins, here = 0.0, start
    for entry in entries:
        part = _part(kin, here, entry, tcp)
        parts.append(part)
        starts.append(begins)
        here = part.at(_NEVER_S)
        begins += part.duration_s
        if entry is not entries[-1]:
            begins -= _overlap_s(kin, part, entry.blend_m)
    return Chain(tuple(parts), tuple(starts))


def brake(start: Floats, rate: Floats, deceleration: float) -> Brake:
    """``stopj``: the fastest joint slows down at ``deceleration``, rad/s^2.

    Raises:
        ScriptError: a deceleration that is not above zero.
    """
    _check_speeds(1.0, deceleration)
    return Brake(start, rate, float(np.abs(rate).max()) / deceleration)


def tool_brake(
    kin: Kinematics,
    start: Floats,
    rate: Floats,
    tcp: Sequence[float],
    deceleration: float,
) -> Brake:
    """``stopl``: the tool centre point slows down at ``deceleration``, m/s^2.

    Raises:
        ScriptError: a deceleration that is not above zero.
    """
    _check_speeds(1.0, deceleration)
    velocity = kin.jacobian(start, tcp) @ rate
    speed = max(float(np.linalg.norm(velocity[:3])), _slowest(velocity, rate))
    return Brake(start, rate, speed / deceleration)


def _slowest(velocity: Floats, rate: Floats) -> float:
    """What to slow down when the tool turns on the spot: its turning, or the joints."""
    if np.linalg.norm(velocity[:3]) > 1e-3:
        return 0.0
    return max(float(np.linalg.norm(velocity[3:])), float(np.abs(rate).max()))


def _check_speeds(speed: float, acceleration: float) -> None:
    if not (0 < speed < np.inf and 0 < acceleration < np.inf):
        raise ScriptError("speed and acceleration must be above zero")


def _straight(start: Floats, end: Floats) -> tuple[Floats, float]:
    """Transforms (n, 4, 4) from start to end, and the path length, m or rad."""
    shift = end[:3, 3] - start[:3, 3]
    turn = rotation_vector(start[:3, :3].T @ end[:3, :3])
    way, angle = float(np.linalg.norm(shift)), float(np.linalg.norm(turn))
    count = int(np.clip(max(way / _KNOT_M, angle / _KNOT_RAD), 8, _KNOTS_MAX))
    tools = np.tile(np.eye(4), (count + 1, 1, 1))
    shares = np.linspace(0.0, 1.0, count + 1)
    tools[:, :3, :3] = start[:3, :3] @ rotations_about(turn, shares)
    tools[:, :3, 3] = start[:3, 3] + shares[:, None] * shift
    return tools, max(way, angle) if way < 1e-6 else way


def _part(
    kin: Kinematics, start: Floats, entry: PathEntry, tcp: Sequence[float]
) -> Motion:
    """One move of a path."""
    target = np.array(entry.target)
    speeds = {"speed": entry.speed, "acceleration": entry.acceleration}
    if entry.kind == "movej":
        return joint_move(kin, start, target, **speeds)
    return line_move(kin, start, target, tcp, **speeds)


def _overlap_s(kin: Kinematics, part: Motion, blend_m: float) -> float:
    """How long before the end of a move the tool is within the blend radius."""
    if blend_m <= 0 or part.duration_s <= 0:
        return 0.0
    end = kin.flange(part.at(_NEVER_S))[:3, 3]

    def inside(before_s: float) -> bool:
        place = kin.flange(part.at(part.duration_s - before_s))[:3, 3]
        return bool(np.linalg.norm(place - end) < blend_m)

    return _largest(inside, part.duration_s / 2)


def _largest(holds: Callable[[float], bool], most: float) -> float:
    """The largest value up to ``most`` for which it holds, by bisection."""
    if holds(most):
        return most
    low, high = 0.0, most
    for _ in range(20):
        middle = (low + high) / 2
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low
