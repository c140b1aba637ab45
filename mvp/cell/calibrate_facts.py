"""What a calibration session knows of its cell before the first picture."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING

from pydantic import ValidationError

from mvp.calibrated import MeasuredTarget
from mvp.cell.calibrated_devices import temperature_of
from mvp.cell.durable import write_durably
from mvp.devices import Approaching
from mvp.errors import CalibrationError
from mvp.fileedge import read_file
from mvp.wizard import SessionFacts, TargetFacts

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from mvp.calibrated import LensTableCalibration
    from mvp.cell.cell_config import TargetConfig
    from mvp.cell.engine import CellDevices
    from mvp.cell.loading import LoadedCell
    from mvp.devices import Axis, DeviceInfo

_PRINT_SIGMA = 0.002  # office printers are off by about so much
_MAKES_TABLE = "lens"  # what measures the table may do so from the lens's own side


def facts_of(
    cell: LoadedCell,
    devices: CellDevices,
    infos: Mapping[str, DeviceInfo],
    *,
    key: str,
    seed: int,
    accepted: str = "",
) -> SessionFacts:
    """Everything that a session has to know, from the cell and who answered."""
    config, found = cell.config, cell.calibrations
    table = found.lens_table
    temperature = temperature_of(cell, devices, infos)
    return SessionFacts(
        key=key,
        cell=config.name,
        simulated=config.simulated,
        date=datetime.now(UTC).date().isoformat(),
        seed=seed,
        serials={role: info.serial for role, info in infos.items()},
        arm_model=config.kinematics.model,
        camera=found.camera,
        lens_table=_arriving(table, devices) if key == _MAKES_TABLE else table,
        hand_eye=found.hand_eye,
        part_pose=found.part_pose,
        robot={
            "position_mm": config.uncertainty.robot_position_mm,
            "angle_deg": config.uncertainty.robot_angle_deg,
        },
        target=target_facts(config.target, stored_size(found.files)),
        blur_circle_mm=config.optics.blur_circle_um / 1000,
        wavelength_mm=config.optics.wavelength_nm * 1e-6,
        tube_mm=config.optics.mounted_tube_mm,
        workspace_low_mm=config.workspace.low_mm,
        workspace_high_mm=config.workspace.high_mm,
        lens_grid=config.lens_calibration,
        temperature_c=temperature.value_c,
        temperature_source=temperature.source,
        accepted_calibration=accepted,
    )


def target_facts(
    config: TargetConfig | None, measured: MeasuredTarget | None = None
) -> TargetFacts | None:
    """The target of a cell; a size that nobody measured is as good as a printer."""
    if config is None:
        return None
    given = config.model_dump()
    if given["square_sigma_mm"] is None:
        given["square_sigma_mm"] = _PRINT_SIGMA * config.square_mm
    return TargetFacts.model_validate(given).sized(measured)


def stored_size(files: Mapping[str, Path]) -> MeasuredTarget | None:
    """The target's size by caliper, as an earlier session kept it; None: nobody did.

    Raises:
        CalibrationError: the file is damaged.
    """
    path = _size_file(files)
    if not path.exists():
        return None
    content = read_file(path, CalibrationError, hint="check its permissions")
    try:
        return MeasuredTarget.model_validate_json(content)
    except ValidationError as error:
        problem = error.errors(include_url=False)[0]["msg"]
        raise CalibrationError(
            f"{path}: not the size of a target: {problem}",
            hint="delete it; the next calibration asks for it again",
            where=str(path),
        ) from error


def keep_size(files: Mapping[str, Path], target: TargetFacts | None) -> None:
    """Keep what a person measured beside the calibrations, for those that follow.

    Raises:
        OutputError: the disk does not take it.
    """
    if target is None or target.measured is None:
        return
    text = target.measured.model_dump_json(by_alias=True, indent=1) + "\n"
    write_durably(_size_file(files), text.encode())


def _size_file(files: Mapping[str, Path]) -> Path:
    return files["camera"].parent / "target_size.json"


_TABLES: dict[Axis, str] = {
    "zoom": "zoom_f_mm",
    "focus": "focus_extension_mm",
    "iris": "iris_a_mm",
}


def _arriving(
    table: LensTableCalibration, devices: CellDevices
) -> LensTableCalibration:
    """The table with the sides from which the lens says that it arrives."""
    if not isinstance(devices.lens, Approaching):
        return table
    sides = devices.lens.approach()
    changed = {
        name: getattr(table, name).model_copy(update={"approach": sides[axis]})
        for axis, name in _TABLES.items()
    }
    return table.model_copy(update=changed)
