"""Arm models by the name a cell file uses.

Another distribution adds one through an entry point of the group
``mvp_cell.arm_models`` whose target, called without arguments, gives the model. It is
looked up, and loaded, only when a cell asks for that name.
"""

from __future__ import annotations

import difflib
from dataclasses import replace
from importlib.metadata import EntryPoint, entry_points
from typing import TYPE_CHECKING, cast

import numpy as np

from mvp.errors import ConfigError, MvpCellError, PluginError
from mvp.kinematics.gantry import Gantry
from mvp.kinematics.model import ArmModel
from mvp.kinematics.ur import UR_FAMILY, UrArm
from mvp.kinematics.ur_calibration_file import read_ur_calibration

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import ArrayLike

    from mvp.geometry import FloatArray

GANTRY = "gantry_xyz_pan_tilt"
ARM_MODELS: tuple[str, ...] = (*UR_FAMILY, GANTRY)
PLUGINS = "mvp_cell.arm_models"
NEEDS_HEAD = (
    "A camera on three sliding axes has one viewing direction, and views are planned over "
    f"all directions: such a machine is not supported. Add a pan/tilt head ({GANTRY}), as "
    "the axes A and B of grblHAL, FluidNC or Marlin; GRBL itself has no further axes."
)


def arm_model_names() -> tuple[str, ...]:
    """Every model there is: our own, then those of other distributions."""
    return (*ARM_MODELS, *sorted({entry.name for entry in _plugged_in()}))


def arm_model(
    name: str,
    *,
    joint_low: ArrayLike | None = None,
    joint_high: ArrayLike | None = None,
    dh_calibration: Path | None = None,
) -> ArmModel:
    """The model called ``name``, with the maker's or the given joint limits.

    Args:
        name: one of ``arm_model_names()``.
        joint_low: (dof,) rad or mm, replaces the model's own.
        joint_high: (dof,) rad or mm, replaces the model's own.
        dh_calibration: file with the factory calibration of one robot.

    Raises:
        ConfigError: no such model, limits that make no sense, or a calibration that is
            not of such an arm.
        PluginError: the model of another distribution does not load.
    """
    if name not in ARM_MODELS:
        model: ArmModel = _load(_entry(name))
    else:
        model = Gantry() if name == GANTRY else UrArm.of(name)
    if dh_calibration is not None:
        model = _calibrated(model, dh_calibration)
    if joint_low is None and joint_high is None:
        return model
    return _limited(model, joint_low, joint_high)


def _limited(
    model: ArmModel, joint_low: ArrayLike | None, joint_high: ArrayLike | None
) -> ArmModel:
    """The same arm with other joint limits."""
    low = _limits(model, model.joint_low, joint_low)
    high = _limits(model, model.joint_high, joint_high)
    if not (low < high).all():
        raise ConfigError(
            f"{model.name}: every lower joint limit must be below the upper one"
        )
    if not hasattr(model, "__dataclass_fields__"):
        raise ConfigError(f"{model.name}: its joint limits cannot be replaced")
    return replace(cast("Gantry | UrArm", model), joint_low=low, joint_high=high)


def _plugged_in() -> list[EntryPoint]:
    return list(entry_points(group=PLUGINS))


def _entry(name: str) -> EntryPoint:
    """The one entry point with this name."""
    found = [entry for entry in _plugged_in() if entry.name == name]
    if len(found) == 1:
        return found[0]
    if found:
        raise PluginError(
            f"arm model {name!r} is installed more than once",
            hint="uninstall all but one of the distributions that bring it",
        )
    names = arm_model_names()
    if name.lower().endswith(("xyz", "cartesian")):
        raise ConfigError(f"unknown arm model {name!r}", hint=NEEDS_HEAD)
    close = difflib.get_close_matches(name, names, n=1)
    raise ConfigError(
        f"unknown arm model {name!r}",
        hint=f"did you mean {close[0]!r}?"
        if close
        else f"there are: {', '.join(names)}",
    )


def _load(entry: EntryPoint) -> ArmModel:
    """Make a model of another distribution, and see that it is one."""
    try:
        model = entry.load()()
    except MvpCellError:
        raise
    except Exception as error:
        raise PluginError(
            f"arm model {entry.name!r} does not load: {type(error).__name__}: {error}",
            hint=f"report it to the makers of {entry.value}",
        ) from error
    missing = sorted(n for n in _asked_of_a_model() if not hasattr(model, n))
    if missing:
        raise PluginError(
            f"arm model {entry.name!r} has no {', '.join(missing)}",
            hint="mvp.kinematics.ArmModel says what planning asks of a model",
        )
    return cast("ArmModel", model)


def _asked_of_a_model() -> set[str]:
    return {name for name in vars(ArmModel) if not name.startswith("_")}


def _calibrated(model: ArmModel, path: Path) -> UrArm:
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
