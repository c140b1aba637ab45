"""What every driver promises, as test classes to inherit from.

::

    class TestMyArm(ArmConformance):
        def device(self):
            return MyArm.from_config(MyArm.Config(), DeviceContext(), name="arm")

        def targets(self):
            return [0, -1.5, 1.5, -1.5, -1.5, 0], [0.3, -1.4, 1.5, -1.5, -1.5, 0]

Run them with pytest against a simulator first, and against hardware with the safety
functions tested and a person beside it. Each test builds, opens and closes a device.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from mvp.testing.require import require

if TYPE_CHECKING:
    from mvp.devices import Device, Role

TIMEOUT_S = 120.0


class DeviceConformance:
    """What all devices have in common."""

    role: ClassVar[Role]

    def device(self) -> Device:
        """A new device, not yet opened. To be given by the driver's author."""
        raise TypeError("a conformance suite needs device()")

    def test_it_says_which_role_it_plays(self) -> None:
        """Role and name."""
        device = self.device()
        require(device.role == self.role, f"role is {device.role}, not {self.role}")
        require(device.name, "the device has no name")

    def test_opening_and_closing_can_be_repeated(self) -> None:
        """``open`` and ``close`` are idempotent, in any order."""
        device = self.device()
        device.close()
        device.open()
        device.open()
        device.close()
        device.close()
        device.open()
        device.close()

    def test_it_can_be_used_with_a_with_statement(self) -> None:
        """``with`` opens and hands out the device itself."""
        device = self.device()
        with device as inside:
            require(inside is device, "with gave another object")
            require(device.info().driver, "no driver in info()")

    def test_info_names_the_device(self) -> None:
        """Identity is complete enough for a record."""
        with self.device() as device:
            info = device.info()
        require(info.name == device.name, "info().name is another name")
        require(info.model and info.serial, "info() needs model and serial")

    def test_stop_is_harmless_at_any_time(self) -> None:
        """Stopping what stands, twice, is no error."""
        with self.device() as device:
            device.stop()
            device.stop()
