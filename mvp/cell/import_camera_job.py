"""Put the camera of another program's file beside a cell, for what it is worth."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from datetime import UTC, date, datetime, timedelta
from typing import TYPE_CHECKING

from mvp.cell.calibrate_folders import put_in_place
from mvp.cell.calibrate_job import LOCK_NAME, refuse_bundled
from mvp.cell.calibration_gates import of_file
from mvp.cell.calibration_items import UNJUDGED
from mvp.cell.calibration_stale import of_inputs
from mvp.cell.exchange_documents import ImportCameraDocument, ImportObjection
from mvp.cell.in_use import using_devices
from mvp.cell.interrupts import uninterrupted
from mvp.cell.loading import load_cell, read_cell
from mvp.cell.lock import cell_lock
from mvp.errors import UsageError
from mvp.optics import LensTable
from mvp.wizard import CameraStatement, load_camera_files

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from mvp.cell.loading import LoadedCell
    from mvp.wizard import ImportedCamera

_ME = "import-camera"
_FAR_OFF = 1.25  # a nominal lens table is not that wrong, another unit or scale is
_WARMTH_C = (-50.0, 100.0)


@dataclass(frozen=True)
class ImportRequest:
    """What a person says of the file.

    Attributes:
        serial: of the camera; empty: not said.
        date: when it was measured, ISO; empty: not said.
        temperature_c: then; None: not said.
        sigmas: NAME=VALUE, each.
    """

    serial: str = ""
    date: str = ""
    temperature_c: float | None = None
    sigmas: Sequence[str] = ()


def import_camera(
    cell: str, path: Path, request: ImportRequest
) -> ImportCameraDocument:
    """Judge the file, then put it in place; the camera before is kept.

    Args:
        cell: path or name.
        path: of the other program's file.
        request: what it does not say.

    Raises:
        UsageError: no such cell, a bundled one, or what is said cannot be.
        CalibrationError: the file cannot be read, or is not of this camera and lens.
        RecordError: a run or a calibration is under way.
        OutputError: the disk does not take it.
    """
    refuse_bundled(read_cell(cell)[0].path)
    loaded = load_cell(cell, accept_calibration=UNJUDGED, replaces="camera")
    statement = _statement(loaded, request)
    found = load_camera_files().read(path, statement)
    place = loaded.calibrations.files["camera"]
    text = found.result.model_dump_json(by_alias=True, indent=1) + "\n"
    with (
        using_devices(loaded, who=_ME),
        cell_lock(place.parent / LOCK_NAME, run_id=_ME),
        uninterrupted(),
    ):
        kept = put_in_place(place, text.encode())
    return ImportCameraDocument(
        cell=loaded.config.name,
        simulated=loaded.config.simulated,
        file=str(path),
        format=found.format,
        placed=str(place),
        kept=None if kept is None else str(kept),
        principal_distance_mm=_principal_mm(found),
        unused=list(found.unused),
        unsaid=list(found.unsaid),
        overruled=_overruled(loaded),
        objections=_objections(loaded, found),
        document=found.result,
    )


def _statement(cell: LoadedCell, request: ImportRequest) -> CameraStatement:
    warm = request.temperature_c
    if warm is not None and not _WARMTH_C[0] <= warm <= _WARMTH_C[1]:
        raise _cannot_be("--temperature-c", f"{warm:g}", "degrees Celsius")
    return CameraStatement(
        sensor=cell.calibrations.camera,
        simulated=cell.config.simulated,
        principal_mm=_lens_range_mm(cell),
        serial=request.serial.strip(),
        date=_date(request.date.strip()),
        temperature_c=warm,
        sigmas=_sigmas(request.sigmas),
    )


def _date(text: str) -> str:
    if not text:
        return ""
    try:
        found = date.fromisoformat(text)
    except ValueError:
        raise _cannot_be("--date", text, "a day, such as 2026-01-31") from None
    if found > datetime.now(UTC).date() + timedelta(days=1):
        raise _cannot_be("--date", text, "a day that is past")
    return found.isoformat()


def _sigmas(texts: Sequence[str]) -> dict[str, float]:
    found: dict[str, float] = {}
    for name, value in map(_sigma, texts):
        if name in found:
            raise UsageError(
                f"--sigma {name} is said twice: {found[name]:g} and {value:g}",
                hint="say it once",
                where="--sigma",
            )
        found[name] = value
    return found


def _sigma(text: str) -> tuple[str, float]:
    name, _, number = text.partition("=")
    try:
        value = float(number)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise _cannot_be("--sigma", text, "NAME=VALUE, such as --sigma cx_px=0.5")
    return name.strip(), value


def _cannot_be(option: str, given: str, wanted: str) -> UsageError:
    return UsageError(
        f"{option} {given} makes no sense", hint=f"it takes {wanted}", where=option
    )


def _principal_mm(found: ImportedCamera) -> float:
    return (found.result.reference_fx_px or 0.0) * found.result.pitch_x_um / 1000


def _lens_range_mm(cell: LoadedCell) -> tuple[float, float]:
    """Principal distances that the lens may have, and then some."""
    optics = cell.config.optics
    table = LensTable.from_calibration(cell.calibrations.lens_table)
    longest = max(0.0, optics.mounted_tube_mm, *optics.extension_tubes_mm)
    shortest_f, longest_f = table.f_range_mm
    farthest = table.with_tube(longest).d_range_mm(longest_f)[1]
    return shortest_f / _FAR_OFF, farthest * _FAR_OFF


def _overruled(cell: LoadedCell) -> list[str]:
    by_zoom = cell.calibrations.lens_table.by_zoom
    own = ("centre_x_px", "centre_y_px", "k1")
    return [] if by_zoom is None else [name for name in own if name in by_zoom.lists]


def _objections(cell: LoadedCell, found: ImportedCamera) -> list[ImportObjection]:
    """What ``run`` will say of the camera, and of what was made with the one before."""
    simulated, place = cell.config.simulated, cell.calibrations.files["camera"]
    now = replace(cell.calibrations, camera=found.result)
    every = [
        *of_file("camera", place, found.result, simulated=simulated),
        *of_inputs(now, simulated=simulated),
    ]
    return [
        ImportObjection(
            calibration=one.name, text=one.text, fix=one.fix, refused=one.refused
        )
        for one in every
    ]
