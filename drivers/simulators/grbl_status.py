"""The text of status reports and settings of the GRBL family."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from drivers.simulators.gcode_axes import Axes
    from drivers.simulators.grbl_profiles import GrblConfig, Profile

_WCO_IDLE, _WCO_BUSY, _OV_IDLE, _OV_BUSY = 10, 30, 10, 20


def settings_of(config: GrblConfig) -> dict[str, str]:
    """``$`` settings by number."""
    axes = config.driven
    low = sum(1 << k for k, axis in enumerate(axes) if axis.switch == "low")
    values = {
        "0": "10",
        "1": "255",
        "3": "0",
        "5": "0",
        "10": "3",
        "13": "0",
        "20": "1",
        "21": str(int(config.hard_limits)),
        "22": "1",
        "23": str(low),
        "24": f"{config.homing_feed_min:.3f}",
        "25": f"{config.homing_seek_min:.3f}",
        "26": "250",
        "27": f"{config.pull_off:.3f}",
    }
    if config.profile == "grblhal":
        values["37"] = "0"  # mask of the axes that stay energised
    for k, axis in enumerate(axes):
        values[str(100 + k)] = f"{axis.steps_per_unit:.3f}"
        values[str(110 + k)] = f"{axis.rate_min:.3f}"
        values[str(120 + k)] = f"{axis.acceleration:.3f}"
        values[str(130 + k)] = f"{axis.travel:.3f}"
    return values


class StatusWriter:
    """Writes reports; work offset and overrides come only now and then.

    Args:
        axes: what is reported.
        profile: the firmware.
    """

    def __init__(self, axes: Axes, profile: Profile) -> None:
        self._axes = axes
        self._profile = profile
        self.restart()

    def restart(self) -> None:
        """After a reset the work offset comes first and the overrides second."""
        self._until_offset = self._until_override = 0

    def report(
        self,
        state: str,
        *,
        mask: int,
        inches: bool,
        rx_free: int,
        homed: str,
        shown: tuple[int, ...],
    ) -> str:
        """One report.

        Args:
            state: with its sub-state.
            mask: setting ``$10``.
            inches: setting ``$13``.
            rx_free: free bytes of the receive buffer.
            homed: for firmwares that say it; empty for the others.
            shown: axes whose switch is covered.
        """
        axes, profile = self._axes, self._profile
        unit = np.array([_unit(a.letter, inches=inches) for a in axes.settings])
        place = _numbers(axes.quantised / unit)
        fields = [state, ("MPos:" if mask & 1 else "WPos:") + place]
        if mask & 2:
            fields.append(f"Bf:{profile.blocks - axes.waiting},{rx_free}")
        if not profile.shows_homed:
            fields.append(f"FS:{axes.rate_now:.0f},0")
        if shown:
            letters = "".join(axes.settings[k].letter for k in shown)
            fields.append(f"Pn:{letters}")
        fields += self._now_and_then(busy=axes.busy)
        if homed:
            fields.append(f"H:{homed}")
        return f"<{'|'.join(fields)}>"

    def _now_and_then(self, *, busy: bool) -> list[str]:
        """Each every so many reports, and never both in one."""
        found = []
        if self._until_offset > 0:
            self._until_offset -= 1
        else:
            self._until_offset = (_WCO_BUSY if busy else _WCO_IDLE) - 1
            self._until_override = max(self._until_override, 1)
            found = ["WCO:" + _numbers(np.zeros(len(self._axes.settings)))]
        if self._until_override > 0:
            self._until_override -= 1
        else:
            self._until_override = (_OV_BUSY if busy else _OV_IDLE) - 1
            found = [f"Ov:{100 * self._axes.override:.0f},100,100"]
        return found


def _unit(letter: str, *, inches: bool) -> float:
    """Length of the unit that an axis is reported in."""
    return 25.4 if inches and letter in "XYZ" else 1.0


def _numbers(values: np.ndarray) -> str:
    return ",".join(f"{value + 0.0:.3f}" for value in values)
