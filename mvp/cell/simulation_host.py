"""Hosts the world and the simulators of a simulated cell, and ends them together."""

from __future__ import annotations

from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING

import numpy as np

from mvp.cell.durable import output_error
from mvp.cell.lock import cell_lock, remove_dead
from mvp.cell.plan_job import prepare
from mvp.cell.progress import Tell, unheard
from mvp.cell.simulation import (
    SimulatedDevice,
    Simulation,
    announcement,
    simulation_lock,
)
from mvp.cell.world_building import WorldBodies, build_simulators, build_world
from mvp.devices import DeviceContext, DrawsAhead, RealClock
from mvp.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from mvp.cell.loading import LoadedCell, LoadedTask
    from mvp.devices import Simulator


@contextmanager
def hosted(
    cell: LoadedCell, task: LoadedTask, tell: Tell = unheard
) -> Iterator[Simulation]:
    """Start world and simulators; yields where they listen, and ends all of it.

    Args:
        cell: with simulators.
        task: what stands in their world.
        tell: hears what takes time.

    Raises:
        UsageError: the cell has no simulators.
        DeviceError: one of them cannot start; those before it are ended.
    """
    if not cell.config.simulators.by_role:
        raise UsageError(
            f"{cell.config.name} has no [simulators]",
            hint="a virtual cell simulates its devices itself, a real cell has none",
            where=str(cell.source.path),
        )
    tell(f"loading {task.part_file.name}")
    setting = prepare(cell, task)
    bodies = WorldBodies(setting.scene.scene.part, setting.scene.fixtures_base)
    clock = RealClock()
    world = build_world(setting.cell, bodies, clock)
    context = DeviceContext(
        clock=clock,
        rng=np.random.default_rng(0),
        folder=cell.folder,
        world=world,
    )
    simulators = build_simulators(setting.cell, context)
    if isinstance(world, DrawsAhead):
        tell("drawing a first picture")
        world.draw_ahead()
    with ExitStack() as stack:
        devices = {}
        for role, one in simulators.items():
            tell(f"starting the far end of the {role}")
            devices[role] = _started(one, stack)
        yield Simulation(
            cell=cell.config.name, task=str(task.source.path), devices=devices
        )


def _started(simulator: Simulator, stack: ExitStack) -> SimulatedDevice:
    stack.callback(simulator.stop)
    table = dict(simulator.start())
    return SimulatedDevice.model_validate(
        {"table": table, "control_port": simulator.control_port}
    )


@contextmanager
def found_by_others(cell: LoadedCell, simulation: Simulation) -> Iterator[None]:
    """Let other commands use this simulation as long as it lives.

    Raises:
        RecordError: another simulation of this cell is running.
        OutputError: the announcement cannot be written.
    """
    remove_dead()
    place = announcement(cell.source.path)
    with cell_lock(simulation_lock(cell.source.path), run_id="simulate"):
        text = simulation.model_dump_json(by_alias=True)
        try:
            place.write_text(text, encoding="utf-8")
        except OSError as error:
            raise output_error(place, error) from error
        try:
            yield
        finally:
            place.unlink(missing_ok=True)
