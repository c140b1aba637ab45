"""The world of a simulated cell and the simulators in it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from mvp.cell.own_keys import naming_place, own_keys
from mvp.cell.truth import truth_of
from mvp.devices import WorldBelief, load_simulator, load_world

if TYPE_CHECKING:
    from mvp.cell.cell_config import SimulatorRef
    from mvp.cell.loading import LoadedCell
    from mvp.devices import Clock, DeviceContext, Role, Simulator
    from mvp.fileedge import FileModel
    from mvp.geometry import TriangleMesh


@dataclass(frozen=True, eq=False)
class WorldBodies:
    """What a simulated world is filled with: part (part frame), fixtures (base)."""

    part: TriangleMesh
    fixtures: tuple[TriangleMesh, ...]


def world_config(cell: LoadedCell) -> FileModel:
    """The world's own keys.

    Raises:
        ConfigError, PluginError: with file and line.
    """
    world = cell.config.world
    if world is None:
        raise ValueError("this cell has no world")
    with naming_place(cell, ("world", "kind")):
        kind = load_world(world.kind)
    return own_keys(cell, ("world",), world.options, kind.Config)


def build_world(
    cell: LoadedCell, bodies: WorldBodies | None, clock: Clock
) -> object | None:
    """The truth of a simulated cell; None for a real one.

    Raises:
        ConfigError, PluginError: with file and line.
        CalibrationError: the truth that the cell names cannot be read.
    """
    world = cell.config.world
    if world is None:
        return None
    if bodies is None:
        raise ValueError("a cell with a world needs the bodies to put into it")
    config = world_config(cell)
    return load_world(world.kind).from_config(config, _told(cell, bodies), clock=clock)


def simulator_config(
    cell: LoadedCell, role: Role, simulator: SimulatorRef
) -> FileModel:
    """A simulator's own keys.

    Raises:
        ConfigError, PluginError: with file and line.
    """
    with naming_place(cell, ("simulators", role, "kind")):
        kind = load_simulator(simulator.kind)
    return own_keys(cell, ("simulators", role), simulator.options, kind.Config)


def build_simulators(cell: LoadedCell, context: DeviceContext) -> dict[Role, Simulator]:
    """Every simulator of a cell, not yet started; no I/O.

    Raises:
        ConfigError, PluginError: with file and line.
    """
    return {
        role: load_simulator(one.kind).from_config(
            simulator_config(cell, role, one), context, name=role
        )
        for role, one in cell.config.simulators.by_role.items()
    }


def _told(cell: LoadedCell, bodies: WorldBodies) -> WorldBelief:
    """What the world is told: the cell's own belief, unless it names the truth."""
    found, light = truth_of(cell), cell.config.light
    reference = found.hand_eye.reference_d_mm
    return WorldBelief(
        part=bodies.part,
        fixtures=bodies.fixtures,
        arm_model=cell.config.kinematics.model,
        start_joints=tuple(float(j) for j in cell.home_joints),
        camera=found.camera,
        lens_table=found.lens_table,
        tool_from_camera=found.tool_from_camera,
        reference_d_mm=reference if reference is not None else 0.0,
        base_from_part=found.base_from_part,
        mounted_tube_mm=cell.config.optics.mounted_tube_mm,
        light=light.belief if light is not None else None,
        reference_f_mm=found.hand_eye.reference_f_mm,
    )
