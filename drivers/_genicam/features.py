"""Names that cameras give to the same setting, and settings that are proved."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mvp.errors import DeviceFault, LimitError

if TYPE_CHECKING:
    from drivers._genicam.backend import Backend, Kind, Value


@dataclass(frozen=True)
class Alias:
    """One name of a quantity: the standard's (SFNC) or an older camera's.

    Attributes:
        unit: us for times; dB, or "raw" for a number only its maker understands.
    """

    feature: str
    kind: Kind
    unit: str


EXPOSURE = (
    Alias("ExposureTime", "float", "us"),
    Alias("ExposureTimeAbs", "float", "us"),
    Alias("ExposureTimeRaw", "integer", "us"),
)
GAIN = (
    Alias("Gain", "float", "dB"),
    Alias("GainAbs", "float", "dB"),
    Alias("GainRaw", "integer", "raw"),
)
AUTOMATIC = ("ExposureAuto", "GainAuto", "BalanceWhiteAuto")
_REAL_SAME = 0.01  # of a real number: cameras round to lines, ticks or tenths of dB


def resolve(backend: Backend, names: tuple[Alias, ...]) -> Alias | None:
    """The first name that this camera knows."""
    return next((alias for alias in names if backend.has(alias.feature)), None)


def apply(
    backend: Backend,
    feature: str,
    value: Value,
    *,
    device: str,
    slack: float = 0.0,
) -> Value:
    """Check the range, set, read back and compare; returns what was read.

    Cameras take nonsense without a word, and so do the libraries: a width beyond the
    sensor was accepted by both.

    A real number may be off by 1 % and ``slack``.

    Raises:
        LimitError: outside the camera's range, or not among its choices.
        DeviceFault: another value was read back.
        BackendLost, BackendRefused: from the library.
    """
    kind = _kind(value)
    if kind in ("integer", "float"):
        check_range(backend, feature, value, kind, device)
    elif kind == "enum" and value not in backend.choices(feature):
        raise LimitError(
            f"{feature} cannot be {value!r}",
            device=device,
            hint=f"it can be {', '.join(backend.choices(feature))}",
        )
    backend.set(feature, value)
    read = backend.get(feature, kind)
    if not _same(value, read, slack):
        raise DeviceFault(
            f"{feature} reads back as {read} instead of {value}",
            device=device,
            code="read-back",
            hint="another program may be using the camera, or another setting rules "
            "this one out",
        )
    return read


def _kind(value: Value) -> Kind:
    if isinstance(value, bool):
        return "boolean"
    if isinstance(value, int):
        return "integer"
    return "float" if isinstance(value, float) else "enum"


def check_range(
    backend: Backend, feature: str, value: Value, kind: Kind, device: str
) -> None:
    """Raise ``LimitError`` unless the camera says that it can take the value."""
    low, high = backend.bounds(feature, kind)
    if not low <= float(value) <= high:
        raise LimitError(
            f"{feature} {value} is outside {low:g} .. {high:g}",
            device=device,
            hint="choose a value inside the camera's range",
        )


def _same(asked: Value, read: Value, slack: float) -> bool:
    if isinstance(asked, float) and isinstance(read, int | float):
        return abs(read - asked) <= _REAL_SAME * abs(asked) + slack
    return asked == read


def gain_as_camera(gain: float, alias: Alias, db_per_raw: float, floor: float) -> Value:
    """A factor as the camera's own number.

    Args:
        gain: factor; 1 is no gain.
        alias: what the camera calls it.
        db_per_raw: dB of one raw unit.
        floor: the raw value or dB that means a factor of 1.
    """
    gain_db = 20.0 * math.log10(gain)
    if alias.unit == "raw":
        return round(floor + gain_db / db_per_raw)
    return floor + gain_db


def gain_of_camera(read: Value, alias: Alias, db_per_raw: float, floor: float) -> float:
    """The factor behind the camera's own number."""
    above = float(read) - floor
    return float(10.0 ** ((above * db_per_raw if alias.unit == "raw" else above) / 20))
