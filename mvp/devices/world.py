"""What a cell tells the builder of a simulated world: its own belief, as data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Protocol

if TYPE_CHECKING:
    from mvp.calibrated import CameraCalibration, LensTableCalibration
    from mvp.devices.context import Clock
    from mvp.fileedge import FileModel
    from mvp.geometry import Pose, TriangleMesh


@dataclass(frozen=True, eq=False)
class WorldBelief:
    """The cell as configuration and calibration describe it.

    A world makes its truth of this and of its own configured errors; nothing flows
    back.

    Attributes:
        part: in the part frame.
        fixtures: in the base frame.
        arm_model: name of the kinematic model.
        start_joints: (dof,) where the arm stands at first, rad or mm.
        camera: sensor, principal point, distortion.
        lens_table: motor steps to f, d, a and e.
        tool_from_camera: hand-eye at ``reference_d_mm``.
        reference_d_mm: lens setting of the hand-eye result, mm.
        base_from_part: where the part lies.
        mounted_tube_mm: extension tube that is on the lens now.
    """

    part: TriangleMesh
    fixtures: tuple[TriangleMesh, ...]
    arm_model: str
    start_joints: tuple[float, ...]
    camera: CameraCalibration
    lens_table: LensTableCalibration
    tool_from_camera: Pose
    reference_d_mm: float
    base_from_part: Pose
    mounted_tube_mm: float = 0.0


class WorldClass(Protocol):
    """A class behind an entry point of the group ``mvp_cell.worlds``."""

    Config: ClassVar[type[FileModel]]

    def from_config(
        self, config: FileModel, belief: WorldBelief, *, clock: Clock
    ) -> object:
        """Build the world that drivers reach through ``DeviceContext.world``."""
        ...
