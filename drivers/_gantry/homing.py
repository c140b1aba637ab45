"""Axes that nothing measures: what homing makes of them, in words and in joints."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np

from mvp.devices import Homing, RecoveryStep
from mvp.errors import DeviceError, DeviceFault

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from drivers._gantry.axes import GantryAxes
    from drivers._gantry.config import GantryAxis
    from drivers._gantry.wire import Report
    from mvp.devices.protocols import ClearWay

_SLIDES = "XYZ"  # what ``$H`` of every firmware homes
_BY_HAND = (
    "switch the controller off, turn them to their marks by hand and switch it on "
    "again, so that it counts from there"
)


def homing_of(axes: Sequence[GantryAxis], report: Report) -> Homing:
    """What homing would move from here, and what is only believed."""
    found = [axis.letter for axis in axes if not axis.declared]
    words = (
        f"The axes {', '.join(found)} go to their switches, on a way of the "
        "controller's own that nothing can check: nothing may be in it."
    )
    declared = [axis for axis in axes if axis.declared]
    if not declared:
        return Homing(words)
    believed = tuple(_believed(axis, report) for axis in declared)
    words += (
        " Nothing measures these axes, they are believed to be at "
        f"{', '.join(believed)}."
    )
    away = tuple(axis.letter for axis in _away(axes, report))
    if away:
        words += (
            f" After that {', '.join(away)} turn back to their marks, if that way is "
            "clear."
        )
    return Homing(words, away, believed)


def beside_slides(axes: Sequence[GantryAxis]) -> list[str]:
    """Letters of the axes with a switch that a controller may leave out of homing."""
    return [a.letter for a in axes if not a.declared and a.letter not in _SLIDES]


def is_known(report: Report, axes: Sequence[GantryAxis]) -> bool:
    """Whether the firmware itself knows every axis, and says so.

    Never of an axis that nothing measures: a hand may have turned it. And not of a head
    when it does not say which axes it means.
    """
    if report.homed is not True or any(axis.declared for axis in axes):
        return False
    if report.found is None:
        return not beside_slides(axes)
    return report.found >= {axis.letter for axis in axes}


def require_found(report: Report, axes: Sequence[GantryAxis], name: str) -> None:
    """After homing no axis with a switch is missing from what the firmware has homed.

    Raises:
        DeviceFault: one is, or it says that it is not homed.
    """
    switched = [axis.letter for axis in axes if not axis.declared]
    if report.found is not None:
        switched = [letter for letter in switched if letter not in report.found]
    elif report.homed is not False:
        return
    if switched:
        raise DeviceFault(
            f"the controller has homed, but not {', '.join(switched)}",
            device=name,
            code="home",
            hint="give that axis a place in its homing sequence, or write "
            'home = "declared" where it has no switch',
        )


def homing_step(look: Callable[[], Homing], act: Callable[[], str]) -> RecoveryStep:
    """Homing as a step back; left to those who know the cell where the head would turn.

    Args:
        look: what it would do; an arm that cannot be asked is asked again by ``act``.
        act: does it.
    """
    homing = Homing("The axes go to their switches: nothing may be in their way.")
    with suppress(DeviceError):
        homing = look()
    words = "It is not known where the axes are. "
    if not homing.away:
        return RecoveryStep(words + homing.words, acknowledge=True, act=act)
    return RecoveryStep(
        f"{words}{', '.join(homing.away)} are away from their marks: `mvp-cell home "
        "CELL` homes it, and looks first whether their way back is clear.",
        acknowledge=True,
        act=lambda: "not homed yet",
    )


def _believed(axis: GantryAxis, report: Report) -> str:
    at = report.machine[axis.letter]
    if abs(at - axis.declared_at) <= axis.tolerance:
        return f"{axis.letter} {axis.declared_at:g} (its mark)"
    return f"{axis.letter} {at:g} (its mark is {axis.declared_at:g})"


def way_to_marks(
    axes: GantryAxes, declared: Sequence[GantryAxis], report: Report
) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
    """Joints before and after the motion to the marks; None where it is there."""
    if not _away(declared, report):
        return None
    marks = {axis.letter: axis.declared_at for axis in declared if axis.declared}
    return axes.joints(report.machine), axes.joints({**report.machine, **marks})


def require_clear(
    way: tuple[tuple[float, ...], tuple[float, ...]],
    clear: ClearWay | None,
    name: str,
) -> None:
    """Let whoever knows the cell judge a motion before it begins.

    Raises:
        DeviceFault: nobody can say whether it is clear.
        Whatever ``clear`` raises.
    """
    if clear is None:
        raise DeviceFault(
            "axes without a switch are counted away from their marks, and nobody can "
            "say here whether their way back is clear; they were left where they are",
            device=name,
            code="declared",
            hint=f"`mvp-cell home CELL` checks that way; or {_BY_HAND}",
        )
    clear(*way)


def require_marks(report: Report, axes: Sequence[GantryAxis], name: str) -> None:
    """Axes that nothing measures stand at their marks, as far as they are counted.

    Raises:
        DeviceFault: one does not.
    """
    for axis in _away(axes, report):
        at = report.machine[axis.letter]
        raise DeviceFault(
            f"axis {axis.letter} reads {at:g}, its mark is {axis.declared_at:g}",
            device=name,
            code="declared",
            hint=_BY_HAND,
        )


def _away(axes: Sequence[GantryAxis], report: Report) -> list[GantryAxis]:
    """Declared axes that are counted away from their marks."""
    declared = [axis for axis in axes if axis.declared]
    here = np.array([report.machine[axis.letter] for axis in declared])
    marks = np.array([axis.declared_at for axis in declared])
    most = np.array([axis.tolerance for axis in declared])
    return [declared[k] for k in np.flatnonzero(np.abs(here - marks) > most)]
