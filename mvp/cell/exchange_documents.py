"""What ``mvp-cell export-camera`` and ``import-camera`` say to programs."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from mvp.calibrated import CameraCalibration
from mvp.fileedge import FileModel
from mvp.planning.plan import LensSteps


class ExportCameraDocument(FileModel):
    """``export-camera --json``.

    ``setting``: of the lens, in words; intrinsics belong to one. ``lens_steps``: null
    where it is that of the camera calibration, which does not say its steps.
    ``principal_distance_mm``: there. ``warnings``: what speaks against the calibrations
    that it comes from, accepted or not refused.
    """

    schema_: Literal["mvp-cell/export-camera/1"] = Field(
        default="mvp-cell/export-camera/1", alias="schema"
    )
    cell: str
    simulated: bool
    file: str
    format: str
    setting: str
    lens_steps: LensSteps | None
    principal_distance_mm: float
    origin: Literal["measured", "nominal"]
    verdict: Literal["go", "marginal", "no-go"]
    warnings: list[str]


class ImportObjection(FileModel):
    """What speaks against a calibration now; ``refused``: ``run`` will not use it."""

    calibration: str
    text: str
    fix: str
    refused: bool


class ImportCameraDocument(FileModel):
    """``import-camera --json``.

    ``document``: the camera calibration, as it was put in place. ``kept``: where the one
    that it replaced is kept; null when there was none, or it was the same. ``unused``:
    keys of the file that say nothing about a camera. ``unsaid``: what neither the file
    nor a person said. ``overruled``: values that do not count, as the lens table has them
    for every zoom. ``objections``: what ``run`` and ``check`` will say.
    """

    schema_: Literal["mvp-cell/import-camera/1"] = Field(
        default="mvp-cell/import-camera/1", alias="schema"
    )
    cell: str
    simulated: bool
    file: str
    format: str
    placed: str
    kept: str | None
    principal_distance_mm: float
    unused: list[str]
    unsaid: list[str]
    overruled: list[str]
    objections: list[ImportObjection]
    document: CameraCalibration
