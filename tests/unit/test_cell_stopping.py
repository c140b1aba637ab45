"""Telling several devices to stop, when one of them hangs."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, cast

from mvp.cell.stopping import stop_all
from mvp.errors import DeviceFault, DeviceTimeout

if TYPE_CHECKING:
    import pytest

    from mvp.devices import Device


class Told:
    """A device that writes down that it was told to stop, and may hang or fail."""

    def __init__(
        self,
        name: str,
        *,
        hangs_until: threading.Event | None = None,
        fails: bool = False,
    ) -> None:
        self.name = name
        self.told = threading.Event()
        self._hangs_until, self._fails = hangs_until, fails

    def stop(self) -> None:
        self.told.set()
        if self._hangs_until is not None:
            self._hangs_until.wait(30)
        if self._fails:
            raise DeviceFault("cannot", device=self.name)


def stopped(*devices: Told, within_s: float) -> list[Exception]:
    return stop_all([cast("Device", one) for one in devices], within_s=within_s)


def test_a_first_device_that_hangs_delays_no_other() -> None:
    over = threading.Event()
    arm = Told("arm", hangs_until=over)
    lens, camera = Told("lens", fails=True), Told("camera")
    hung, failed = stopped(arm, lens, camera, within_s=0.2)
    over.set()
    assert all(one.told.is_set() for one in (arm, lens, camera))
    assert isinstance(hung, DeviceTimeout)
    assert hung.device == "arm"
    assert "emergency stop" in hung.hint
    assert isinstance(failed, DeviceFault)


def test_they_are_told_at_the_same_time() -> None:
    """Each comes back only when all the others have been told."""
    meeting = threading.Barrier(3)

    class Meets(Told):
        def stop(self) -> None:
            meeting.wait(20)
            super().stop()

    assert stopped(Meets("arm"), Meets("lens"), Meets("camera"), within_s=20) == []


def test_all_are_told_where_no_thread_can_be_started(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def full(thread: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", full)
    devices = Told("arm", fails=True), Told("lens"), Told("camera")
    (failure,) = stopped(*devices, within_s=5)
    assert isinstance(failure, DeviceFault)
    assert all(one.told.is_set() for one in devices)
