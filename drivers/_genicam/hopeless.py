"""What a row of lost pictures says about the way that they take."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivers._genicam.host import mtu_towards
from drivers._genicam.probe import is_ip_address
from mvp.errors import DeviceFault

if TYPE_CHECKING:
    from drivers._genicam.backend import Health

_EVERYWHERE = 1500  # bytes that every Ethernet carries in one packet
_SAFE = 1400
_SMALL = 256  # leader and trailer of a picture without pixels


class Tries:
    """The pictures that did not come out well, one after the other.

    Args:
        packet_size: asked of the camera; 0 where the library chose it.
        address: of the camera.
    """

    def __init__(self, packet_size: int, address: str) -> None:
        self.problems: list[str] = []
        self._packet_size = packet_size
        self._address = address
        self._starved = 0
        self._silent = 0

    @property
    def count(self) -> int:
        """How many there were."""
        return len(self.problems)

    def failed(self, problem: str, health: Health) -> None:
        """One more, and what the library had counted since the stream began."""
        self.problems.append(problem)
        arrived = health.arrived_bytes
        self._starved += arrived is not None and 0 < arrived <= _SMALL
        self._silent += problem == "no frame"

    def fault(self, device: str) -> DeviceFault:
        """Why there is no picture, as far as it can be told."""
        said = f"{self.count} frames in a row were no good: {', '.join(self.problems)}"
        if (
            self.count > 1 and self._starved >= self.count - 1
        ):  # the first may follow good ones
            said += (
                "; only the small packets around each picture arrived, none with pixels: "
                f"{self._packets} do not seem to fit through the network"
            )
            return DeviceFault(
                said, device=device, code="packet-size", hint=self._fit()
            )
        if self._silent == self.count and self._packet_size > _EVERYWHERE:
            said += f"; {self._packets} may not fit through the network"
            return DeviceFault(said, device=device, code="no frame", hint=self._fit())
        return DeviceFault(
            said,
            device=device,
            code=self.problems[-1],
            hint="check packet_size against the MTU, net.core.rmem_max, cable and "
            "switch, and that no other program triggers the camera",
        )

    @property
    def _packets(self) -> str:
        size = f" of {self._packet_size} bytes" if self._packet_size else ""
        return f"packets{size} with pixels"

    def _fit(self) -> str:
        first = mtu_towards(self._address) if is_ip_address(self._address) else None
        known = f" (here it is {first})" if first is not None else ""
        return (
            f"set packet_size = {_SAFE} in [camera], or raise the MTU of every interface "
            f"and switch on the way{known}; a large picture also needs net.core.rmem_max"
        )
