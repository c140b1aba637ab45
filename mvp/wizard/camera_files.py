"""Cameras in the files of other programs, as whoever reads and writes them hands them over."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol, cast

from mvp.wizard.registry import load_named

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from mvp.calibrated import CameraCalibration

CAMERA_FILES = "mvp_cell.camera_files"
OF_SIMULATED_CELL = "of the simulated cell"  # in a note, by which such a file is known


@dataclass(frozen=True, eq=False)
class CameraStatement:
    """What the file of another program does not say, and who knows it.

    Attributes:
        sensor: the camera in place: size and pitch of the pixels.
        simulated: the cell is.
        principal_mm: least and largest principal distance that its lens can have.
        serial: of the camera; empty: nobody says.
        date: of the measurement, ISO; empty: nobody says.
        temperature_c: of the measurement; None: nobody says.
        sigmas: one standard deviation of values, by their names (``fx_px``, ``cx_px``,
            ``k1``, ...), in their units.
    """

    sensor: CameraCalibration
    simulated: bool
    principal_mm: tuple[float, float]
    serial: str = ""
    date: str = ""
    temperature_c: float | None = None
    sigmas: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class ImportedCamera:
    """The camera of a file, as far as it can be believed.

    Attributes:
        result: for ``[calibration] camera``.
        format: of the file.
        unused: keys of the file that say nothing about a camera.
        unsaid: what neither the file nor a person said, in words.
    """

    result: CameraCalibration
    format: str
    unused: tuple[str, ...]
    unsaid: tuple[str, ...]


class CameraFiles(Protocol):
    """Reads and writes them.

    ``formats``: names of those that it knows.
    """

    formats: tuple[str, ...]

    def read(self, path: Path, stated: CameraStatement) -> ImportedCamera:
        """The camera of a file; the format shows in its content.

        Raises:
            CalibrationError: not such a file, not of this sensor and lens, or by its
                notes of a simulated cell, which this one is not; names file and key.
            UsageError: the statement cannot be.
        """
        ...

    def text(
        self, name: str, camera: CameraCalibration, *, label: str, notes: Sequence[str]
    ) -> str:
        """The file of a camera at its reference setting.

        Args:
            name: of the format.
            camera: with ``reference_fx_px`` and ``reference_fy_px``.
            label: what the camera is called.
            notes: lines of comment.

        Raises:
            CalibrationError: the format cannot say it.
        """
        ...


def load_camera_files() -> CameraFiles:
    """What is installed.

    Raises:
        PluginError: not installed, installed twice, or it does not load.
    """
    found = load_named(CAMERA_FILES, "yaml", "reader of camera files", made=True)
    return cast("CameraFiles", found)
