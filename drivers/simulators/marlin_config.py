"""The Marlin gantry that is simulated, and the keys of its simulator."""

from __future__ import annotations

from pydantic import Field

from drivers.simulators.gcode_axes import AxisSettings, camera_head, slide
from drivers.simulators.motor import RateSettings
from drivers.simulators.serial_simulator import LineSettings


def marlin_gantry() -> tuple[AxisSettings, ...]:
    """X, Y, Z with switches at their low ends; A pans, B tilts, neither homed."""
    places = (("X", 1200, -600), ("Y", 1200, -600), ("Z", 900, 0))
    slides = (
        slide(
            letter,
            travel,
            start=travel / 2,
            joint_zero=zero,
            switch="low",
            steps_per_unit=80,
        )
        for letter, travel, zero in places
    )
    return (*slides, *camera_head())


class MarlinConfig(LineSettings, RateSettings):
    """Keys of the simulator.

    Attributes:
        axes: the machine.
        homing_seek_min: fast approach of the switch, mm per minute.
        homing_feed_min: slow approach.
        pull_off: bump before the slow approach, mm.
        resets_on_open: 8-bit boards restart when the port is opened.
        advanced_ok: ``ok`` carries line number and free places.
        uuid: of ``M115``; the default is that of boards that got none.
        emergency_parser: ``M410`` and ``M112`` act at once instead of in turn.
    """

    axes: tuple[AxisSettings, ...] = Field(default_factory=marlin_gantry)
    homing_seek_min: float = Field(default=3000.0, gt=0)
    homing_feed_min: float = Field(default=300.0, gt=0)
    pull_off: float = Field(default=5.0, gt=0)
    resets_on_open: bool = True
    advanced_ok: bool = False
    uuid: str = "cede2a2f-41a2-4748-9b12-c55c62f367ff"
    emergency_parser: bool = True
    boot_s: float = Field(default=0.5, ge=0)
