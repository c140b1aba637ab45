"""Stopping and closing several devices when some of them fail."""

from __future__ import annotations

from typing import cast

import pytest

from mvp.cell.engine import CellDevices
from mvp.cell.hardware import close_all, opened
from mvp.devices import Arm, Camera, DeviceInfo, Lens, RealClock
from mvp.errors import ConnectError, DeviceFault


class Stubborn:
    """A device that writes down what it is told and fails where asked to."""

    def __init__(self, name: str, *failing: str) -> None:
        self.name = name
        self.told: list[str] = []
        self._failing = failing

    def _told(self, word: str) -> None:
        self.told.append(word)
        if word in self._failing:
            raise DeviceFault(f"no {word}", device=self.name)

    def open(self) -> None:
        self._told("open")

    def close(self) -> None:
        self._told("close")

    def stop(self) -> None:
        self._told("stop")

    def info(self) -> DeviceInfo:
        return DeviceInfo(self.name, "stubborn", "1", "1", "1", simulated=True)


def cell_of(arm: Stubborn, lens: Stubborn, camera: Stubborn) -> CellDevices:
    return CellDevices(
        cast("Arm", arm), cast("Lens", lens), cast("Camera", camera), RealClock()
    )


def test_every_device_is_stopped_even_when_the_first_ones_fail() -> None:
    devices = Stubborn("arm", "stop"), Stubborn("lens", "stop"), Stubborn("camera")
    failures = cell_of(*devices).stop()
    assert [device.told for device in devices] == [["stop"]] * 3
    assert [str(failure) for failure in failures] == ["arm: no stop", "lens: no stop"]


def test_every_device_is_closed_and_failures_are_told_by_role() -> None:
    arm, lens = Stubborn("arm", "close"), Stubborn("lens")
    failures = close_all({"arm": cast("Arm", arm), "lens": cast("Lens", lens)})
    assert list(failures) == ["arm"]
    assert lens.told == ["close"]


def test_a_device_that_does_not_close_hides_no_earlier_failure() -> None:
    cell = cell_of(Stubborn("arm", "open", "close"), Stubborn("lens"), Stubborn("cam"))
    with pytest.raises(ConnectError, match="no open"), opened(cell):
        pytest.fail("it opened")


def test_a_device_that_does_not_close_is_told_after_all_went_well() -> None:
    cell = cell_of(Stubborn("arm", "close"), Stubborn("lens"), Stubborn("cam"))
    with pytest.raises(DeviceFault, match="no close"), opened(cell) as infos:
        assert set(infos) == {"arm", "lens", "camera"}
