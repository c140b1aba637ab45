"""Write the camera of a cell as a file of another program."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mvp.cell.calibration_gates import require_accepted
from mvp.cell.check_job import load_unjudged
from mvp.cell.durable import check_file_writable, write_durably
from mvp.cell.exchange_documents import ExportCameraDocument
from mvp.errors import CalibrationError, InputError, UsageError
from mvp.kinematics import intrinsics_of
from mvp.optics import LensTable, principal_distance_mm
from mvp.planning.plan import LensSteps
from mvp.wizard import OF_SIMULATED_CELL, load_camera_files

if TYPE_CHECKING:
    from pathlib import Path

    from mvp.calibrated import CameraCalibration
    from mvp.cell.loading import LoadedCell
    from mvp.optics import LensSetting

_ENDINGS = (".yaml", ".yml")
_ANY_STEPS = "--at ZOOM,FOCUS,IRIS, in motor steps"


@dataclass(frozen=True)
class _Setting:
    """A camera at one lens setting."""

    camera: CameraCalibration
    words: str
    steps: LensSteps | None = None

    @property
    def principal_mm(self) -> float:
        return (self.camera.reference_fx_px or 0.0) * self.camera.pitch_x_um / 1000


def export_camera(
    cell: str, path: Path, format_name: str, *, at: str = "", accept: str = ""
) -> ExportCameraDocument:
    """The intrinsics at one setting of the lens.

    Args:
        cell: path or name.
        path: of the file; replaced if it is there.
        format_name: opencv, ros or kalibr.
        at: motor steps ZOOM,FOCUS,IRIS; empty: the setting of the camera calibration.
        accept: why a person takes the responsibility for a poor calibration.

    Raises:
        UsageError: no such cell or format, not the name of a YAML file, no setting.
        CalibrationError: missing, refused, or the format cannot say it.
        InputError: the lens table does not hold at these steps.
        OutputError: the disk does not take it.
    """
    files = load_camera_files()
    _check_names(path, format_name, files.formats)
    loaded = load_unjudged(cell)
    found = _at_steps(loaded, _steps(at)) if at else _as_calibrated(loaded)
    used = ("camera", "lens_table") if at else ("camera",)
    objections = [one for one in loaded.calibrations.objections if one.name in used]
    require_accepted(objections, accept)
    label = re.sub(r"[^A-Za-z0-9_]+", "_", loaded.config.name) or "camera"
    notes = _notes(loaded, found, accept if any(o.refused for o in objections) else "")
    try:
        text = files.text(format_name, found.camera, label=label, notes=notes)
    except CalibrationError as error:
        error.where = error.where or str(loaded.calibrations.files["camera"])
        raise
    check_file_writable(path, needed_bytes=len(text))
    write_durably(path, text.encode())
    return ExportCameraDocument(
        cell=loaded.config.name,
        simulated=loaded.config.simulated,
        file=str(path),
        format=format_name,
        setting=found.words,
        lens_steps=found.steps,
        principal_distance_mm=found.principal_mm,
        origin=found.camera.provenance.origin,
        verdict=found.camera.quality.verdict,
        warnings=[one.text for one in objections],
    )


def _check_names(path: Path, format_name: str, formats: tuple[str, ...]) -> None:
    if format_name not in formats:
        raise UsageError(
            f"--to {format_name}: there is no such format",
            hint=f"there are: {', '.join(formats)}",
            where="--to",
        )
    if path.suffix.lower() not in _ENDINGS:
        named = (
            path.with_suffix(".yaml") if path.name.strip(".") else path / "camera.yaml"
        )
        raise UsageError(
            f"{path}: a camera is written to a YAML file",
            hint=f"name it {named}",
            where="--out",
        )


def _steps(at: str) -> LensSteps:
    words = [word.strip() for word in at.split(",")]
    if len(words) != 3 or not all(re.fullmatch(r"-?\d{1,9}", word) for word in words):
        raise UsageError(
            f"--at {at}: three whole numbers of motor steps are needed",
            hint="say --at ZOOM,FOCUS,IRIS, such as --at 1300,3000,120",
            where="--at",
        )
    zoom, focus, iris = map(int, words)
    return LensSteps(zoom=zoom, focus=focus, iris=iris)


def _as_calibrated(cell: LoadedCell) -> _Setting:
    """At the lens setting of the pictures that the camera was calibrated with."""
    camera = cell.calibrations.camera
    if camera.reference_fx_px is None or camera.reference_fy_px is None:
        path = cell.calibrations.files["camera"]
        raise UsageError(
            f"{path}: reference_fx_px: this camera calibration has no principal distance; "
            "intrinsics belong to one setting of the lens",
            hint=f"say which: {_proposed(cell)}",
            where=str(path),
        )
    return _Setting(camera, "the lens as it stood when the camera was calibrated")


def _proposed(cell: LoadedCell) -> str:
    """The setting that hand-eye belongs to, where it says so."""
    d_mm = cell.calibrations.hand_eye.reference_d_mm
    f_mm = cell.calibrations.hand_eye.reference_f_mm
    if d_mm is None or f_mm is None:
        return _ANY_STEPS
    try:
        table = _table(cell)
        steps = table.steps(f_mm, d_mm, sum(table.a_range_mm) / 2)
    except InputError:
        return _ANY_STEPS
    return f"--at {steps.zoom},{steps.focus},{steps.iris}, to which hand-eye belongs"


def _table(cell: LoadedCell) -> LensTable:
    """Where it holds, with the tube that is mounted."""
    model = cell.calibrations.lens_table
    tube = cell.config.optics.mounted_tube_mm
    return LensTable.from_calibration(model, tube_mm=tube).within(model.validity)


def _at_steps(cell: LoadedCell, steps: LensSteps) -> _Setting:
    """As the lens table tells; it may have principal point and k1 of every zoom."""
    try:
        lens = _table(cell).setting(steps.zoom, steps.focus, steps.iris)
    except InputError as error:
        path = cell.calibrations.files["lens_table"]
        raise InputError(
            f"--at: {path}: {error.message}", hint=error.hint, where="--at"
        ) from error
    camera = cell.calibrations.camera
    seen = intrinsics_of(camera).at(lens.centre_px, lens.k1)
    matrix = seen.camera_matrix(_principal_mm(lens))
    changed = {
        "reference_fx_px": float(matrix[0, 0]),
        "reference_fy_px": float(matrix[1, 1]),
        "centre_x_px": seen.centre_x_px,
        "centre_y_px": seen.centre_y_px,
        "k1": seen.k1,
    }
    words = (
        f"the lens at steps zoom {steps.zoom}, focus {steps.focus}, iris {steps.iris}: "
        f"f {lens.f_mm:.4f}, d {lens.d_mm:.4f} mm"
    )
    return _Setting(camera.model_copy(update=changed), words, steps)


def _principal_mm(lens: LensSetting) -> float:
    return float(principal_distance_mm(lens.d_mm, lens.f_mm, lens.e_mm))


def _notes(cell: LoadedCell, found: _Setting, accepted: str) -> list[str]:
    """For whoever opens the file: it is true of one cell, at one setting."""
    made = found.camera.provenance
    whose = OF_SIMULATED_CELL if cell.config.simulated else "of the cell"
    notes = [
        f"camera {made.device_serial or 'of unknown serial number'} {whose} "
        f"{cell.config.name}",
        f"holds for {found.words}",
        f"{made.origin}, {made.date}, {found.camera.quality.verdict.upper()}",
        "pixel (0, 0) is the centre of the top-left pixel",
    ]
    return [*notes, f"accepted by a person: {accepted}"] if accepted else notes
