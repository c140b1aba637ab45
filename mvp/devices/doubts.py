"""What an open device says against itself: how it is set, and what it cannot do."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, runtime_checkable

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.devices.findings import Finding
    from mvp.devices.protocols import DeviceInfo


@runtime_checkable
class HasDoubts(Protocol):
    """A device that was looked at while it was opened."""

    def doubts(self) -> Sequence[Finding]:
        """What somebody should look at before it moves; asks the device nothing."""
        ...


def cannot_stop(info: DeviceInfo) -> str:
    """Why ``stop`` does not act at once; empty where it does, or nothing is said."""
    said = info.extra.get("can_stop", "")
    return said.removeprefix("no").lstrip(":, ") if said.startswith("no") else ""
