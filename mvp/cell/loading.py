"""A cell and a task as loaded from their files, hashed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from mvp.cell.calibrations import Calibrations, load_calibrations, with_part_pose
from mvp.cell.cell_config import CellConfig
from mvp.cell.own_keys import naming_place
from mvp.cell.places import find_cell, find_task, home_of, inside, sha256_of
from mvp.cell.task_config import TaskConfig
from mvp.cell.toml_file import TomlFile, read_toml, validated
from mvp.errors import ConfigError
from mvp.kinematics import arm_model

if TYPE_CHECKING:
    from pathlib import Path

    from mvp.geometry import FloatArray
    from mvp.kinematics import ArmModel


@dataclass(frozen=True, eq=False)
class LoadedCell:
    """A configuration, its calibration, and where they came from.

    Attributes:
        source: the file with its lines, for messages.
        fixture_files: CAD files of the fixtures, by fixture name.
        sha256: over the cell file, every fixture file and the arm's own calibration.
        dh_file: the factory calibration of the arm.
    """

    config: CellConfig
    source: TomlFile
    calibrations: Calibrations
    fixture_files: dict[str, Path]
    sha256: str
    accept_calibration: str = ""
    dh_file: Path | None = None

    def holding(self, task: LoadedTask) -> LoadedCell:
        """The cell with the task's part where the task says it lies.

        Raises:
            CalibrationError: the task's part pose cannot be used.
        """
        if task.pose_file is None:
            return self
        calibrations = with_part_pose(
            self.calibrations,
            task.pose_file,
            simulated=self.config.simulated,
            accept_reason=self.accept_calibration,
        )
        return replace(self, calibrations=calibrations)

    @property
    def folder(self) -> Path:
        """Where relative paths start."""
        return self.source.path.parent

    @cached_property
    def arm(self) -> ArmModel:
        """The kinematic model.

        Raises:
            ConfigError, PluginError: unknown, or it does not load; with file and line.
        """
        name = self.config.kinematics.model
        try:
            with naming_place(self, ("kinematics", "model")):
                return arm_model(name, dh_calibration=self.dh_file)
        except ConfigError as error:
            key = "dh_calibration" if error.where else "model"
            raise self.source.error(
                ("kinematics", key), error.message, error.hint
            ) from error

    @cached_property
    def home_joints(self) -> FloatArray:
        """(dof,) rad or mm.

        Raises:
            ConfigError: as many values as axes are needed, inside their limits.
        """
        given = self.config.kinematics.home_joints_deg
        arm = self.arm
        where = ("kinematics", "home_joints_deg")
        if len(given) != arm.dof:
            raise self.source.error(
                where, f"{arm.name} needs {arm.dof} values, not {len(given)}"
            )
        scale = [np.pi / 180 if unit == "rad" else 1.0 for unit in arm.joint_units]
        home = np.array(given, dtype=np.float64) * scale
        outside = (home < arm.joint_low) | (home > arm.joint_high)
        if outside.any():
            axis = arm.joint_names[int(np.argmax(outside))]
            raise self.source.error(where, f"{axis} is outside its limits")
        return home

    @cached_property
    def joint_margin(self) -> FloatArray:
        """(dof,) slack asked of every limit, rad; 1 mm per deg for sliding axes."""
        margin_deg = self.config.kinematics.joint_margin_deg
        units = self.arm.joint_units
        return np.array(
            [np.radians(margin_deg) if u == "rad" else margin_deg for u in units]
        )


@dataclass(frozen=True, eq=False)
class LoadedTask:
    """A task, and where it came from."""

    config: TaskConfig
    source: TomlFile
    part_file: Path
    sha256: str
    pose_file: Path | None = None


def load_cell(
    cell: str,
    *,
    accept_calibration: str = "",
    finds_part: bool = False,
    replaces: str = "",
) -> LoadedCell:
    """Load a cell by path or bundled name, with its calibration.

    Args:
        cell: path or name.
        accept_calibration: why a person accepts what would be refused.
        finds_part: the part's pose is only where to begin to look for it.
        replaces: the calibration that is about to be replaced, and refused by nothing.

    Raises:
        UsageError: no such cell.
        ConfigError: a wrong key or value, with file and line.
        CalibrationError: missing, foreign or too poor.
    """
    source, config = read_cell(cell)
    files = {
        f.name: inside(
            source.path.parent,
            source.path.parent,
            f.file,
            f"{source.where(('fixtures', i, 'file'))}: fixtures[{i}].file",
        )
        for i, f in enumerate(config.fixtures)
        if f.file is not None
    }
    calibrations = load_calibrations(
        config.calibration,
        source.path,
        simulated=config.simulated,
        tubes_mm=[config.optics.mounted_tube_mm, *config.optics.extension_tubes_mm],
        accept_reason=accept_calibration,
        finds_part=finds_part,
        replaces=replaces,
    )
    dh_file = _dh_file(source, config)
    own = [dh_file] if dh_file is not None else []
    sha256 = sha256_of(source.path, *files.values(), *own)
    loaded = LoadedCell(
        config, source, calibrations, files, sha256, accept_calibration, dh_file
    )
    _ = loaded.home_joints  # a wrong arm model or home is an error of the file
    return loaded


def _dh_file(source: TomlFile, config: CellConfig) -> Path | None:
    """The factory calibration of the arm, where the cell names one."""
    name = config.kinematics.dh_calibration
    if name is None:
        return None
    where = source.where(("kinematics", "dh_calibration"))
    home = source.path.parent
    return inside(home, home, name, f"{where}: kinematics.dh_calibration")


def read_cell(cell: str) -> tuple[TomlFile, CellConfig]:
    """Only the cell file itself.

    Raises:
        UsageError, ConfigError: as for ``load_cell``.
    """
    source = read_toml(find_cell(cell))
    _check_version(source)
    return source, validated(source, CellConfig)


def load_task(cell: LoadedCell, task: str | None) -> LoadedTask:
    """Load the task of ``--task``, or the cell's default.

    Raises:
        UsageError: no such task.
        ConfigError: a wrong key or value, with file and line.
    """
    path = find_task(cell.source.path, cell.config.default_task, task)
    source = read_toml(path)
    _check_version(source)
    config = validated(source, TaskConfig)
    _check_ids(source, [feature.id for feature in config.features])
    where = f"{source.where(('part', 'file'))}: part.file"
    part = inside(home_of(path), path.parent, config.part.file, where)
    pose = None
    if config.part.pose is not None:
        where = f"{source.where(('part', 'pose'))}: part.pose"
        pose = inside(home_of(path), path.parent, config.part.pose, where)
    return LoadedTask(config, source, part, sha256_of(path), pose)


def _check_ids(source: TomlFile, ids: list[str]) -> None:
    for place, name in enumerate(ids):
        if name in ids[:place]:
            first = source.where(("features", ids.index(name), "id"))
            raise source.error(
                ("features", place, "id"),
                f'two features are called "{name}"; the other one is at {first}',
                hint="give one of them another id",
            )


def _check_version(source: TomlFile) -> None:
    version = source.data.get("schema_version")
    if isinstance(version, int) and version != 1:
        raise ConfigError(
            f"{source.where(('schema_version',))}: schema_version {version} is not "
            "understood by this program, which knows 1",
            hint="update mvp-cell, or start from `mvp-cell init DIR`",
            where=source.where(("schema_version",)),
        )
