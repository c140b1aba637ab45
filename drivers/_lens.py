"""What the drivers of motorised lenses share: ranges, the side of approach, deadlines.

The backlash of a motor is taken up by always arriving from the side from which the lens
table was measured, with a run-up where the motor comes from the other side.
"""

from __future__ import annotations

import logging
import math
from typing import TYPE_CHECKING, Literal, TypeAlias, TypeVar

from pydantic import Field, ValidationError, model_validator

from mvp.calibrated import LensTableCalibration
from mvp.devices import AXES, Axis, LensState, TransportConfig
from mvp.errors import (
    CalibrationError,
    ConfigError,
    DeviceTimeout,
    LimitError,
    MotionStopped,
)
from mvp.fileedge import FileModel

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from mvp.calibrated import AxisTable
    from mvp.devices import Clock, Link, Session

_LOG = logging.getLogger(__name__)
_RUN_UP = 1.5  # of the backlash, so that the last leg has taken it up for certain
_RUN_UP_STEPS = 4
_ASKED_AGAIN = 3

_T = TypeVar("_T")

Steps: TypeAlias = "dict[Axis, int]"


class AxisRange(FileModel):
    """Where one motor may be sent, in motor steps.

    Attributes:
        low: lowest step.
        high: highest step; the lowest one for a motor that stays where it is.
        approach: side from which every target is reached, that of the lens table.
        backlash_steps: width of the play; beyond ``low`` or ``high`` there must be room
            for one and a half times as much.
    """

    low: int
    high: int
    approach: Literal["from_below", "from_above"] = "from_below"
    backlash_steps: int = Field(default=0, ge=0)

    @model_validator(mode="after")
    def _ordered(self) -> AxisRange:
        if self.low > self.high:
            raise ValueError(f"low {self.low} is above high {self.high}")
        return self

    @property
    def sign(self) -> int:
        """Direction of the last leg."""
        return 1 if self.approach == "from_below" else -1

    @property
    def run_up_steps(self) -> int:
        """Least length of the last leg."""
        if not self.backlash_steps:
            return 0
        return math.ceil(_RUN_UP * self.backlash_steps) + _RUN_UP_STEPS

    @property
    def reach(self) -> tuple[int, int]:
        """Lowest and highest step that a motion to an allowed target passes."""
        back = self.sign * self.run_up_steps
        return self.low - max(back, 0), self.high - min(back, 0)


class LensConfig(TransportConfig):
    """Keys of every lens on a wire.

    Attributes:
        lens_table: file of the lens table, relative to the cell file; its first and
            last step, side and backlash hold for every axis not given here.
        zoom: range of that motor.
        focus: range of that motor.
        iris: range of that motor.
        answer_s: how long an answer may take that waits for no motion.
        quiet_s: silence after which no late answer is expected.
        identify_s: how long to ask for an identity; ports just plugged in are busy for
            some seconds.
    """

    lens_table: str = ""
    zoom: AxisRange | None = None
    focus: AxisRange | None = None
    iris: AxisRange | None = None
    answer_s: float = Field(default=1.0, gt=0)
    quiet_s: float = Field(default=0.2, ge=0)
    identify_s: float = Field(default=15.0, ge=0)


class LensAxes:
    """Ranges of the three motors, and how a target is approached.

    Args:
        config: says the ranges, or names the lens table that does.
        folder: where a relative name of the lens table starts.
        name: of the device.
        ends: lowest and highest step that each counter can hold.
    """

    def __init__(
        self,
        config: LensConfig,
        folder: Path,
        name: str,
        *,
        ends: Mapping[Axis, tuple[int, int]],
    ) -> None:
        self._config = config
        self._folder = folder
        self._name = name
        self._ends = ends
        self._ranges: dict[Axis, AxisRange] = {}
        self._engaged: set[Axis] = set()

    def ranges(self) -> dict[Axis, AxisRange]:
        """Range by axis; read at first use.

        Raises:
            ConfigError: an axis has none, or leaves no room for the run-up.
            CalibrationError: the lens table cannot be read.
        """
        if not self._ranges:
            ranges = self._configured()
            for axis in AXES:
                self._check_room(axis, ranges[axis])
            self._ranges = ranges
        return self._ranges

    def limits(self) -> dict[Axis, tuple[int, int]]:
        """Lowest and highest step by axis."""
        return {axis: (r.low, r.high) for axis, r in self.ranges().items()}

    def check(self, targets: Mapping[Axis, int]) -> None:
        """Raise ``LimitError`` when a target is outside its range."""
        for axis, (low, high) in self.limits().items():
            if not low <= targets[axis] <= high:
                raise LimitError(
                    f"{axis} step {targets[axis]} is outside {low} .. {high}",
                    device=self._name,
                    hint="plan within the lens table; nothing has moved",
                )

    def legs(
        self, now: Mapping[Axis, int], targets: Mapping[Axis, int]
    ) -> tuple[Steps, ...]:
        """One or two motions to the targets; the last one from the right side.

        An axis that stands at its target already, reached from that side, is left out.
        """
        first: Steps = {}
        last: Steps = {}
        for axis in AXES:
            target = targets[axis]
            if now[axis] == target and axis in self._engaged:
                continue
            range_ = self.ranges()[axis]
            run_up = range_.run_up_steps
            if not run_up or (target - now[axis]) * range_.sign >= run_up:
                first[axis] = target
            else:
                first[axis] = target - range_.sign * run_up
                last[axis] = target
        return tuple(leg for leg in (first, last) if leg)

    def disengage(self) -> None:
        """Forget from which side every axis came: something is about to move."""
        self._engaged.clear()

    def engage(self) -> None:
        """Note that every axis has arrived from its side."""
        self._engaged.update(AXES)

    def _configured(self) -> dict[Axis, AxisRange]:
        given = {axis: self._given(axis) for axis in AXES}
        ranges = {axis: r for axis, r in given.items() if r is not None}
        missing = [axis for axis in AXES if axis not in ranges]
        if not missing:
            return ranges
        if not self._config.lens_table:
            raise ConfigError(
                f"{self._name}: no range for {', '.join(missing)}",
                hint='give [lens.zoom] low and high, or lens_table = "<file>"',
                where=self._name,
            )
        table = self._read_table(self._folder / self._config.lens_table)
        return {axis: ranges.get(axis) or table[axis] for axis in AXES}

    def _given(self, axis: Axis) -> AxisRange | None:
        config = self._config
        return {"zoom": config.zoom, "focus": config.focus, "iris": config.iris}[axis]

    def _read_table(self, path: Path) -> dict[Axis, AxisRange]:
        try:
            table = LensTableCalibration.model_validate_json(path.read_bytes())
            return {
                "zoom": _range_of(table.zoom_f_mm),
                "focus": _range_of(table.focus_extension_mm),
                "iris": _range_of(table.iris_a_mm),
            }
        except (OSError, ValidationError) as error:
            raise CalibrationError(
                f"{self._name}: {path} is no lens table: {error}",
                hint="`mvp-cell calibrate lens` writes one",
                where=str(path),
            ) from error

    def _check_room(self, axis: Axis, range_: AxisRange) -> None:
        low, high = self._ends[axis]
        lowest, highest = range_.reach
        if lowest < low or highest > high:
            raise ConfigError(
                f"{self._name}: {axis} would move within {lowest} .. {highest} to take "
                f"up its backlash, but can only within {low} .. {high}",
                hint="narrow its range, or approach from the other side",
                where=self._name,
            )


