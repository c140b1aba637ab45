"""Read the factory calibration of a robot from any of three kinds of file.

======================  =================================================================
``calibration.conf``    of the controller: differences to the nominal values, m and rad
``.yaml``, ``.yml``     kinematics as the ROS driver extracts them: joint placements, m
``.toml``               ``[dh]`` with theta_rad, a_mm, d_mm, alpha_rad, six values each
======================  =================================================================
"""

from __future__ import annotations

import configparser
import json
import tomllib
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field, ValidationError

from mvp.errors import ConfigError
from mvp.fileedge import FileModel
from mvp.kinematics.ur_calibration import AXES, FARTHEST_MM, UrCalibration

if TYPE_CHECKING:
    from pathlib import Path

    from mvp.geometry import FloatArray
    from mvp.kinematics.ur import UrGeometry

_MM = 1000.0
_Six = Annotated[list[float], Field(min_length=AXES, max_length=AXES)]
_LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")


class DhTable(FileModel):
    """Denavit-Hartenberg values of one robot, whole, not differences."""

    theta_rad: _Six
    a_mm: _Six
    d_mm: _Six
    alpha_rad: _Six


class DhFile(FileModel):
    """The project's own file."""

    schema_version: int = Field(ge=1, le=1)
    model: str = ""
    serial: str = ""
    dh: DhTable


def read_ur_calibration(path: Path, geometry: UrGeometry, model: str) -> UrCalibration:
    """The calibrated kinematics in a file, checked to be of such an arm.

    Args:
        path: one of the three kinds, by its ending.
        geometry: nominal lengths of the arm.
        model: its name, for messages.

    Raises:
        ConfigError: unreadable, or of another arm.
    """
    try:
        text = path.read_text(encoding="utf-8")
        found = _parse(text, path.suffix.lower(), geometry, model)
    except ConfigError:
        raise
    except (OSError, ValueError, KeyError, configparser.Error) as error:
        raise ConfigError(
            f"{path}: no factory calibration of a robot ({error})",
            hint="give the controller's calibration.conf, the yaml file that the ROS "
            "driver extracts, or a TOML file with [dh]",
            where=str(path),
        ) from error
    _require_close(found, geometry, model, path)
    return found


def nominal_dh(geometry: UrGeometry) -> DhTable:
    """The maker's nominal table."""
    g, half = geometry, np.pi / 2
    return DhTable(
        theta_rad=[0.0] * AXES,
        a_mm=[0, g.a2, g.a3, 0, 0, 0],
        d_mm=[g.d1, 0, 0, g.d4, g.d5, g.d6],
        alpha_rad=[half, 0, 0, half, -half, 0],
    )


def _parse(text: str, kind: str, geometry: UrGeometry, model: str) -> UrCalibration:
    if kind == ".conf":
        return _from_table(_conf_table(text, geometry))
    if kind in (".yaml", ".yml"):
        return UrCalibration.from_links(*_yaml_links(text))
    if kind != ".toml":
        raise ValueError(f"an ending that is not known: {kind!r}")
    try:
        file = DhFile.model_validate(tomllib.loads(text))
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        raise ValueError(f"{place}: {first['msg']}") from error
    if file.model and file.model != model:
        raise ValueError(f"it is of a {file.model}, not of a {model}")
    return _from_table(file.dh)


def _from_table(table: DhTable) -> UrCalibration:
    return UrCalibration.from_dh(
        theta_rad=np.array(table.theta_rad),
        a_mm=np.array(table.a_mm),
        d_mm=np.array(table.d_mm),
        alpha_rad=np.array(table.alpha_rad),
    )


def _conf_table(text: str, geometry: UrGeometry) -> DhTable:
    """Nominal values plus the differences of ``[mounting]``."""
    parser = configparser.ConfigParser(strict=False, inline_comment_prefixes=("#",))
    parser.read_string(text)
    section = parser["mounting"]
    nominal = nominal_dh(geometry)
    delta = {
        name: json.loads(section[f"delta_{name}"])
        for name in ("theta", "a", "d", "alpha")
    }
    return DhTable(
        theta_rad=_sum(nominal.theta_rad, delta["theta"]),
        a_mm=_sum(nominal.a_mm, [_MM * v for v in delta["a"]]),
        d_mm=_sum(nominal.d_mm, [_MM * v for v in delta["d"]]),
        alpha_rad=_sum(nominal.alpha_rad, delta["alpha"]),
    )


def _sum(nominal: list[float], delta: list[float]) -> list[float]:
    return [a + b for a, b in zip(nominal, delta, strict=True)]


def _yaml_links(text: str) -> tuple[FloatArray, FloatArray]:
    """Placements (6, 3), mm, and roll, pitch, yaw (6, 3) of the six joints.

    Only the plain ``name: number`` lines that such a file consists of are understood.
    """
    values: dict[str, dict[str, float]] = {}
    link = ""
    for line in text.splitlines():
        name, colon, value = line.split("#")[0].partition(":")
        if not colon:
            continue
        if not value.strip():
            link = name.strip()
        elif link in _LINKS and name.strip() != "hash":
            values.setdefault(link, {})[name.strip()] = float(value)
    xyz = [[_MM * values[name][key] for key in ("x", "y", "z")] for name in _LINKS]
    rpy = [[values[name][key] for key in ("roll", "pitch", "yaw")] for name in _LINKS]
    return np.array(xyz), np.array(rpy)


def _require_close(
    found: UrCalibration, geometry: UrGeometry, model: str, path: Path
) -> None:
    """A calibration never moves the flange far from its nominal place."""
    joints = np.random.default_rng(0).uniform(-np.pi, np.pi, (50, AXES))
    if not np.isfinite(found.fixed).all():
        raise ConfigError(f"{path}: a value is no number", where=str(path))
    _, here = found.forward(joints)
    _, nominal = _from_table(nominal_dh(geometry)).forward(joints)
    off_mm = float(np.linalg.norm(here - nominal, axis=1).max())
    if off_mm > FARTHEST_MM:
        raise ConfigError(
            f"{path}: this calibration puts the flange up to {off_mm:.0f} mm away from "
            f"where a {model} has it",
            hint="it belongs to another kind of arm, or lengths are in other units",
            where=str(path),
        )
