"""The questions of ``check`` one by one, and what is looked up on this computer."""

from __future__ import annotations

import os
import threading
from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import numpy as np
import pytest

from drivers._genicam import buffer_finding, packet_findings
from drivers.camera_genicam import GenicamCamera
from mvp.cell.check_devices import check_devices
from mvp.cell.engine import CellDevices
from mvp.cell.loading import load_cell
from mvp.devices import (
    Arm,
    ArmState,
    Camera,
    DeviceInfo,
    Lens,
    RealClock,
    TransportConfig,
    host_findings,
    port_findings,
)

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from mvp.cell.plan_job import Setting


class Meeting:
    """A device that answers only when the other two are asked at the same time."""

    def __init__(self, name: str, opening: threading.Barrier, asked: threading.Barrier):
        self.name = name
        self._opening, self._asked = opening, asked
        self.closed = False

    def open(self) -> None:
        self._opening.wait(timeout=20)

    def info(self) -> DeviceInfo:
        return DeviceInfo(self.name, "meeting", "1", "", "1", simulated=True)

    def state(self) -> object:
        self._asked.wait(timeout=20)
        raise RuntimeError("met")

    def exposure_range_s(self) -> tuple[float, float]:
        self._asked.wait(timeout=20)
        raise RuntimeError("met")

    def close(self) -> None:
        self.closed = True


def setting() -> Setting:
    """As much of a setting as the questions see before a device has answered."""
    return cast("Setting", SimpleNamespace(cell=load_cell("virtual")))


def test_all_devices_are_opened_and_asked_at_the_same_time() -> None:
    opening, asked = threading.Barrier(3), threading.Barrier(3)
    arm, lens, camera = (Meeting(n, opening, asked) for n in ("arm", "lens", "camera"))
    devices = CellDevices(
        cast("Arm", arm), cast("Lens", lens), cast("Camera", camera), RealClock()
    )
    items, found = check_devices(setting(), devices)
    failed = {item.name: item.detail for item in items if not item.passed}
    assert failed == {
        f"{r} state": "RuntimeError: met" for r in ("arm", "lens", "camera")
    }
    assert [one.role for one in found] == ["arm", "lens", "camera"]
    assert arm.closed
    assert lens.closed
    assert camera.closed


def test_an_arm_that_cannot_move_as_it_is_has_failed_and_all_else_is_told() -> None:
    class Locked(Meeting):
        """A gantry in alarm that answers."""

        role = "arm"
        homed = False

        def home(self, *, timeout_s: float) -> None:
            pytest.fail("a check moves nothing")

        def state(self) -> ArmState:
            pose = np.eye(4)
            return ArmState((0.0,), pose, True, 0.0, "the controller is locked (Alarm)")

    opening, asked = threading.Barrier(3), threading.Barrier(2)
    arm, lens, camera = (
        kind(name, opening, asked)
        for kind, name in ((Locked, "arm"), (Meeting, "lens"), (Meeting, "camera"))
    )
    devices = CellDevices(
        cast("Arm", arm), cast("Lens", lens), cast("Camera", camera), RealClock()
    )
    items, found = check_devices(setting(), devices)
    failed = {item.name: item for item in items if not item.passed}
    assert list(failed) == ["arm state", "lens state", "camera state"]
    assert (
        "cannot move as it is: the controller is locked" in failed["arm state"].detail
    )
    assert "`mvp-cell recover CELL`" in failed["arm state"].hint
    assert "`mvp-cell home CELL`" in failed["arm state"].hint
    assert found[0].homed is False


@pytest.fixture
def pseudo_terminal() -> Iterator[str]:
    """A port that this user may use."""
    ours, theirs = os.openpty()
    path = os.ttyname(theirs)
    os.close(theirs)
    yield path
    os.close(ours)


def test_a_port_that_may_be_used_is_told(pseudo_terminal: str) -> None:
    (finding,) = port_findings(TransportConfig(port=pseudo_terminal))
    assert (finding.level, finding.name) == ("ok", "port")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may use every port")
def test_a_port_without_rights_names_the_group(tmp_path: Path) -> None:
    port = tmp_path / "ttyX"
    port.write_bytes(b"")
    port.chmod(0)
    (finding,) = port_findings(TransportConfig(port=str(port)))
    assert finding.level == "failed"
    assert port.group() in finding.hint


def test_sockets_and_missing_ports_are_left_to_opening() -> None:
    assert port_findings(TransportConfig(port="socket://127.0.0.1:1")) == ()
    assert port_findings(TransportConfig(port="/dev/ttyNotHere")) == ()


def test_a_buffer_that_holds_no_two_pictures_is_a_warning() -> None:
    assert buffer_finding(1000).level == "ok"
    finding = buffer_finding(1 << 40)
    assert finding.level == "warning"
    assert "sysctl" in finding.hint


def test_packets_above_the_mtu_are_a_warning() -> None:
    assert [f.level for f in packet_findings("127.0.0.1", 8192)] == ["ok"]
    (finding,) = packet_findings("127.0.0.1", 65_537)
    assert finding.level == "warning"
    assert "MTU" in finding.detail


def test_a_camera_called_by_serial_number_has_no_route_to_look_up() -> None:
    assert list(packet_findings("SIM-GIGE-1", 8192)) == []


def test_the_genicam_driver_tells_what_it_needs_of_the_computer() -> None:
    config = GenicamCamera.Config(address="127.0.0.1", width_px=640, height_px=512)
    found = host_findings(GenicamCamera, config)  # type: ignore[arg-type]
    assert [finding.name for finding in found] == ["library", "buffer", "packets"]
