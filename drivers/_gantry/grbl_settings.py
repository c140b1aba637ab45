"""Settings of the GRBL family that this program does not write, but has an opinion on."""

from __future__ import annotations

import logging
import re
from typing import TYPE_CHECKING

from drivers._gantry.grbl_identity import listing, refuse_inches
from mvp.devices import Finding, text

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from drivers._gantry.config import GantryAxis, GantryConfig
    from mvp.devices import Session

_LOG = logging.getLogger(__name__)
_SETTING = re.compile(r"\$(\d{1,3})=\s*(-?\d{1,9}(?:\.\d{0,6})?)", re.ASCII)
_IDLE, _SOFT, _HARD, _HELD = 1, 20, 21, 37
_RATE, _ACCELERATION, _TRAVEL = 110, 120, 130
_NEVER_IDLE = 255
_SAME = 1e-6


def settings_doubts(
    session: Session, config: GantryConfig, letters: str, name: str
) -> tuple[Finding, ...]:
    """Ask for the settings, and log what is not as a camera needs it.

    Args:
        session: with the machine.
        config: what is asked of it.
        letters: of the firmware's axes, in its order.
        name: of the device.

    Raises:
        ConnectError: it reports in inches, or moves already.
        DeviceTimeout, LinkLost, WireError: no sensible answer.
    """
    accept = listing("$", name)
    lines = session.request_until(b"$$\n", accept, timeout_s=config.answer_s, tries=3)
    refuse_inches(lines, name)
    found = setting_findings(settings_of(lines), config.axes, letters)
    if found:
        said = "; ".join(f"{one.name}: {one.detail}" for one in found)
        _LOG.warning("%s: %s", name, said)
    return found


def settings_of(frames: Sequence[bytes]) -> dict[int, float]:
    """Numbers by number; what is no number is left out."""
    found = (_SETTING.match(text(frame).strip()) for frame in frames)
    return {int(one[1]): float(one[2]) for one in found if one is not None}


def setting_findings(
    settings: Mapping[int, float], axes: Sequence[GantryAxis], letters: str
) -> tuple[Finding, ...]:
    """What about a machine is not as a camera on it needs it.

    A setting that the firmware does not list is not judged: FluidNC keeps its machine
    in a file of its own.

    Args:
        settings: as the machine lists them.
        axes: as configured.
        letters: of the firmware's axes, in its order.
    """
    places = {axis.letter: letters.index(axis.letter) for axis in axes}
    found = [*_motors(settings, places), *_limits(settings)]
    for axis in axes:
        found += _axis(settings, axis, places[axis.letter])
    return tuple(found)


def _motors(
    settings: Mapping[int, float], places: Mapping[str, int]
) -> Iterator[Finding]:
    """Motors that are let go at rest: all of them, but for those that ``$37`` holds.

    Only grblHAL has that mask of axes; after 0 ms it lets go of all the same.
    """
    idle_ms = settings.get(_IDLE, _NEVER_IDLE)
    held = int(settings.get(_HELD, 0)) if idle_ms else 0
    loose = [letter for letter, place in places.items() if not held >> place & 1]
    if idle_ms != _NEVER_IDLE and loose:
        which = (
            "they are"
            if len(loose) == len(places)
            else f"those of {', '.join(loose)} are"
        )
        yield _warning(
            "motors",
            f"$1={idle_ms:g}: {which} let go {idle_ms:g} ms after every motion; an axis "
            "may sink or be pushed, and still counts as homed",
            "set $1=255 on the machine",
        )


def _limits(settings: Mapping[int, float]) -> Iterator[Finding]:
    if not int(settings.get(_SOFT, 1)) & 1:
        yield _warning(
            "soft limits",
            "$20=0: they are off; nothing but this program keeps to the envelope",
            "set $20=1 on the machine, with its travel in $130 and on",
        )
    if not int(settings.get(_HARD, 1)) & 1:
        yield _warning(
            "hard limits",
            "$21=0: they are off; a switch that is met in a move does not end it",
            "set $21=1 on the machine",
        )


def _axis(
    settings: Mapping[int, float], axis: GantryAxis, place: int
) -> Iterator[Finding]:
    """Limits of one axis that are below what the cell file asks of it."""
    asked = {
        _RATE: ("rate", axis.speed * 60, "speed is {:g} per minute"),
        _ACCELERATION: ("acceleration", axis.acceleration, "acceleration is {:g}"),
    }
    if not axis.declared:  # a firmware limits only what it has homed
        way = axis.high - axis.low
        asked[_TRAVEL] = ("travel", way, "low to high is {:g}")
    for base, (what, wanted, words) in asked.items():
        has = settings.get(base + place)
        if has is not None and has < wanted - _SAME:
            yield _warning(
                f"{axis.letter} {what}",
                f"${base + place}={has:g}, but its {words.format(wanted)} in the cell "
                "file",
                "correct [[arm.axes]], or the machine: moves come late or are refused",
            )


def _warning(name: str, detail: str, hint: str) -> Finding:
    return Finding(name, "warning", detail, hint)
