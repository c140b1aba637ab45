"""A port named by what is plugged in, not by the number that it got this time."""

from __future__ import annotations

import os
import pty
import tty
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING

import pytest

from mvp.devices import SerialTransport, link_resource, list_ports
from mvp.errors import ConnectError, LinkLost
from tests.wire.lens_makes import SCF4

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

CH340 = (0x1A86, 0x7523)
STM32 = (0x0483, 0x5740)


class Sockets:
    """The USB sockets of a computer, with serial adapters that are plugged in and out."""

    def __init__(self, by_id: Path) -> None:
        self._by_id = by_id
        self._plugged: list[SimpleNamespace] = []
        self._masters: dict[str, int] = {}

    def plug(
        self,
        usb: tuple[int, int],
        serial: str | None = None,
        *,
        link: str = "",
        path: str = "",
    ) -> str:
        """An adapter gets the next device node, or a given one; its path."""
        if not path:
            master, slave = pty.openpty()
            tty.setraw(slave)
            path = os.ttyname(slave)
            os.close(slave)
            self._masters[path] = master
        if link:
            (self._by_id / link).unlink(missing_ok=True)
            (self._by_id / link).symlink_to(path)
        self._plugged.append(
            SimpleNamespace(
                device=path,
                vid=usb[0],
                pid=usb[1],
                serial_number=serial,
                description="USB Serial",
            )
        )
        return path

    def unplug(self, path: str) -> None:
        """Its node stays with whoever holds it, and leads nowhere."""
        self._plugged = [one for one in self._plugged if one.device != path]
        os.close(self._masters.pop(path))

    def heard(self, path: str) -> bytes:
        """What a program has written to an adapter."""
        return os.read(self._masters[path], 100)

    def comports(self) -> list[SimpleNamespace]:
        return self._plugged

    def close(self) -> None:
        for path in list(self._masters):
            self.unplug(path)


@pytest.fixture
def usb(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Sockets]:
    sockets = Sockets(tmp_path)
    monkeypatch.setattr("mvp.devices.ports._BY_ID", tmp_path)
    monkeypatch.setattr("serial.tools.list_ports.comports", sockets.comports)
    yield sockets
    sockets.close()


def leads_to(sockets: Sockets, address: str, path: str) -> bool:
    """Whether bytes for an address arrive at an adapter."""
    with_name = SerialTransport("lens", address)
    with_name.open()
    with_name.write(b"?")
    with_name.close()
    return sockets.heard(path) == b"?"


NAME = "usb-1a86_USB_Serial-if00-port0"


def test_each_name_of_an_adapter_leads_to_it(usb: Sockets, tmp_path: Path) -> None:
    usb.plug(STM32, "5DD", link="usb-Kurokesu_SCF4-if00")
    path = usb.plug(CH340, "A7", link=NAME)
    names = [path, NAME, str(tmp_path / NAME), "1a86:7523", "1A86:7523:A7"]
    for address in names:
        assert leads_to(usb, address, path), address
    resources = {link_resource(address, device="arm") for address in names}
    assert len(resources) == 1  # two devices on it would be found out by any of them
    (found,) = [port for port in list_ports() if port.path == path]
    assert (found.by_id, found.usb) == (NAME, "1a86:7523:A7")


def test_the_serial_number_tells_two_adapters_apart(usb: Sockets) -> None:
    first, second = usb.plug(CH340, "A7"), usb.plug(CH340, "B8")
    assert leads_to(usb, "1a86:7523:A7", first)
    assert leads_to(usb, "1a86:7523:B8", second)
    with pytest.raises(ConnectError, match="2 USB devices are 1a86:7523") as caught:
        SerialTransport("lens", "1a86:7523").open()
    for name in (first, second, "1a86:7523:A7", "1a86:7523:B8", "serial number"):
        assert name in caught.value.hint
    with pytest.raises(ConnectError, match="1a86:7523:C9"):
        SerialTransport("lens", "1a86:7523:C9").open()


@pytest.mark.parametrize("serial", [None, "0001"])
def test_two_adapters_that_nothing_tells_apart_are_refused(
    usb: Sockets, serial: str | None
) -> None:
    first, second = usb.plug(CH340, serial), usb.plug(CH340, serial)
    address = "1a86:7523" if serial is None else f"1a86:7523:{serial}"
    with pytest.raises(ConnectError, match="2 USB devices") as caught:
        SerialTransport("lens", address).open()
    assert first in caught.value.hint
    assert second in caught.value.hint
    assert "by-path" in caught.value.hint
    assert "add the serial number" not in caught.value.hint


@pytest.mark.parametrize("address", ["1a86:7523", "1a86:7523:A7", NAME])
def test_an_adapter_that_got_another_number_is_found_again(
    usb: Sockets, address: str
) -> None:
    before = usb.plug(CH340, "A7", link=NAME)
    line = SerialTransport("lens", address)
    line.open()
    usb.unplug(before)
    with pytest.raises(LinkLost):
        line.read(timeout_s=5)
    after = usb.plug(CH340, "A7", link=NAME)
    assert after != before  # the old node is still held
    line.close()
    line.open()
    line.write(b"!")
    assert usb.heard(after) == b"!"
    line.close()


def test_a_number_that_now_belongs_to_another_adapter_is_not_followed(
    usb: Sockets,
) -> None:
    before = usb.plug(CH340, "A7")
    line = SerialTransport("lens", "1a86:7523:A7")
    line.open()
    line.close()
    usb.unplug(before)
    usb.plug(CH340, "B8")
    with pytest.raises(ConnectError, match="no USB device 1a86:7523:A7") as caught:
        line.open()
    assert "1a86:7523:B8" in caught.value.hint


def test_a_driver_is_led_by_the_name_of_its_adapter(
    usb: Sockets, lens_bench: Callable[..., object]
) -> None:
    bench = lens_bench(SCF4)
    usb.plug(CH340)
    usb.plug(STM32, "5DD", path=str(Path(bench.keys["port"]).resolve()))
    lens = bench.lens(port="0483:5740")
    assert lens.info().model == "Kurokesu SCF4-M RevB"
    assert lens.resource() == link_resource(bench.keys["port"], device="lens")
