"""Stop several devices at once: one that hangs keeps no other one from being told."""

from __future__ import annotations

import logging
import threading
import time
from typing import TYPE_CHECKING

from mvp.errors import DeviceTimeout

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.devices import Device

_LOG = logging.getLogger(__name__)


def stop_all(devices: Sequence[Device], *, within_s: float) -> list[Exception]:
    """Tell every device to stop, each from a thread of its own.

    Args:
        devices: open or not.
        within_s: how long to wait for all of them together, by the clock on the wall.

    Returns:
        What failed, in the order of the devices; a device that has not come back is a
        ``DeviceTimeout`` and may still carry out its stop later.
    """
    until_s = time.monotonic() + within_s
    begun = [_Stop(device) for device in devices]
    for one in begun:
        one.begin()
    failures = [one.failure(until_s) for one in begun]
    for failure in failures:
        if failure is not None:
            _LOG.error("stop failed: %s", failure)
    return [failure for failure in failures if failure is not None]


class _Stop:
    """One device being told to stop."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self._done = threading.Event()
        self._error: Exception | None = None

    def begin(self) -> None:
        """From a thread of its own; from this one where there can be no more."""
        try:
            name = f"stop {self._device.name}"
            threading.Thread(target=self._run, name=name, daemon=True).start()
        except RuntimeError:
            self._run()

    def failure(self, until_s: float) -> Exception | None:
        """What became of it by then."""
        if self._done.wait(max(0.0, until_s - time.monotonic())):
            return self._error
        return DeviceTimeout(
            "has not come back from being told to stop",
            device=self._device.name,
            hint="use the emergency stop if it still moves",
        )

    def _run(self) -> None:
        try:
            self._device.stop()
        except Exception as error:
            self._error = error
        finally:
            self._done.set()
