"""What a cell tells the builder of a simulated world: its own belief, as data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Protocol, runtime_checkable

if TYPE_CHECKING:
    from mvp.calibrated import CameraCalibration, LensTableCalibration
    from mvp.devices.context import Clock
    from mvp.fileedge import FileModel
    from mvp.geometry import Pose, TriangleMesh


@dataclass(frozen=True)
class LampBelief:
    """A point lamp fixed to the camera, in the camera frame."""

    position_mm: tuple[float, float, float]
    strength: float


@dataclass(frozen=True)
class LightBelief:
    """The light as the cell describes it.

    Attributes:
        ambient: grey of a white face lit by nothing else.
        lamps: travel with the camera.
        reference_mm: distance at which a lamp has its stated strength.
        gloss: strength of the mirror lobe relative to the lamp.
        gloss_exponent: its sharpness.
        background: grey of empty space.
    """

    ambient: float
    lamps: tuple[LampBelief, ...]
    reference_mm: float
    gloss: float
    gloss_exponent: float
    background: float


@dataclass(frozen=True, eq=False)
class WorldBelief:
    """The cell as a world is told that it is.

    The calibrations are those of the cell, or of the folder that it names as the truth.
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
        reference_f_mm: likewise; None: it does not say.
        base_from_part: where the part lies.
        mounted_tube_mm: extension tube that is on the lens now.
        light: that travels with the camera; None when the cell does not say.
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
    light: LightBelief | None = None
    reference_f_mm: float | None = None


class WorldClass(Protocol):
    """A class behind an entry point of the group ``mvp_cell.worlds``."""

    Config: ClassVar[type[FileModel]]

    def from_config(
        self, config: FileModel, belief: WorldBelief, *, clock: Clock
    ) -> object:
        """Build the world that drivers reach through ``DeviceContext.world``."""
        ...


@runtime_checkable
class DrawsAhead(Protocol):
    """A world whose first picture takes longer than those after it."""

    def draw_ahead(self) -> None:
        """Make ready what every picture needs, before a camera waits for one."""
        ...
