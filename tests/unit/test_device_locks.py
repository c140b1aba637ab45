"""One process at a time on one robot or port, whatever cell file names it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING, cast

import pytest

from drivers.arm_gantry import GantryArm
from drivers.arm_ur import UrArm
from drivers.lens_scf4 import Scf4Lens
from mvp.cell.device_locks import devices_held
from mvp.cell.engine import CellDevices
from mvp.cell.hardware import opened
from mvp.devices import (
    Arm,
    Camera,
    DeviceContext,
    Exclusive,
    Lens,
    RealClock,
    host_resource,
    link_resource,
)
from mvp.errors import ConnectError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from mvp.devices import Device

HOLD = """
import sys
from pathlib import Path
from types import SimpleNamespace
from mvp.cell.device_locks import devices_held
robot = SimpleNamespace(resource=lambda: sys.argv[1])
with devices_held({"arm": robot}, folder=Path(sys.argv[2])):
    print("held", flush=True)
    sys.stdin.read()
"""


class Robot:
    """A device that is driven by one process at a time."""

    def __init__(self, name: str) -> None:
        self._name = name

    def resource(self) -> str:
        return self._name


def robots(*names: str) -> dict[str, Device]:
    roles = ("arm", "lens", "camera")
    return {
        role: cast("Device", Robot(n)) for role, n in zip(roles, names, strict=False)
    }


@contextmanager
def other_process(name: str, folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Another process that holds a device until this context ends."""
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, name, str(folder)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"held\n"
        yield process
        process.kill()


def test_another_process_on_the_same_robot_is_named(tmp_path: Path) -> None:
    with other_process("ur:192.0.2.7", tmp_path) as other:
        with (
            pytest.raises(
                ConnectError, match=r"ur:192\.0\.2\.7 is driven by"
            ) as refused,
            devices_held(robots("ur:192.0.2.7"), folder=tmp_path),
        ):
            pass
        assert f"process {other.pid}" in refused.value.message
        assert refused.value.device == "arm"
        with devices_held(robots("ur:192.0.2.8"), folder=tmp_path):
            pass  # another robot is free


def test_a_process_that_was_killed_leaves_nothing_locked(tmp_path: Path) -> None:
    with other_process("serial:/dev/ttyUSB0", tmp_path) as other:
        other.send_signal(signal.SIGKILL)
        other.wait()
        with devices_held(robots("serial:/dev/ttyUSB0"), folder=tmp_path):
            (lock,) = tmp_path.iterdir()
            assert str(os.getpid()) in lock.read_text()


def test_it_is_free_again_afterwards(tmp_path: Path) -> None:
    for _ in range(2):
        with devices_held(robots("ur:192.0.2.7"), folder=tmp_path):
            pass
    assert all(not path.read_bytes() for path in tmp_path.iterdir())


def test_two_devices_of_one_cell_on_one_port(tmp_path: Path) -> None:
    both = robots("serial:/dev/ttyUSB0", "serial:/dev/ttyUSB0")
    with pytest.raises(ConnectError, match="is the arm already"):
        devices_held(both, folder=tmp_path).__enter__()


def test_devices_without_anything_of_their_own_share_all(tmp_path: Path) -> None:
    with devices_held(robots("", ""), folder=tmp_path):
        assert not list(tmp_path.iterdir())


def test_a_link_laid_by_somebody_is_not_followed(tmp_path: Path) -> None:
    with devices_held(robots("ur:192.0.2.7"), folder=tmp_path):
        (lock,) = tmp_path.iterdir()
    precious = tmp_path / "precious"
    precious.write_text("kept")
    lock.unlink()
    lock.symlink_to(precious)
    with (
        pytest.raises(ConnectError, match="cannot be seen"),
        devices_held(robots("ur:192.0.2.7"), folder=tmp_path),
    ):
        pass
    assert precious.read_text() == "kept"


def test_other_users_can_take_the_lock(tmp_path: Path) -> None:
    before = os.umask(0o077)
    try:
        with devices_held(robots("ur:192.0.2.7"), folder=tmp_path):
            (lock,) = tmp_path.iterdir()
            assert lock.stat().st_mode & 0o777 == 0o666
    finally:
        os.umask(before)


def test_devices_are_held_while_they_are_open(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mvp.cell.device_locks._shared_folder", lambda: tmp_path)
    arm = Silent("ur:192.0.2.7")
    cell = CellDevices(
        cast("Arm", arm),
        cast("Lens", Silent("")),
        cast("Camera", Silent("")),
        RealClock(),
    )
    with other_process("ur:192.0.2.7", tmp_path):
        with pytest.raises(ConnectError, match="is driven by"), opened(cell):
            pass
        assert arm.told == []


class Silent(Robot):
    """Writes down what it was told."""

    name = "arm"

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.told: list[str] = []

    def open(self) -> None:
        self.told.append("open")

    def close(self) -> None:
        self.told.append("close")


def test_one_port_has_one_name(tmp_path: Path) -> None:
    node = tmp_path / "ttyUSB7"
    node.touch()
    link = tmp_path / "by-id"
    link.symlink_to(node)
    names = {link_resource(str(path), device="lens") for path in (node, link)}
    assert names == {f"serial:{node}"}
    assert link_resource(str(tmp_path / "gone"), device="lens") == ""


def test_one_host_has_one_name() -> None:
    assert host_resource("ur", "localhost") == host_resource("ur", "127.0.0.1")
    assert link_resource("socket://localhost:23", device="arm") == "tcp:127.0.0.1:23"
    assert host_resource("ur", "No.Such.Host.invalid") == "ur:no.such.host.invalid"


def test_drivers_say_what_they_drive(tmp_path: Path) -> None:
    node = tmp_path / "tty"
    node.touch()
    ur = UrArm.from_config(
        UrArm.Config(host="192.0.2.7", payload_kg=1), DeviceContext(), name="arm"
    )
    axes = [
        {
            "letter": x,
            "low": -1,
            "high": 1,
            "speed": 1,
            "acceleration": 1,
            "home": "declared",
        }
        for x in "XYZAB"
    ]
    config = GantryArm.Config.model_validate(
        {"port": str(node), "firmware": "grblhal", "axes": axes}
    )
    gantry = GantryArm.from_config(config, DeviceContext(), name="arm")
    lens = Scf4Lens.from_config(
        Scf4Lens.Config.model_validate({"port": str(node)}),
        DeviceContext(),
        name="lens",
    )
    for device, name in (
        (ur, "ur:192.0.2.7"),
        (gantry, f"serial:{node}"),
        (lens, f"serial:{node}"),
    ):
        assert isinstance(device, Exclusive)
        assert device.resource() == name
