"""One camera under our control: settings that are proved, frames without holes."""

from __future__ import annotations

import logging
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from drivers._genicam.backend import BackendLost, BackendRefused, StreamSettings
from drivers._genicam.features import (
    AUTOMATIC,
    EXPOSURE,
    GAIN,
    Alias,
    apply,
    check_range,
    gain_as_camera,
    gain_of_camera,
    resolve,
)
from drivers._genicam.probe import answers, is_ip_address
from mvp.errors import ConnectError, DeviceFault, LimitError, LinkLost

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from drivers._genicam.backend import Backend, Delivery, Identity, Value

_LOG = logging.getLogger(__name__)
_US = 1e6
_EXPOSURE_SLACK_US = 1.0
_GAIN_SLACK_DB = 0.1


@dataclass(frozen=True)
class SessionSettings:
    """What is set at every connection, in this order.

    Attributes:
        address: IP address, serial number or user-defined name.
        serial: the only camera that is accepted; any when empty.
        features: by name; set after the trigger and before the exposure.
        gain_db_per_raw: of cameras with a raw gain; None when nobody knows.
        gain_floor: raw value or dB that means a gain of 1.
    """

    address: str
    serial: str
    features: Mapping[str, Value]
    stream: StreamSettings
    gain_db_per_raw: float | None
    gain_floor: float


@dataclass
class _Applied:
    """Settings to apply again after a loss, and what they read back as."""

    exposure_s: float | None = None
    gain: float = 1.0
    read_exposure_s: float = 0.0
    read_gain: float = 1.0


