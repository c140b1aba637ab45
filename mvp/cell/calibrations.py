"""Load the calibration files of a cell, hashed and judged."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from pydantic import ValidationError

from mvp.calibrated import (
    CameraCalibration,
    LensTableCalibration,
    Quality,
    RigidCalibration,
)
from mvp.cell.places import inside, sha256_of
from mvp.cell.toml_file import dotted
from mvp.errors import CalibrationError, ConfigError
from mvp.fileedge import read_file
from mvp.geometry import Pose

if TYPE_CHECKING:
    from pathlib import Path

    from mvp.cell.cell_config import CalibrationFiles

_Model = TypeVar("_Model", CameraCalibration, LensTableCalibration, RigidCalibration)
_NAMES = ("camera", "lens_table", "hand_eye", "part_pose")


@dataclass(frozen=True, eq=False)
class Calibrations:
    """What was measured about the cell.

    Attributes:
        tool_from_camera: hand-eye at its reference lens setting.
        base_from_part: where the part lies.
        files: where each came from, by name.
        sha256: content hash of each file, by name.
        accepted: names accepted against their verdict, with the person's reason.
    """

    camera: CameraCalibration
    lens_table: LensTableCalibration
    hand_eye: RigidCalibration
    part_pose: RigidCalibration
    tool_from_camera: Pose
    base_from_part: Pose
    files: dict[str, Path]
    sha256: dict[str, str]
    accepted: dict[str, str]


def load_calibrations(
    names: CalibrationFiles,
    cell_file: Path,
    *,
    simulated: bool,
    accept_reason: str = "",
) -> Calibrations:
    """Read, hash and judge the four files.

    Raises:
        CalibrationError: missing, unreadable, foreign or too poor.
    """
    paths = {name: _path(names, cell_file, name) for name in _NAMES}
    camera = _read(paths["camera"], "camera", CameraCalibration)
    lens_table = _read(paths["lens_table"], "lens_table", LensTableCalibration)
    hand_eye = _read(paths["hand_eye"], "hand_eye", RigidCalibration)
    part_pose = _read(paths["part_pose"], "part_pose", RigidCalibration)
    accepted: dict[str, str] = {}
    for name, model in (
        ("camera", camera),
        ("lens_table", lens_table),
        ("hand_eye", hand_eye),
        ("part_pose", part_pose),
    ):
        if model.provenance.simulated and not simulated:
            raise _foreign(paths[name], name)
        accepted |= _judge(paths[name], name, model.quality, accept_reason)
    return Calibrations(
        camera,
        lens_table,
        hand_eye,
        part_pose,
        _pose(paths["hand_eye"], hand_eye, "tool", "camera"),
        _pose(paths["part_pose"], part_pose, "base", "part"),
        paths,
        {name: sha256_of(path) for name, path in paths.items()},
        accepted,
    )


def with_part_pose(
    found: Calibrations, path: Path, *, simulated: bool, accept_reason: str = ""
) -> Calibrations:
    """The same cell with another part in it.

    Raises:
        CalibrationError: unreadable, foreign or too poor.
    """
    model = _read(path, "part_pose", RigidCalibration)
    if model.provenance.simulated and not simulated:
        raise _foreign(path, "part_pose")
    accepted = _judge(path, "part_pose", model.quality, accept_reason)
    return replace(
        found,
        part_pose=model,
        base_from_part=_pose(path, model, "base", "part"),
        files=found.files | {"part_pose": path},
        sha256=found.sha256 | {"part_pose": sha256_of(path)},
        accepted=found.accepted | accepted,
    )


def _path(names: CalibrationFiles, cell_file: Path, name: str) -> Path:
    try:
        return inside(
            cell_file.parent,
            cell_file.parent,
            getattr(names, name),
            f"{cell_file}: calibration.{name}",
        )
    except ConfigError as error:
        raise CalibrationError(
            error.message,
            hint=f"restore the file, or name another one in {cell_file}, [calibration]",
            where=error.where,
        ) from error


def _read(path: Path, name: str, model: type[_Model]) -> _Model:
    content = read_file(
        path, CalibrationError, hint="check the permissions of the file"
    )
    try:
        return model.model_validate_json(content)
    except ValidationError as error:
        problem = error.errors(include_url=False)[0]
        raise CalibrationError(
            f"{path}: {dotted(problem['loc'])}: {problem['msg']}",
            hint=f"this is not a {name} calibration; restore the file, or name another "
            f"one in [calibration] of the cell file",
            where=str(path),
        ) from error


def _foreign(path: Path, name: str) -> CalibrationError:
    return CalibrationError(
        f"{path}: this {name} calibration comes from a simulated cell "
        "and cannot be used on a real one",
        hint="name one that was measured on this cell in [calibration] of the cell file",
        where=str(path),
    )


def _judge(path: Path, name: str, quality: Quality, reason: str) -> dict[str, str]:
    """Accept a good verdict, or a poor one for a stated reason."""
    if quality.verdict == "go":
        return {}
    if reason.strip():
        return {name: reason.strip()}
    why = "; ".join(quality.reasons) or "no reason given"
    raise CalibrationError(
        f"{path}: the {name} calibration is {quality.verdict.upper()}: {why}",
        hint="name a better one in [calibration] of the cell file, or take the "
        "responsibility with --accept-calibration REASON",
        where=str(path),
    )


def _pose(path: Path, model: RigidCalibration, target: str, source: str) -> Pose:
    if (model.target, model.source) != (target, source):
        raise CalibrationError(
            f"{path}: maps {model.source} to {model.target}, "
            f"but {source} to {target} is needed here",
            hint="correct the name of the file in the cell file",
            where=str(path),
        )
    try:
        return Pose.from_matrix(target, source, np.asarray(model.matrix, np.float64))
    except ValueError as error:
        raise CalibrationError(
            f"{path}: {error}",
            hint="the file is damaged; restore it, or name another one in [calibration] "
            "of the cell file",
            where=str(path),
        ) from error
