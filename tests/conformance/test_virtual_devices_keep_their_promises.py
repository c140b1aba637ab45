import math

import pytest

from drivers.virtual_settings import Faults
from drivers.virtual_world import VirtualWorld
from mvp.devices import Arm, Camera, Lens
from mvp.testing import (
    ArmConformance,
    CameraConformance,
    LensConformance,
    VirtualCell,
    example_belief,
    virtual_cell,
)

HOME = [0.0, -math.pi / 2, math.pi / 2, -math.pi / 2, -math.pi / 2, 0.0]


@pytest.fixture(autouse=True)
def cell(request: pytest.FixtureRequest) -> VirtualCell:
    request.instance.cell = virtual_cell()
    return request.instance.cell


class TestVirtualArm(ArmConformance):
    cell: VirtualCell

    def device(self) -> Arm:
        return self.cell.arm

    def targets(self) -> tuple[list[float], list[float]]:
        return HOME, [0.4, -1.4, 1.3, -1.5, -1.6, 0.5]


class TestVirtualGantry(ArmConformance):
    def device(self) -> Arm:
        return virtual_cell(belief=example_belief(arm_model="gantry_xyz_pan_tilt")).arm

    def targets(self) -> tuple[list[float], list[float]]:
        return [0.0, 0.0, 500.0, 0.0, 0.0], [80.0, -40.0, 450.0, 0.5, 0.3]


class TestVirtualLens(LensConformance):
    cell: VirtualCell

    def device(self) -> Lens:
        return self.cell.lens


class TestVirtualCamera(CameraConformance):
    cell: VirtualCell

    def device(self) -> Camera:
        return self.cell.camera

    def now_s(self) -> float:
        return self.cell.clock.now_s()

    def lose(self) -> None:
        world = self.cell.world
        assert isinstance(world, VirtualWorld)
        world.inject(Faults.model_validate({"camera": {"dead_after_frames": 0}}))

    def bring_back(self) -> None:
        world = self.cell.world
        assert isinstance(world, VirtualWorld)
        world.inject(Faults())
