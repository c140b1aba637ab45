"""Arm models by the name a cell file uses."""

from __future__ import annotations

import difflib
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from mvp.errors import ConfigError
from mvp.kinematics.gantry import Gantry
from mvp.kinematics.ur import UR_FAMILY, UrArm
from mvp.kinematics.ur_calibration_file import read_ur_calibration

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import ArrayLike

    from mvp.geometry import FloatArray
    from mvp.kinematics.model import ArmModel

GANTRY = "gantry_xyz_pan_tilt"
ARM_MODELS: tuple[str, ...] = (*UR_FAMILY, GANTRY)


def arm_model(
    name: str,
    *,
    joint_low: ArrayLike | None = None,
    joint_high: ArrayLike | None = None,
    dh_calibration: Path | None = None,
) -> ArmModel:
    """The model called ``name``, with the maker's or the given joint limits.

    Args:
        name: one of ``ARM_MODELS``.
        joint_low: (dof,) rad or mm, replaces the model's own.
        joint_high: (dof,) rad or mm, replaces the model's own.
        dh_calibration: file with the factory calibration of one robot.

    Raises:
        ConfigError: no such model, limits that make no sense, or a calibration that is
            not of such an arm.
    """
    if name not in ARM_MODELS:
        close = difflib.get_close_matches(name, ARM_MODELS, n=1)
        hint = f"did you mean {close[0]!r}?" if close else ""
        raise ConfigError(
            f"unknown arm model {name!r}",
            hint=hint or f"there are: {', '.join(ARM_MODELS)}",
        )
    model = Gantry() if name == GANTRY else UrArm.of(name)
    if dh_calibration is not None:
        model = _calibrated(model, dh_calibration)
    low = _limits(model, model.joint_low, joint_low)
    high = _limits(model, model.joint_high, joint_high)
    if not (low < high).all():
        raise ConfigError(
            f"{name}: every lower joint limit must be below the upper one"
        )
    return replace(model, joint_low=low, joint_high=high)


def _calibrated(model: Gantry | UrArm, path: Path) -> UrArm:
    """The arm with the axes of one robot."""
    if not isinstance(model, UrArm):
        raise ConfigError(
            f"{path}: a {model.name} has no factory calibration",
            hint="remove dh_calibration",
            where=str(path),
        )
    found = read_ur_calibration(path, model.geometry, model.name)
    return replace(model, calibration=found)


def _limits(model: ArmModel, own: FloatArray, given: ArrayLike | None) -> FloatArray:
    """The given limits checked, or the model's own."""
    if given is None:
        return own
    limits = np.asarray(given, dtype=np.float64)
    if limits.shape != (model.dof,) or not np.isfinite(limits).all():
        raise ConfigError(f"{model.name} needs {model.dof} finite joint limits")
    return limits
