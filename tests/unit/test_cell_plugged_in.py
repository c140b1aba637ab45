"""``mvp-cell devices``: ports and cameras, within a time."""

from __future__ import annotations

import json
import threading
from typing import TYPE_CHECKING

import pytest

from mvp.cell.plugged_in import port_entry, searched
from mvp.cli.main import invoke
from mvp.devices import CameraFound, PortFound
from mvp.errors import PluginError

if TYPE_CHECKING:
    from collections.abc import Iterator


def camera(address: str) -> CameraFound:
    return CameraFound("acme", address, "Acme 3000", "A1", "by hand")


@pytest.fixture
def hangs() -> Iterator[threading.Event]:
    """Set when the test has ended, so that no search outlives it."""
    event = threading.Event()
    yield event
    event.set()


def test_a_search_that_hangs_is_given_up_and_told(hangs: threading.Event) -> None:
    def hanging() -> tuple[CameraFound, ...]:
        hangs.wait(60)
        return ()

    searches = {"slow": hanging, "quick": lambda: (camera("2"), camera("1"))}
    found, notes = searched(searches, 0.3)
    assert [one.address for one in found] == ["1", "2"]
    (note,) = notes
    assert "slow" in note
    assert "given up" in note


def test_a_search_that_fails_hides_no_other_one() -> None:
    def failing() -> tuple[CameraFound, ...]:
        raise PluginError("no library")

    found, notes = searched({"bad": failing, "good": lambda: (camera("1"),)}, 20)
    assert [one.address for one in found] == ["1"]
    assert notes == ["the search of driver bad failed: no library"]


def test_a_port_is_named_by_its_identity_and_who_is_probably_behind_it() -> None:
    port = PortFound("/dev/ttyACM0", "usb-Acme-if00", "0483:5740:77", "Virtual port")
    entry = port_entry(port, {"scf4": {"0483:5740": "an SCF4"}, "ur": {}})
    assert entry.address == "/dev/serial/by-id/usb-Acme-if00"
    assert (entry.usb, entry.serial) == ("0483:5740:77", "77")
    assert entry.drivers == ["scf4"]
    assert "perhaps an SCF4" in entry.description


def test_a_port_without_identity_keeps_its_path() -> None:
    entry = port_entry(PortFound("/dev/ttyS0", "", "", "n/a"), {"a": {"": "x"}})
    assert entry.address == "/dev/ttyS0"
    assert entry.description == "n/a"
    assert entry.drivers == []


@pytest.mark.usefixtures("gv_camera")
def test_a_camera_on_the_network_is_found(capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert invoke(["devices", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["schema"] == "mvp-cell/devices/1"
    cameras = [one for one in document["devices"] if one["drivers"] == ["genicam"]]
    if not any("aravis" in one["through"] for one in cameras):
        pytest.skip("only Aravis searches the loopback interface")
    # Other tests may have cameras of their own at other loopback addresses.
    assert [one["address"] for one in cameras].count("127.0.0.1") == 1
