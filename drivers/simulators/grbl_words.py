"""What words mean to the GRBL family: modes, targets, and the errors they cause."""

from __future__ import annotations

from dataclasses import dataclass, field

from drivers.simulators.gcode_words import WordError

_UNSUPPORTED, _CLASH, _NO_RATE, _REPEATED, _STRAY, _UNUSED, _NEGATIVE, _BAD_JOG = (
    20,
    21,
    22,
    25,
    31,
    36,
    4,
    16,
)
_MM_PER_INCH = 25.4
_GROUPS: dict[float, str] = {
    0.0: "motion",
    1.0: "motion",
    17.0: "plane",
    20.0: "units",
    21.0: "units",
    53.0: "machine",
    54.0: "offset",
    90.0: "distance",
    91.0: "distance",
    94.0: "rate",
    4.0: "dwell",
    80.0: "motion",
}


@dataclass
class Modal:
    """What stays in force from line to line."""

    motion: float = 0.0
    inches: bool = False
    relative: bool = False
    rate_min: float | None = None

    def text(self) -> str:
        """As ``$G`` says it."""
        units = "G20" if self.inches else "G21"
        distance = "G91" if self.relative else "G90"
        rate = self.rate_min or 0.0
        return (
            f"G{self.motion:.0f} G54 G17 {units} {distance} G94 M5 M9 T0 F{rate:g} S0"
        )


@dataclass(frozen=True)
class Motion:
    """What one line asks for; ``rate_min`` None is as fast as it goes."""

    target: dict[str, float] = field(default_factory=dict)
    relative: bool = False
    rate_min: float | None = None
    dwell_s: float | None = None


def parsed(
    found: list[tuple[str, float]], modal: Modal, letters: str, *, jog: bool = False
) -> Motion:
    """The meaning of a line; modes of ``modal`` are changed only if it is right.

    Raises:
        WordError: with the number that GRBL gives it.
    """
    codes = [value for letter, value in found if letter == "G"]
    values = {letter: value for letter, value in found if letter not in "GM"}
    _check(found, codes, letters, jog=jog)
    new = Modal(modal.motion, modal.inches, modal.relative, modal.rate_min)
    for code in codes:
        _apply(code, new)
    scale = _MM_PER_INCH if new.inches else 1.0
    if "F" in values:
        if values["F"] < 0:
            raise WordError(_NEGATIVE)
        new.rate_min = values["F"] * scale
    if 4.0 in codes:
        if "P" not in values:
            raise WordError(28)
        _adopt(modal, new)
        return Motion(dwell_s=values["P"])
    target = {
        letter: values[letter] * (scale if letter in "XYZ" else 1.0)
        for letter in letters
        if letter in values
    }
    fast = new.motion == 0.0 and not jog
    rate = values.get("F", 0.0) * scale if jog else new.rate_min
    if target and not fast and not rate:
        raise WordError(_NO_RATE)
    if not jog:
        _adopt(modal, new)
    return Motion(target, new.relative and 53.0 not in codes, None if fast else rate)


def _adopt(modal: Modal, new: Modal) -> None:
    modal.motion, modal.inches = new.motion, new.inches
    modal.relative, modal.rate_min = new.relative, new.rate_min


def _check(
    found: list[tuple[str, float]], codes: list[float], letters: str, *, jog: bool
) -> None:
    """Words that are unknown, clash, come twice or are of no use."""
    for code in codes:
        if code not in _GROUPS:
            raise WordError(_UNSUPPORTED)
        if jog and _GROUPS[code] in ("motion", "dwell"):
            raise WordError(_BAD_JOG)
    groups = [_GROUPS[code] for code in codes]
    if len(set(groups)) < len(groups):
        raise WordError(_CLASH)
    others = [letter for letter, _ in found if letter != "G"]
    if len(set(others)) < len(others):
        raise WordError(_REPEATED)
    for letter, value in found:
        if letter == "M" and value not in (0, 1, 2, 5, 9, 30):
            raise WordError(_UNSUPPORTED)
        if letter not in "GMFPSTN" + letters:
            raise WordError(_UNSUPPORTED)
    if 4.0 in codes and any(letter in letters for letter in others):
        raise WordError(_STRAY)
    if 4.0 not in codes and "P" in others:
        raise WordError(_UNUSED)


def _apply(code: float, modal: Modal) -> None:
    if code in (0.0, 1.0):
        modal.motion = code
    elif code in (20.0, 21.0):
        modal.inches = code == 20.0
    elif code in (90.0, 91.0):
        modal.relative = code == 91.0
