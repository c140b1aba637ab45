"""Setting exposure and gain: not at all, through V4L2, or over HTTP."""

from __future__ import annotations

import json
import logging
import math
from dataclasses import dataclass, field
from http.client import HTTPException
from typing import TYPE_CHECKING, Protocol
from urllib.error import URLError
from urllib.request import ProxyHandler, build_opener

from drivers._opencv.source import prove
from mvp.errors import DeviceFault, LimitError, LinkLost, WireError

if TYPE_CHECKING:
    import cv2

_LOG = logging.getLogger(__name__)
_SAME = 0.01
_V4L2_TICK_S = 1e-4  # exposure_time_absolute counts 100 us
_V4L2_MANUAL = 1.0
_US = 1e6
_ANSWER_MAX = 65536


class Exposure(Protocol):
    """How a source's exposure is set."""

    def limits_s(self) -> tuple[float, float]:
        """Shortest and longest exposure."""
        ...

    def apply(self, exposure_s: float, gain: float) -> tuple[float, float]:
        """Set, and return what was read back.

        Raises:
            LimitError: out of range.
            DeviceFault: it reads back as something else.
        """
        ...


def check_limits(
    limits_s: tuple[float, float], exposure_s: float, device: str, hint: str
) -> None:
    """Raise ``LimitError`` unless inside, to 1 in a million."""
    low, high = limits_s
    if not low * (1 - 1e-6) <= exposure_s <= high * (1 + 1e-6):
        raise LimitError(
            f"exposure {exposure_s:.6f} s is outside {low:.6f} .. {high:.6f} s",
            device=device,
            hint=hint,
        )


@dataclass(frozen=True)
class FixedExposure:
    """A source whose exposure is what it is; a person has stated it."""

    exposure_s: float
    device: str

    def limits_s(self) -> tuple[float, float]:
        """Both ends are the stated exposure."""
        return self.exposure_s, self.exposure_s

    def apply(self, exposure_s: float, gain: float) -> tuple[float, float]:
        """Accept the stated exposure, without gain, and nothing else."""
        check_limits(
            self.limits_s(),
            exposure_s,
            self.device,
            "this source's exposure cannot be set here: set it in the camera and "
            "state it as fixed_exposure_s",
        )
        if gain != 1.0:
            raise LimitError(
                f"gain {gain:g} cannot be set on this source",
                device=self.device,
                hint="a gain of 1 means the gain it has",
            )
        return self.exposure_s, 1.0


@dataclass(frozen=True)
class HttpExposure:
    """A network camera that takes exposure and gain in a URL and answers with JSON.

    Attributes:
        url: with ``{exposure_us}`` and ``{gain}``; the answer is an object with the
            numbers ``exposure_us`` and ``gain`` that are in force.
    """

    url: str
    range_s: tuple[float, float]
    timeout_s: float
    device: str

    def limits_s(self) -> tuple[float, float]:
        """As the cell file states them."""
        return self.range_s

    def apply(self, exposure_s: float, gain: float) -> tuple[float, float]:
        """Ask, and compare the answer."""
        check_limits(self.range_s, exposure_s, self.device, "see exposure_min_s")
        url = self.url.format(exposure_us=exposure_s * _US, gain=gain)
        said = self._ask(url)
        try:
            read_s, read_gain = in_force(said)
        except ValueError as error:
            raise WireError(f"{url} answered {error}", device=self.device) from error
        self._compare("exposure", exposure_s, read_s)
        self._compare("gain", gain, read_gain)
        return read_s, read_gain

    def _ask(self, url: str) -> bytes:
        # Never through a proxy: the camera is on the cell's own network.
        opener = build_opener(ProxyHandler({}))
        try:
            with opener.open(url, timeout=self.timeout_s) as answer:
                return bytes(answer.read(_ANSWER_MAX))
        except HTTPException as error:
            raise WireError(
                f"{url} answered something that is not HTTP: {error!r}",
                device=self.device,
                hint="control_url must be that of the camera's exposure",
            ) from error
        except (URLError, OSError) as error:
            raise LinkLost(
                f"{url}: {error}",
                device=self.device,
                hint="check control_url and the network",
            ) from error

    def _compare(self, what: str, asked: float, read: float) -> None:
        if abs(read - asked) > _SAME * abs(asked):
            raise DeviceFault(
                f"{what} reads back as {read:g} instead of {asked:g}",
                device=self.device,
                code="read-back",
                hint="another program may be using the camera",
            )


