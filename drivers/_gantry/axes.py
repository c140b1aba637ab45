"""Joints of the arm and coordinates of the machine: two views of the same axes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mvp.errors import LimitError
from mvp.kinematics import arm_model

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from drivers._gantry.config import GantryConfig
    from mvp.geometry import FloatArray
    from mvp.kinematics import ArmModel

_SAME = 1e-6
_DIGITS = 4


class GantryAxes:
    """Axes as configured; refuses what lies outside their envelope.

    Args:
        config: letters, zeros, envelopes, speeds.
        name: of the device.
    """

    def __init__(self, config: GantryConfig, name: str) -> None:
        self.model: ArmModel = arm_model(config.model)
        self.letters = "".join(axis.letter for axis in config.axes)
        self._axes = config.axes
        self._name = name
        self._slides_first = config.firmware == "marlin"
        self._turns = np.array([unit == "rad" for unit in self.model.joint_units])
        self._zero = np.array([axis.zero for axis in config.axes])
        self._sign = np.array([float(axis.sign) for axis in config.axes])
        self._low = np.array([axis.low for axis in config.axes])
        self._high = np.array([axis.high for axis in config.axes])
        self._speed = np.array([axis.speed for axis in config.axes])
        self._ramp = np.array([axis.acceleration for axis in config.axes])
        self._tolerance = np.array([axis.tolerance for axis in config.axes])

    def joints(self, machine: Mapping[str, float]) -> tuple[float, ...]:
        """Joints (n,) rad or mm from machine coordinates."""
        values = self._sign * (self._vector(machine) - self._zero)
        return tuple(np.where(self._turns, np.radians(values), values).tolist())

    def machine(self, joints: FloatArray) -> FloatArray:
        """Machine coordinates (n,), mm or deg."""
        values = np.where(self._turns, np.degrees(joints), joints)
        return np.asarray(np.round(self._sign * values + self._zero, _DIGITS))

    def checked(self, joints: Sequence[float]) -> FloatArray:
        """Joints as an array.

        Raises:
            LimitError: not finite, or outside joint limits or envelope.
        """
        target = np.asarray(joints, dtype=np.float64)
        model = self.model
        if target.shape != (model.dof,) or not np.isfinite(target).all():
            raise LimitError(
                f"a target needs {model.dof} finite joint values", device=self._name
            )
        machine = self.machine(target)
        beyond = (machine < self._low - _SAME) | (machine > self._high + _SAME)
        beyond |= (target < model.joint_low) | (target > model.joint_high)
        if beyond.any():
            k = int(np.argmax(beyond))
            unit = "deg" if self._turns[k] else "mm"
            raise LimitError(
                f"axis {self.letters[k]} ({model.joint_names[k]}): {machine[k]:.3f} "
                f"{unit} is outside {self._low[k]:g} .. {self._high[k]:g}",
                device=self._name,
                hint="plan again, or move the part; nothing has moved",
            )
        return target

    def words(self, target: FloatArray, letters: str = "") -> str:
        """Axes of a target as G-code words, fixed point; all of them by default."""
        coordinates = self.machine(target)
        return " ".join(
            f"{letter}{_plain(value)}"
            for letter, value in zip(self.letters, coordinates, strict=True)
            if letter in (letters or self.letters)
        )

    def off(self, machine: Mapping[str, float], target: FloatArray) -> str:
        """Which axes do not stand at the target; empty when all do."""
        miss = self._vector(machine) - self.machine(target)
        return ", ".join(
            f"{letter} by {value:+.3f}"
            for letter, value, most in zip(
                self.letters, miss, self._tolerance, strict=True
            )
            if abs(value) > most
        )

    def duration_s(self, start: FloatArray, target: FloatArray, share: float) -> float:
        """How long the slowest axis takes for its ramps and its way."""
        way = np.abs(self.machine(target) - self.machine(start))
        speed = self._speed * share
        long = way / speed + speed / self._ramp
        short = 2 * np.sqrt(way / self._ramp)
        return float(np.where(way > speed**2 / self._ramp, long, short).max())

    def feed_min(self, start: FloatArray, target: FloatArray, share: float) -> float:
        """Feed per minute at which no axis is faster than its share of its speed.

        The GRBL family counts along the mixed mm and deg path; Marlin counts along the
        sliding axes alone, as soon as one of them moves.
        """
        way = np.abs(self.machine(target) - self.machine(start))
        seconds = float((way / (self._speed * share)).max())
        sliding = way[~self._turns]
        alone = self._slides_first and bool((sliding > 0).any())
        length = float(np.linalg.norm(sliding if alone else way))
        return max(60 * length / seconds, 1.0) if seconds > 0 else 60.0

    def _vector(self, machine: Mapping[str, float]) -> FloatArray:
        return np.array([machine[letter] for letter in self.letters])


def share_of(speed_fraction: float) -> float:
    """A share of full speed, as given.

    Raises:
        ValueError: it is none.
    """
    if not 0 < speed_fraction <= 1:
        raise ValueError("speed_fraction is above 0 and at most 1")
    return speed_fraction


def _plain(value: float) -> str:
    """A number as every firmware reads it: no exponent, no ``-0``."""
    text = f"{value:.{_DIGITS}f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text
