"""What a search for cameras brings back."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class CameraFound:
    """One camera that answered, as ``mvp-cell devices`` shows it.

    Attributes:
        driver: key of the driver that reaches it.
        address: what to write into the driver's table.
        model: maker and model.
        serial: serial number; empty when it does not tell.
        through: how it was found.
    """

    driver: str
    address: str
    model: str
    serial: str
    through: str
