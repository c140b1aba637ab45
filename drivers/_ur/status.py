"""One moment of the robot as its controller reports it, and how old that is."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

JOINTS = 6
_FARTHEST_RAD = 2 * math.pi + 0.1
_STILL_RAD_S = 0.01  # encoders of an arm at rest are not quite silent
_DRIFT = 0.05  # a clock that limps is forgiven, a silence is not


class Implausible(ValueError):
    """A frame that no robot can have sent on purpose."""


@dataclass(frozen=True)
class Status:
    """One data frame; SI units as on the wire.

    Attributes:
        t_controller_s: the controller's own clock.
        joints_rad: (6,) measured.
        speeds_rad_s: (6,) measured.
        target_speeds_rad_s: (6,) commanded.
        tcp_m_rad: pose of the tool point: metres and rotation vector.
        slider: speed slider, 0 to 1.
        payload_kg: nan where the controller does not tell.
        payload_cog_m: (3,) as above.
    """

    t_controller_s: float
    joints_rad: tuple[float, ...]
    speeds_rad_s: tuple[float, ...]
    target_speeds_rad_s: tuple[float, ...]
    tcp_m_rad: tuple[float, ...]
    robot_mode: int
    safety_mode: int
    safety_bits: int
    runtime_state: int
    slider: float
    payload_kg: float | None = None
    payload_cog_m: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        for name in _SIXES:
            if len(getattr(self, name)) != JOINTS:
                raise Implausible(f"{name} has {len(getattr(self, name))} values")
        numbers = [self.t_controller_s, self.slider]
        numbers += [value for name in _SIXES for value in getattr(self, name)]
        if not all(math.isfinite(value) for value in numbers):
            raise Implausible("a value is no number")
        if max(map(abs, self.joints_rad)) > _FARTHEST_RAD:
            raise Implausible("a joint is more than one turn away")
        if not -1 <= self.robot_mode <= 8:
            raise Implausible(f"robot mode {self.robot_mode}")

    @property
    def standing(self) -> bool:
        """Nothing is commanded to move, and nothing does."""
        speeds = (*self.speeds_rad_s, *self.target_speeds_rad_s)
        return max(map(abs, speeds)) < _STILL_RAD_S

    def to_wire(self) -> dict[str, object]:
        """As JSON can carry it."""
        return {name: getattr(self, name) for name in _NAMES}

    @classmethod
    def from_wire(cls, data: Mapping[str, object]) -> Status:
        """The inverse of ``to_wire``.

        Raises:
            Implausible: not what ``to_wire`` gives.
        """
        if data.keys() != _NAMES:
            raise Implausible("not the fields of a status")
        values = {
            name: tuple(value) if isinstance(value, Sequence) else value
            for name, value in data.items()
        }
        try:
            return cls(**values)  # type: ignore[arg-type]
        except (TypeError, OverflowError) as error:
            raise Implausible(str(error)) from error


_NAMES = dict.fromkeys(field.name for field in fields(Status)).keys()
_SIXES = ("joints_rad", "speeds_rad_s", "target_speeds_rad_s", "tcp_m_rad")


class Freshness:
    """Age of the controller's data by the controller's own clock.

    The smallest delay between its time stamp and our clock counts as none, so frames
    that queue up on the way are seen to be old although they have only just arrived.
    """

    def __init__(self) -> None:
        self._offset = math.inf
        self._arrived_s = 0.0
        self._stamp_s = -math.inf

    def note(self, t_controller_s: float, now_s: float) -> None:
        """A frame has arrived."""
        leaked = self._offset + _DRIFT * (now_s - self._arrived_s)
        self._offset = min(now_s - t_controller_s, leaked)
        self._arrived_s, self._stamp_s = now_s, t_controller_s

    def age_s(self, now_s: float) -> float:
        """How long ago the newest frame was true; inf before the first."""
        if not math.isfinite(self._offset):
            return math.inf
        return max(0.0, now_s - self._stamp_s - self._offset)
