"""The UR driver against the simulated controller, through the real client library."""

from collections.abc import Iterator

import pytest

from drivers.arm_ur import UrArm
from drivers.simulators.ur import UrSimulator, UrSimulatorConfig
from mvp.devices import DeviceContext
from mvp.testing import ArmConformance


@pytest.fixture(scope="class")
def host() -> Iterator[str]:
    with UrSimulator(UrSimulatorConfig(speed_scale=4), "ur") as simulator:
        yield simulator.host


class TestUrArm(ArmConformance):
    @pytest.fixture(autouse=True)
    def _at(self, host: str) -> None:
        self.host = host

    def device(self) -> UrArm:
        config = UrArm.Config(
            host=self.host,
            payload_kg=1.2,
            payload_cog_mm=[0, 0, 40],
            tcp_mm=[0, 10, 120],
            tcp_rotation_deg=[0, 0, 45],
            joint_speed_deg_s=180,
            joint_acceleration_deg_s2=400,
            data_timeout_s=2.0,
        )
        return UrArm.from_config(config, DeviceContext(), name="arm")

    def targets(self) -> tuple[list[float], list[float]]:
        return [0, -1.5, 1.5, -1.5, -1.5, 0], [0.6, -1.4, 1.5, -1.5, -1.5, 0.2]