@dataclass
class Session:
    """Connection, settings and stream of one camera through one backend.

    After a loss, ``connect`` builds everything anew: it refuses another camera and
    proves every setting again.
    """

    backend: Backend
    settings: SessionSettings
    device: str
    identity: Identity | None = None
    connected: bool = False
    _serial: str = ""
    _applied: _Applied = field(default_factory=_Applied)

    def connect(self) -> None:
        """Take control, check who it is, apply every setting, start the stream.

        Raises:
            ConnectError: nobody answers, or it is another camera.
            DeviceFault: a setting did not take.
        """
        self.connected = False
        with self._translated(ConnectError):
            # Before the old connection is ended: saying goodbye to nobody takes 10 s.
            self._check_somebody_there()
        self.close()
        try:
            with self._translated(ConnectError):
                self.identity = self.backend.open(self.settings.address)
                self._check_serial(self.identity)
                self._prepare()
                self.backend.arm(self.settings.stream)
        except BaseException:
            self.close()
            raise
        self._serial = self.identity.serial
        self.connected = True

    def close(self) -> None:
        """Stop the stream and give the camera back; safe to repeat."""
        self.connected = False
        with self._translated(LinkLost):
            self.backend.close()

    def rearm(self) -> None:
        """Begin a new stream: nothing exposed for the old one can come out of it."""
        with self._translated(LinkLost):
            self.backend.disarm()
            self.backend.arm(self.settings.stream)

    def exposure_range_s(self) -> tuple[float, float]:
        """Shortest and longest exposure."""
        with self._translated(LinkLost):
            alias = self._known(EXPOSURE, "exposure")
            low, high = self.backend.bounds(alias.feature, alias.kind)
        return low / _US, high / _US

    def configure(self, exposure_s: float, gain: float) -> None:
        """Set, read back and compare.

        Raises:
            LimitError: outside the camera's range; nothing was set.
            DeviceFault: another value was read back.
        """
        with self._translated(LinkLost):
            alias, asked = self._asked_exposure(exposure_s)
            check_range(self.backend, alias.feature, asked, alias.kind, self.device)
            read_gain = self._apply_gain(gain)
            read_exposure_s = self._apply_exposure(exposure_s)
        self._applied = _Applied(exposure_s, gain, read_exposure_s, read_gain)

    @property
    def exposure_s(self) -> float:
        """As the camera reads it back."""
        return self._applied.read_exposure_s

    @property
    def gain(self) -> float:
        """As the camera reads it back, as a factor."""
        return self._applied.read_gain

    def drain(self) -> int:
        """Throw waiting pictures away; how many there were."""
        with self._translated(LinkLost):
            return self.backend.drain()

    def trigger(self) -> None:
        """Ask for one picture."""
        with self._translated(LinkLost):
            self.backend.trigger()

    def wait(self, timeout_s: float) -> Delivery | None:
        """The next picture, whole or not; None when none came in time.

        Raises:
            LinkLost: the camera is gone.
        """
        with self._translated(LinkLost):
            return self.backend.wait(timeout_s)

    def payload_bytes(self) -> int:
        """Bytes of one picture."""
        with self._translated(LinkLost):
            width = self.backend.get("Width", "integer")
            height = self.backend.get("Height", "integer")
            wide = str(self.backend.get("PixelFormat", "enum")) != "Mono8"
        return int(width) * int(height) * (2 if wide else 1)

    def _check_somebody_there(self) -> None:
        """Spare the libraries' own time-outs, 5 s and 15 s, where nobody answers."""
        address = self.settings.address
        if is_ip_address(address) and not answers(address):
            raise BackendLost("no camera answers")

    def _check_serial(self, identity: Identity) -> None:
        """Refuse another camera than the one asked for, or than the one lost."""
        wanted = self.settings.serial or self._serial
        if wanted and identity.serial != wanted:
            raise ConnectError(
                f"camera {identity.serial!r} answers at {self.settings.address}, "
                f"not {wanted!r}",
                device=self.device,
                hint="a calibration belongs to one camera: connect that one, or "
                "calibrate and name the new one",
            )

    def _prepare(self) -> None:
        """Everything that a stream of triggered pictures depends on."""
        for feature in AUTOMATIC:
            if self.backend.has(feature):
                self._switch_off(feature)
        fixed = {"AcquisitionMode": "Continuous", **self.settings.features}
        trigger = {"TriggerMode": "On", "TriggerSource": "Software"}
        if self.backend.has("TriggerSelector"):
            trigger = {"TriggerSelector": "FrameStart", **trigger}
        for feature, value in {**fixed, **trigger}.items():
            self._apply(feature, value)
        before = self._applied
        if before.exposure_s is not None:
            self.configure(before.exposure_s, before.gain)
        else:
            self._read_exposure()

    def _switch_off(self, feature: str) -> None:
        try:
            self._apply(feature, "Off")
        except (LimitError, BackendRefused) as error:
            raise DeviceFault(
                f"{feature} cannot be switched off",
                device=self.device,
                code=feature,
                hint="a camera that sets its own exposure cannot measure",
            ) from error

    def _apply(self, feature: str, value: Value, slack: float = 0.0) -> Value:
        return apply(self.backend, feature, value, device=self.device, slack=slack)

    def _known(self, names: tuple[Alias, ...], what: str) -> Alias:
        alias = resolve(self.backend, names)
        if alias is None:
            raise DeviceFault(
                f"the camera has no {what} setting that is known",
                device=self.device,
                code=what,
                hint="known are: " + ", ".join(alias.feature for alias in names),
            )
        return alias

    def _read_exposure(self) -> None:
        alias = self._known(EXPOSURE, "exposure")
        read = self.backend.get(alias.feature, alias.kind)
        self._applied.read_exposure_s = float(read) / _US

    def _asked_exposure(self, exposure_s: float) -> tuple[Alias, Value]:
        """What the camera calls it, and the value in its unit."""
        alias = self._known(EXPOSURE, "exposure")
        value = exposure_s * _US
        return alias, round(value) if alias.kind == "integer" else value

    def _apply_exposure(self, exposure_s: float) -> float:
        alias, asked = self._asked_exposure(exposure_s)
        return float(self._apply(alias.feature, asked, _EXPOSURE_SLACK_US)) / _US

    def _apply_gain(self, gain: float) -> float:
        if not gain > 0:
            raise LimitError(f"gain {gain} is not positive", device=self.device)
        alias = resolve(self.backend, GAIN)
        if alias is None and gain == 1.0:
            return 1.0
        alias = self._known(GAIN, "gain")
        db_per_raw = self._db_per_raw(alias, gain)
        floor = self.settings.gain_floor
        asked = gain_as_camera(gain, alias, db_per_raw, floor)
        read = self._apply(alias.feature, asked, _GAIN_SLACK_DB)
        return gain_of_camera(read, alias, db_per_raw, floor)

    def _db_per_raw(self, alias: Alias, gain: float) -> float:
        per_raw = self.settings.gain_db_per_raw
        if alias.unit == "raw" and per_raw is None and gain != 1.0:
            raise LimitError(
                f"gain {gain:.3g} cannot be set: the camera only has {alias.feature}, "
                "in units of its maker",
                device=self.device,
                hint="set gain_db_per_raw in the camera's table, from its manual",
            )
        return per_raw if per_raw is not None else 1.0

    @contextmanager
    def _translated(self, lost: type[ConnectError] | type[LinkLost]) -> Iterator[None]:
        """The backend's errors as the project's."""
        try:
            yield
        except BackendLost as error:
            self.connected = False
            raise lost(
                f"{self.settings.address}: {error}",
                device=self.device,
                hint="check power, cable and network of the camera, and that no other "
                "program controls it",
            ) from error
        except BackendRefused as error:
            raise DeviceFault(
                f"the camera refuses: {error}", device=self.device, code="refused"
            ) from error
