"""What ``$I`` and ``$$`` of the GRBL family say, and whether that is our machine."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mvp.devices import Take, text
from mvp.errors import ConnectError, DeviceError, WireError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from drivers._gantry.config import GantryConfig
    from mvp.devices import Accept

_VERSION = re.compile(r"\[VER:([^:\]]*):?([^\]]*)\]")
_AXES = re.compile(r"\[AXS:\d+:([XYZABCUVW]+)\]")
_INCHES = re.compile(r"\$13=\s*(\d{1,3}(?:\.\d{0,6})?)", re.ASCII)
_LISTED = ("[VER", "[OPT", "[AXS", "$")
_NOT_IDLE = 8


@dataclass(frozen=True)
class GrblIdentity:
    """Version, the owner's own text, and the letters of the axes in their order."""

    version: str
    user_text: str
    letters: str


def listing(head: str, name: str) -> Accept:
    """Takes the lines of ``$I`` or ``$$`` up to their ``ok``; an earlier one is stale.

    Args:
        head: how the first line begins.
        name: of the device, for errors.
    """
    begun = False

    def accept(frame: bytes) -> Take:
        nonlocal begun
        said = text(frame).strip()
        if said.startswith("error:"):
            raise _no_listing(said, name)
        if said == "ok":
            return Take.DONE if begun else Take.OTHER
        begun = begun or said.startswith(head)
        return Take.PART if said.startswith(_LISTED) else Take.OTHER

    return accept


def _no_listing(said: str, name: str) -> DeviceError:
    if error_number(said) != _NOT_IDLE:
        return WireError(f"answers {said} to a question", device=name)
    return ConnectError(
        "it is moving or held already",
        device=name,
        hint="wait until it stands, or stop whatever else drives it",
    )


def identity_of(
    frames: Sequence[bytes], config: GantryConfig, name: str
) -> GrblIdentity:
    """Who answered; the axes must be those that are configured.

    Raises:
        ConnectError: an axis is missing, or there is no version.
    """
    lines = [text(frame) for frame in frames]
    found = [m for line in lines if (m := _VERSION.search(line))]
    if not found:
        raise ConnectError(
            "it gives no version: this is no GRBL",
            device=name,
            hint="check port and firmware",
        )
    letters = next((m[1] for x in lines if (m := _AXES.search(x))), "XYZ")
    missing = [a.letter for a in config.axes if a.letter not in letters]
    if missing:
        raise ConnectError(
            f"it has the axes {letters}; {', '.join(missing)} of the configuration "
            "is not among them",
            device=name,
            hint="correct [[arm.axes]], or use a firmware with that axis: GRBL 1.1 "
            "itself has three, grblHAL and FluidNC have more",
        )
    return GrblIdentity(found[0][1], found[0][2].strip(), letters)


def refuse_inches(frames: Sequence[bytes], name: str) -> None:
    """Inches would be taken for millimetres.

    Raises:
        ConnectError: it reports in inches.
    """
    for frame in frames:
        setting = _INCHES.match(text(frame).strip())
        if setting is not None and float(setting[1]) != 0:
            raise ConnectError(
                "it reports in inches ($13=1)",
                device=name,
                hint="set $13=0 on the machine; this program writes no settings",
            )


def error_number(said: str) -> int:
    """The number after the colon; 0 when there is none."""
    digits = re.search(r":\s*(\d{1,4})", said)
    return int(digits[1]) if digits else 0