class Deadline:
    """The moment at which a motion must have ended."""

    def __init__(self, clock: Clock, timeout_s: float) -> None:
        self._clock = clock
        self.end_s = clock.now_s() + timeout_s

    @property
    def left_s(self) -> float:
        """Time left, s; never negative."""
        return max(0.0, self.end_s - self._clock.now_s())

    @property
    def passed(self) -> bool:
        """Whether it is too late."""
        return self._clock.now_s() >= self.end_s


class Pace:
    """Waiting during a motion, cut short by a stop and ended by the deadline.

    Args:
        link: of the device; a stop interrupts it.
        clock: monotonic time.
        name: of the device.
    """

    def __init__(self, link: Link, clock: Clock, name: str) -> None:
        self._link = link
        self._clock = clock
        self._name = name

    def pause(self, seconds: float, deadline: Deadline) -> None:
        """Wait a moment.

        Raises:
            MotionStopped: a stop was asked for.
            DeviceTimeout: the deadline has passed.
        """
        self.rest(min(seconds, deadline.left_s))
        self.require_going()
        if deadline.passed:
            raise DeviceTimeout(
                "did not arrive in time; it has been stopped",
                device=self._name,
                hint="does an axis stick, or is its sensor not seen?",
            )

    def rest(self, seconds: float) -> None:
        """Wait a moment, or until a stop is asked for."""
        self._link.wait_until(self._clock.now_s() + seconds)

    def require_going(self) -> None:
        """Raise ``MotionStopped`` when a stop was asked for."""
        if self._link.interrupted:
            raise stopped(self._name)

    def require_ready(self, session: Session) -> None:
        """Just before an order that moves: in step, and still not told to stop.

        Getting into step takes its time, and a stop may come meanwhile.

        Raises:
            MotionStopped: a stop was asked for.
            DeviceTimeout, LinkLost, WireError: it does not get into step.
        """
        self.require_going()
        if session.out_of_step:
            session.resync()
            self.require_going()


def stopped(name: str) -> MotionStopped:
    """What a motion, and a question that waits meanwhile, end in."""
    return MotionStopped("stopped while it moved", device=name)


def despite_stops(ask: Callable[[], _T]) -> _T:
    """The answer for one who only looks: a stop ends a question, not the looking."""
    for _ in range(_ASKED_AGAIN):
        try:
            return ask()
        except MotionStopped:
            continue
    return ask()


def not_homed(name: str) -> LimitError:
    """The refusal to move before it is known where the motors are."""
    return LimitError(
        "not homed; nothing has moved",
        device=name,
        hint="call home(), or `mvp-cell home CELL`",
    )


def warn_untried(name: str, what: str) -> None:
    """Say that a driver has met its simulator only."""
    _LOG.warning("%s: the driver for %s was not tried on hardware", name, what)


def steps_of(state: LensState) -> Steps:
    """The three positions by axis."""
    return {"zoom": state.zoom, "focus": state.focus, "iris": state.iris}


def state_of(
    steps: Mapping[Axis, int], *, homed: bool, standing: bool, estimated: bool = False
) -> LensState:
    """The state of a lens at these steps."""
    return LensState(
        zoom=steps["zoom"],
        focus=steps["focus"],
        iris=steps["iris"],
        homed=homed,
        standing=standing,
        position_is_estimated=estimated,
    )


def _range_of(table: AxisTable) -> AxisRange:
    return AxisRange(
        low=min(table.steps),
        high=max(table.steps),
        approach=table.approach,
        backlash_steps=table.backlash_steps,
    )
