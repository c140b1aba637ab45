"""In what GRBL 1.1, grblHAL and FluidNC differ, and the keys of their simulator."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

from pydantic import Field

from drivers.simulators.gcode_axes import AxisSettings, camera_head, slide
from drivers.simulators.motor import RateSettings
from drivers.simulators.serial_simulator import LineSettings


@dataclass(frozen=True)
class Profile:
    """One firmware.

    Attributes:
        banner: line after a restart.
        version, options: of ``$I``.
        rx_bytes: size of the receive buffer.
        blocks: moves that fit into the queue.
        line_max: longest line.
        counts_both_ends: CR LF are two lines.
        sticky_error: after an error every G-code is refused.
        dead_after_alarm: answers nothing after a limit alarm until a reset.
        shows_homed: status has ``H:``.
        answers_every_query: instead of once for many.
        homes_axes: ``$HX`` and the like; grblHAL needs bit 1 of ``$22`` for it.
        homes_head: ``$H`` homes the axes beside X, Y and Z as well.
        enforces_unhomed: soft limits act before homing.
        binary_commands: real-time bytes above 7F stand in for ``? ~ !``.
        bytes_per_line: that arrive at 115200 Bd while it parses one line; 0 for none.
    """

    banner: str
    version: str
    options: str
    rx_bytes: int
    blocks: int
    line_max: int
    counts_both_ends: bool
    sticky_error: bool
    dead_after_alarm: bool
    shows_homed: bool
    answers_every_query: bool
    homes_axes: bool
    enforces_unhomed: bool
    homes_head: bool = False
    binary_commands: bool = False
    bytes_per_line: int = 0
    unlock_hint: str = "[MSG:'$H'|'$X' to unlock]"


PROFILES: dict[str, Profile] = {
    "grbl": Profile(
        banner="Grbl 1.1h ['$' for help]",
        version="1.1h.20190830",
        options="[OPT:V,15,128]",
        rx_bytes=128,
        blocks=15,
        line_max=79,
        counts_both_ends=True,
        sticky_error=False,
        dead_after_alarm=True,
        shows_homed=False,
        answers_every_query=False,
        homes_axes=False,
        enforces_unhomed=True,
        bytes_per_line=135,
    ),
    "grblhal": Profile(
        banner="GrblHAL 1.1f ['$' or '$HELP' for help]",
        version="1.1f.20240928",
        options="[OPT:VNML+,100,1024,5,0]",
        rx_bytes=1024,
        blocks=100,
        line_max=256,
        counts_both_ends=False,
        sticky_error=True,
        dead_after_alarm=False,
        shows_homed=True,
        answers_every_query=True,
        homes_axes=True,
        enforces_unhomed=False,
        binary_commands=True,
    ),
    "fluidnc": Profile(
        banner="Grbl 3.7 [FluidNC v3.7.16 (wifi) '$' for help]",
        version="3.7 FluidNC v3.7.16",
        options="[OPT:PHSBW]",
        rx_bytes=1024,
        blocks=16,
        line_max=255,
        counts_both_ends=False,
        sticky_error=False,
        dead_after_alarm=False,
        shows_homed=False,
        answers_every_query=True,
        homes_axes=True,
        enforces_unhomed=True,
        homes_head=True,
    ),
}


Quirk: TypeAlias = Literal[
    "dead_after_alarm", "counts_both_ends", "coalesces_queries", "small_buffer"
]


def profile_of(config: GrblConfig) -> Profile:
    """The firmware, with the quirks of GRBL 1.1 that the machine has as well."""
    grbl, profile = PROFILES["grbl"], PROFILES[config.profile]
    if "dead_after_alarm" in config.quirks:
        profile = replace(profile, dead_after_alarm=grbl.dead_after_alarm)
    if "counts_both_ends" in config.quirks:
        profile = replace(profile, counts_both_ends=grbl.counts_both_ends)
    if "coalesces_queries" in config.quirks:
        profile = replace(profile, answers_every_query=grbl.answers_every_query)
    if "small_buffer" in config.quirks:
        profile = replace(
            profile,
            rx_bytes=grbl.rx_bytes,
            blocks=grbl.blocks,
            line_max=grbl.line_max,
            bytes_per_line=grbl.bytes_per_line,
        )
    return profile


def camera_gantry() -> tuple[AxisSettings, ...]:
    """X, Y, Z with switches at their positive ends; A pans, B tilts, neither homed."""
    places = (("X", 1200, -600, 600), ("Y", 1200, -600, 600), ("Z", 900, -300, 900))
    slides = (
        slide(
            letter,
            travel,
            start=start,
            joint_zero=zero,
            switch="high",
            steps_per_unit=250,
        )
        for letter, travel, start, zero in places
    )
    return (*slides, *camera_head())


class GrblConfig(LineSettings, RateSettings):
    """Keys of the simulator.

    Attributes:
        profile: the firmware.
        axes: the machine; GRBL itself takes the first three.
        homing_seek_min: fast approach of the switch, mm per minute.
        homing_feed_min: slow approach.
        pull_off: from the switch after homing, mm.
        hard_limits: a switch that is met in a move is an alarm.
        resets_on_open: boards that restart when the port is opened.
        locked: as it is when just switched on; else as somebody has left it.
        hold_byte: whether ``!`` and ``~`` act.
        user_text: of ``$I``, which an owner writes into the controller.
        settings: ``$`` numbers that differ from what the other keys say.
        quirks: of GRBL 1.1, which some boards with more axes share: nothing is answered
            after a limit alarm until a reset, CR LF are two lines, many ``?`` are
            answered once, 128 bytes of receive buffer.
        auto_report_s: FluidNC and grblHAL may report unasked; 0 for never.
    """

    profile: Literal["grbl", "grblhal", "fluidnc"] = "grblhal"
    axes: tuple[AxisSettings, ...] = Field(default_factory=camera_gantry)
    homing_seek_min: float = Field(default=3000.0, gt=0)
    homing_feed_min: float = Field(default=100.0, gt=0)
    pull_off: float = Field(default=1.0, gt=0)
    hard_limits: bool = False
    resets_on_open: bool = True
    locked: bool = True
    hold_byte: bool = True
    boot_s: float = Field(default=0.5, ge=0)
    user_text: str = ""
    settings: dict[str, str] = Field(default_factory=dict)
    quirks: tuple[Quirk, ...] = ()
    auto_report_s: float = Field(default=0.0, ge=0)

    @property
    def driven(self) -> tuple[AxisSettings, ...]:
        """The axes that this firmware drives."""
        return self.axes[:3] if self.profile == "grbl" else self.axes