def in_force(answer: bytes) -> tuple[float, float]:
    """Exposure in s and gain that a network camera says it has.

    Raises:
        ValueError: not an object with the finite numbers ``exposure_us`` and ``gain``.
    """
    try:
        said = json.loads(answer)
    except (ValueError, RecursionError) as error:
        raise ValueError("no JSON") from error
    if not isinstance(said, dict):
        raise ValueError("no JSON object")
    exposure_us, gain = _number(said.get("exposure_us")), _number(said.get("gain"))
    if exposure_us is None or gain is None:
        raise ValueError("without exposure_us and gain, or they are no finite numbers")
    return exposure_us / _US, gain


def _number(value: object) -> float | None:
    """A finite number, also one that is written as text."""
    try:
        number = float(str(value))
    except ValueError:
        return None
    return number if math.isfinite(number) else None


@dataclass
class V4l2Exposure:
    """A USB camera's controls; automatic exposure is switched off first.

    OpenCV cannot switch automatic gain off: a gain that changes gives it away.
    """

    capture: cv2.VideoCapture
    range_s: tuple[float, float]
    allow_automatic: bool
    device: str
    _gain_at_start: float | None = field(default=None, init=False)

    def limits_s(self) -> tuple[float, float]:
        """As the cell file states them; OpenCV does not tell the camera's own."""
        return self.range_s

    def switch_off_automatic(self) -> None:
        """Automatic exposure, white balance and focus off, or refuse.

        Raises:
            DeviceFault: automatic exposure stays on and that was not allowed.
        """
        import cv2

        self.capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, _V4L2_MANUAL)
        if self.capture.get(cv2.CAP_PROP_AUTO_EXPOSURE) != _V4L2_MANUAL:
            self._complain("automatic exposure")
        for key, what in (
            (cv2.CAP_PROP_AUTO_WB, "automatic white balance"),
            (cv2.CAP_PROP_AUTOFOCUS, "automatic focus"),
        ):
            self.capture.set(key, 0)
            if self.capture.get(key) > 0:
                _LOG.warning("%s: %s stays on", self.device, what)
        self._gain_at_start = self.capture.get(cv2.CAP_PROP_GAIN)

    def apply(self, exposure_s: float, gain: float) -> tuple[float, float]:
        """Set in steps of 100 us and read back; gain only where it is 1.

        Raises:
            DeviceFault: the gain is not what it was, and that was not allowed.
        """
        import cv2

        check_limits(self.range_s, exposure_s, self.device, "see exposure_min_s")
        if gain != 1.0:
            raise LimitError(
                f"gain {gain:g} cannot be set: the unit of a USB camera's gain is "
                "not known",
                device=self.device,
                hint="set it with `v4l2-ctl -c gain=...` and keep 1 in the task",
            )
        ticks = max(1, round(exposure_s / _V4L2_TICK_S))
        prove(self.capture, cv2.CAP_PROP_EXPOSURE, ticks, "exposure", self.device)
        gain_now = self.capture.get(cv2.CAP_PROP_GAIN)
        if self._gain_at_start is not None and gain_now != self._gain_at_start:
            self._complain(
                f"automatic gain, which went from {self._gain_at_start:g} to {gain_now:g},"
            )
        return ticks * _V4L2_TICK_S, 1.0

    def _complain(self, what: str) -> None:
        if not self.allow_automatic:
            raise DeviceFault(
                f"{what} cannot be switched off",
                device=self.device,
                code="automatic",
                hint="a camera that sets its own exposure cannot measure; "
                "allow_auto_exposure = true takes it nevertheless",
            )
        _LOG.warning("%s: %s stays on: pictures are not comparable", self.device, what)
