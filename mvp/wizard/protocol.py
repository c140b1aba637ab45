"""What a wizard may ask of the cell, and what the cell asks of a wizard."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol, TypeAlias, TypeVar

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Generator, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from mvp.calibrated import PointResiduals, Quality, ResultComparison
    from mvp.fileedge import FileModel
    from mvp.geometry import FloatArray, Pose, TriangleMesh
    from mvp.kinematics import ArmModel
    from mvp.wizard.facts import SessionFacts
    from mvp.wizard.part import PartSights
    from mvp.wizard.steps import Answer, Step

    Steps: TypeAlias = Generator[Step, Answer, "Outcome"]


@dataclass(frozen=True, eq=False)
class Stand:
    """A place where the arm can stand, or stands.

    Attributes:
        joints: (dof,) rad or mm.
        base_from_tool: the flange there, by the arm's own model or word.
    """

    joints: FloatArray
    base_from_tool: Pose


@dataclass(frozen=True)
class Refusal:
    """Why the arm will not go somewhere."""

    reason: str


@dataclass(frozen=True, eq=False)
class Way:
    """A clear way from where the arm stands now.

    Attributes:
        waypoints: (k, dof), without the start, the goal last.
        seconds: how long it should take.
    """

    waypoints: FloatArray
    seconds: float


@dataclass(frozen=True, eq=False)
class Shot:
    """A picture with everything that stood still while it was taken.

    Attributes:
        pixels: (rows, columns) uint8 or uint16, linear in light.
        full_scale: grey value of a saturated pixel.
        exposure_s: how long.
        gain: how amplified.
        joints: (dof,) as the arm told, rad or mm.
        base_from_tool: as the arm told.
        lens_steps: zoom, focus, iris.
        times_s: monotonic: ``arm_standing``, ``lens_standing``, ``exposure_start``,
            ``received``.
        settled: arm and lens stood, before and after, at the same place.
        frame_id: the camera's own counter.
    """

    pixels: NDArray[np.uint8] | NDArray[np.uint16]
    full_scale: int
    exposure_s: float
    gain: float
    joints: FloatArray
    base_from_tool: Pose
    lens_steps: Mapping[str, int]
    times_s: Mapping[str, float]
    settled: bool
    frame_id: int

    @property
    def grey(self) -> NDArray[np.uint8]:
        """The picture in 8 bits, the full scale at 255."""
        if self.pixels.dtype == np.uint8 and self.full_scale == 255:
            return self.pixels.astype(np.uint8, copy=False)
        scaled = self.pixels.astype(np.float64) * (255 / self.full_scale)
        return np.clip(np.rint(scaled), 0, 255).astype(np.uint8)


class Bench(Protocol):
    """The cell as a wizard sees it. Moves only in ``move`` and ``set_lens``."""

    @property
    def facts(self) -> SessionFacts:
        """What is known and believed before the first picture."""
        ...

    @property
    def arm(self) -> ArmModel:
        """Kinematics."""
        ...

    @property
    def part(self) -> TriangleMesh:
        """The task's part, part frame."""
        ...

    @property
    def sights(self) -> PartSights:
        """The task's part as it can be looked at and measured."""
        ...

    def rng(self, number: int) -> np.random.Generator:
        """Randomness that is the same whenever it is asked for with this number."""
        ...

    @property
    def drives_straight(self) -> bool:
        """The lens can be driven without a run-up."""
        ...

    def standing(self) -> Stand:
        """Where the arm stands now."""
        ...

    def joints_for(self, base_from_camera: Pose, *, d_mm: float) -> Stand | Refusal:
        """Where the arm must stand for a camera pose, at a lens setting.

        By the believed hand-eye transform; reach, joint limits with their margin,
        clearance to part, fixtures, target and itself, line of sight to the target. Of
        several ways to stand the one next to where the arm is. Nothing moves.
        """
        ...

    def way_to(self, joints: FloatArray) -> Way | Refusal:
        """A clear way there from where the arm stands now. Nothing moves."""
        ...

    def move(self, joints: FloatArray) -> Stand:
        """Move there along a clear way and let the arm settle; returns where it stands.

        Raises:
            InfeasibleError: there is no clear way; nothing has moved.
            DeviceError: the arm failed or was stopped.
        """
        ...

    def set_lens(
        self, *, zoom: int, focus: int, iris: int, straight: bool = False
    ) -> None:
        """Set the lens, arriving from the side of the lens table, and let it settle.

        A lens that is not homed is homed first.

        Args:
            zoom: motor steps.
            focus: motor steps.
            iris: motor steps.
            straight: without a run-up, from wherever the motors are, so that backlash
                can be measured; only where ``drives_straight``.

        Raises:
            DeviceError: refused, failed, stopped, or not where it was sent.
        """
        ...

    def shoot(self, exposure_s: float | None = None) -> Shot:
        """One picture, exposed after arm and lens stood still.

        Args:
            exposure_s: how long; None: so long that the brightest half per cent of the
                picture is near 80 % of the full scale.

        Raises:
            DeviceError: no valid picture, or something moved meanwhile.
        """
        ...


