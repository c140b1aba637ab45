"""Load the calibration files of a cell, hashed and judged."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from pydantic import ValidationError

from mvp.calibrated import (
    CameraCalibration,
    LensTableCalibration,
    RigidCalibration,
)
from mvp.cell.calibration_gates import (
    NAMES,
    Objection,
    of_file,
    of_lens_setting,
    require_accepted,
)
from mvp.cell.calibration_stale import of_inputs
from mvp.cell.places import inside, sha256_of
from mvp.cell.toml_file import dotted
from mvp.errors import CalibrationError, ConfigError
from mvp.fileedge import read_file
from mvp.geometry import Pose

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from mvp.cell.cell_config import CalibrationFiles

_Model = TypeVar("_Model", CameraCalibration, LensTableCalibration, RigidCalibration)


@dataclass(frozen=True, eq=False)
class CalibrationModels:
    """The content of the four files, with the transforms as poses.

    Attributes:
        tool_from_camera: hand-eye at its reference lens setting.
        base_from_part: where the part lies.
        files: where each came from, by name.
    """

    camera: CameraCalibration
    lens_table: LensTableCalibration
    hand_eye: RigidCalibration
    part_pose: RigidCalibration
    tool_from_camera: Pose
    base_from_part: Pose
    files: dict[str, Path]


@dataclass(frozen=True, eq=False)
class Calibrations(CalibrationModels):
    """What was measured about the cell.

    Attributes:
        sha256: content hash of each file, by name.
        objections: what speaks against them, as far as the files tell.
        accepted: names accepted against an objection, with the person's reason.
    """

    sha256: dict[str, str]
    objections: tuple[Objection, ...] = ()
    accepted: dict[str, str] = field(default_factory=dict)

    @property
    def warnings(self) -> tuple[Objection, ...]:
        """Objections that do not refuse."""
        return tuple(one for one in self.objections if not one.refused)


def load_calibrations(
    names: CalibrationFiles,
    cell_file: Path,
    *,
    simulated: bool,
    tubes_mm: Sequence[float] = (),
    accept_reason: str = "",
    finds_part: bool = False,
    replaces: str = "",
) -> Calibrations:
    """Read, hash and judge the four files.

    Args:
        names: of the files, relative to the cell's folder.
        cell_file: of the cell.
        simulated: the cell is.
        tubes_mm: extension tubes that the lens may have had.
        accept_reason: why a person takes the responsibility for what is refused.
        finds_part: the part's pose is only where to begin to look for it.
        replaces: the calibration that is about to be replaced, and refused by nothing.

    Raises:
        CalibrationError: missing, unreadable, foreign or too poor; all of it.
    """
    found = read_calibrations(lambda name: _path(names, cell_file, name))
    objections = [
        one
        for name in NAMES
        for one in of_file(
            name, found.files[name], getattr(found, name), simulated=simulated
        )
    ]
    objections += of_lens_setting(
        found.hand_eye, found.lens_table, found.files, tubes_mm
    )
    for one in of_inputs(found, simulated=simulated):
        begins = finds_part and one.name == "part_pose"
        objections.append(replace(one, refused=False) if begins else one)
    return Calibrations(
        found.camera,
        found.lens_table,
        found.hand_eye,
        found.part_pose,
        found.tool_from_camera,
        found.base_from_part,
        found.files,
        {name: sha256_of(path) for name, path in found.files.items()},
        tuple(objections),
        require_accepted((o for o in objections if o.name != replaces), accept_reason),
    )


def with_part_pose(
    found: Calibrations, path: Path, *, simulated: bool, accept_reason: str = ""
) -> Calibrations:
    """The same cell with another part in it.

    Raises:
        CalibrationError: unreadable, foreign or too poor.
    """
    model = _read(path, "part_pose", RigidCalibration)
    there = replace(
        found,
        part_pose=model,
        base_from_part=_pose(path, model, "base", "part"),
        files=found.files | {"part_pose": path},
        sha256=found.sha256 | {"part_pose": sha256_of(path)},
    )
    objections = [
        *of_file("part_pose", path, model, simulated=simulated),
        *(one for one in of_inputs(there, simulated=simulated) if one.path == path),
    ]
    others = [one for one in found.objections if one.name != "part_pose"]
    kept = {name: why for name, why in found.accepted.items() if name != "part_pose"}
    return replace(
        there,
        objections=(*others, *objections),
        accepted=kept | require_accepted(objections, accept_reason),
    )


def read_calibrations(path_of: Callable[[str], Path]) -> CalibrationModels:
    """Read the four files; nothing is judged.

    Args:
        path_of: where a file is, by its name in ``[calibration]``; may raise.

    Raises:
        CalibrationError: missing, unreadable, or not what they should be; all of it.
    """
    problems: list[CalibrationError] = []
    files: dict[str, Path] = {}

    def tried(name: str, model: type[_Model]) -> _Model | None:
        try:
            files[name] = path_of(name)
            return _read(files[name], name, model)
        except CalibrationError as error:
            problems.append(error)
            return None

    camera = tried("camera", CameraCalibration)
    lens_table = tried("lens_table", LensTableCalibration)
    hand_eye = tried("hand_eye", RigidCalibration)
    part_pose = tried("part_pose", RigidCalibration)
    if camera is None or lens_table is None or hand_eye is None or part_pose is None:
        raise _together(problems)
    return CalibrationModels(
        camera,
        lens_table,
        hand_eye,
        part_pose,
        _pose(files["hand_eye"], hand_eye, "tool", "camera"),
        _pose(files["part_pose"], part_pose, "base", "part"),
        files,
    )


def _together(problems: Sequence[CalibrationError]) -> CalibrationError:
    """Everything that is wrong, in one go; the first one's place in ``where``."""
    return CalibrationError(
        "\n".join(error.message for error in problems),
        hint="\n".join(dict.fromkeys(error.hint for error in problems if error.hint)),
        where=problems[0].where,
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
