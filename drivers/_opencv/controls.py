"""Setting exposure and gain: not at all, through V4L2, or over HTTP."""

from __future__ import annotations

import json
import logging
from dataclasses import dataclass
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
            read_s = float(str(said["exposure_us"])) / _US
            read_gain = float(str(said["gain"]))
        except (KeyError, TypeError, ValueError) as error:
            raise WireError(
                f"{url} answered without exposure_us and gain", device=self.device
            ) from error
        self._compare("exposure", exposure_s, read_s)
        self._compare("gain", gain, read_gain)
        return read_s, read_gain

    def _ask(self, url: str) -> dict[str, object]:
        # Never through a proxy: the camera is on the cell's own network.
        opener = build_opener(ProxyHandler({}))
        try:
            with opener.open(url, timeout=self.timeout_s) as answer:
                return dict(json.loads(answer.read(_ANSWER_MAX)))
        except (URLError, OSError) as error:
            raise LinkLost(
                f"{url}: {error}",
                device=self.device,
                hint="check control_url and the network",
            ) from error
        except (TypeError, ValueError) as error:
            raise WireError(f"{url} answered no JSON", device=self.device) from error

    def _compare(self, what: str, asked: float, read: float) -> None:
        if abs(read - asked) > _SAME * abs(asked):
            raise DeviceFault(
                f"{what} reads back as {read:g} instead of {asked:g}",
                device=self.device,
                code="read-back",
                hint="another program may be using the camera",
            )


@dataclass(frozen=True)
class V4l2Exposure:
    """A USB camera's controls; automatic exposure is switched off first."""

    capture: cv2.VideoCapture
    range_s: tuple[float, float]
    allow_automatic: bool
    device: str

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

    def apply(self, exposure_s: float, gain: float) -> tuple[float, float]:
        """Set in steps of 100 us and read back; gain only where it is 1."""
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