class Store(Protocol):
    """What the cell needs of the thing that keeps a session's samples."""

    @property
    def path(self) -> Path:
        """The session's folder."""
        ...

    @property
    def facts(self) -> SessionFacts:
        """As they were when the session began."""
        ...

    @property
    def count(self) -> int:
        """Samples that were taken and not taken back."""
        ...

    def sha256(self) -> str:
        """Over everything that the result depends on."""
        ...


StoreT = TypeVar("StoreT", bound=Store)
MadeT_co = TypeVar("MadeT_co", bound=Store, covariant=True)


class Sessions(Protocol[MadeT_co]):
    """Makes and opens session folders; a class with two class methods does."""

    def create(self, folder: Path, facts: SessionFacts) -> MadeT_co:
        """A new session in a folder that does not exist yet.

        Raises:
            OutputError: the disk does not take it.
        """
        ...

    def open(self, folder: Path, *, repair: bool = False) -> MadeT_co:
        """A session that was begun.

        Args:
            folder: of it.
            repair: drop what a crash left half-written.

        Raises:
            RecordError: not a session, damaged, or changed since.
        """
        ...


@dataclass(frozen=True)
class WizardOptions:
    """How a session is run.

    Attributes:
        auto: nobody watches; questions get their defaults.
        most_samples: end after so many usable ones; None: the wizard's own limit.
        verify: keep views apart that test the result; False: where something else
            will.
    """

    auto: bool = False
    most_samples: int | None = None
    verify: bool = True


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a session gave.

    Attributes:
        key: of the wizard.
        document: the file to put in place; None when there is nothing to put there.
        quality: with verdict, causes and next action; also that of the document.
        lines: the result in words and millimetres, for a person.
        details: plain data and arrays for the report, by name.
        points: residuals point by point, for the session's folder.
        comparison: with the result that was in place; None without a result.
    """

    key: str
    document: FileModel | None
    quality: Quality
    lines: Sequence[str] = ()
    details: Mapping[str, object] = field(default_factory=dict)
    points: Sequence[PointResiduals] = ()
    comparison: ResultComparison | None = None


class Wizard(Protocol[StoreT]):
    """A calibration: takes samples at a bench, computes from what it stored."""

    @property
    def key(self) -> str:
        """``mvp-cell calibrate KEY``."""
        ...

    @property
    def writes(self) -> str:
        """Which file of ``[calibration]`` it makes: ``camera``, ``lens_table`` ..."""
        ...

    @property
    def sessions(self) -> Sessions[StoreT]:
        """What keeps its samples."""
        ...

    def steps(self, bench: Bench, store: StoreT, options: WizardOptions) -> Steps:
        """Take samples, from wherever the store has come to, and compute.

        Ends with ``return self.outcome(store)``.

        Raises:
            CalibrationError: it cannot be done in this cell (no target, nothing in
                reach); the hint says what to change.
        """
        ...

    def outcome(self, store: StoreT) -> Outcome:
        """The result, from the folder alone; the same numbers every time.

        Raises:
            CalibrationError: there is nothing to compute from.
        """
        ...

    def page(self, store: StoreT, outcome: Outcome) -> str:
        """The report as one self-contained HTML page; empty when there is none."""
        ...
