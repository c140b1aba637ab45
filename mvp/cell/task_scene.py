"""From a task's words to geometry: part, fixtures and features in the part frame."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from mvp.cell.task_config import (
    EdgeByCoordinates,
    FaceByCoordinates,
    FeatureByReference,
    HoleByCoordinates,
    PointByCoordinates,
    Resolution,
)
from mvp.errors import FeatureError, GeometryError
from mvp.geometry import (
    Box,
    LoadedPart,
    TriangleMesh,
    box_mesh,
    load_part,
)
from mvp.scene import (
    Scene,
    edge_feature,
    extract_features,
    face_feature,
    point_feature,
)

if TYPE_CHECKING:
    from mvp.cell.cell_config import FixtureConfig
    from mvp.cell.loading import LoadedCell, LoadedTask
    from mvp.scene import Feature, FeatureCatalogue

_HOLE_SLACK_MM = 0.1
_SAME_AXIS = 0.999

_AnyFeature: TypeAlias = (
    FeatureByReference
    | PointByCoordinates
    | EdgeByCoordinates
    | FaceByCoordinates
    | HoleByCoordinates
)


@dataclass(frozen=True, eq=False)
class TaskScene:
    """Everything geometric about a task.

    Attributes:
        scene: part, fixtures and features, part frame.
        part: the part as loaded, with units and healing report.
        requirements: smallest detail and its pixels, by feature id.
        fixtures_base: the fixtures again, base frame.
    """

    scene: Scene
    part: LoadedPart
    requirements: dict[str, Resolution]
    fixtures_base: tuple[TriangleMesh, ...]


def build_scene(cell: LoadedCell, task: LoadedTask) -> TaskScene:
    """Load and check all geometry of a task.

    Raises:
        GeometryError: a CAD file that cannot be used.
        FeatureError: a feature that is not on the part, or degenerate (file and line).
    """
    part = load_part(task.part_file, units=task.config.part.units)
    base_from_part = cell.calibrations.base_from_part
    fixtures = tuple(_fixture(cell, f) for f in cell.config.fixtures)
    moved = tuple(mesh.moved(base_from_part.inverse()) for mesh in fixtures)
    features = _features(task, part.mesh)
    requirements = {
        f.id: f.resolution or task.config.resolution for f in task.config.features
    }
    scene = Scene(part.mesh, moved, features, fixtures)
    return TaskScene(scene, part, requirements, fixtures)


def _fixture(cell: LoadedCell, fixture: FixtureConfig) -> TriangleMesh:
    """A fixture in the base frame."""
    if fixture.low_mm is not None and fixture.high_mm is not None:
        box = Box(np.array(fixture.low_mm), np.array(fixture.high_mm))
        return box_mesh(box, name=fixture.name)
    loaded = load_part(cell.fixture_files[fixture.name], units=fixture.units)
    mesh = loaded.mesh
    return TriangleMesh(mesh.vertices_mm, mesh.faces, mesh.face_ids, fixture.name)


def _features(task: LoadedTask, mesh: TriangleMesh) -> tuple[Feature, ...]:
    catalogue: FeatureCatalogue | None = None
    found, errors = [], []
    for place, config in enumerate(task.config.features):
        looked_up = isinstance(config, FeatureByReference | HoleByCoordinates)
        if looked_up and catalogue is None:
            catalogue = extract_features(mesh)
        try:
            found.append(_feature(config, mesh, catalogue))
        except (FeatureError, GeometryError) as error:
            where = task.source.where(("features", place))
            errors.append(
                FeatureError(f"{where}: {error.message}", hint=error.hint, where=where)
            )
    if errors:
        raise _together(errors)
    return tuple(found)


def _together(errors: list[FeatureError]) -> FeatureError:
    """Everything that is wrong, in one go; the first one's place in ``where``."""
    return FeatureError(
        "\n".join(error.message for error in errors),
        hint="\n".join(dict.fromkeys(error.hint for error in errors if error.hint)),
        where=errors[0].where,
    )


def _feature(
    config: _AnyFeature, mesh: TriangleMesh, catalogue: FeatureCatalogue | None
) -> Feature:
    if isinstance(config, PointByCoordinates):
        return point_feature(config.id, config.at_mm, mesh)
    if isinstance(config, EdgeByCoordinates):
        return edge_feature(config.id, config.from_mm, config.to_mm, mesh)
    if isinstance(config, FaceByCoordinates):
        holes = [np.array(ring) for ring in config.holes_mm]
        return face_feature(config.id, config.corners_mm, mesh, holes_mm=holes)
    if catalogue is None:
        raise ValueError("holes and references need the catalogue")
    if isinstance(config, HoleByCoordinates):
        return _hole(config, catalogue)
    return catalogue.feature(config.ref, id=config.id)


def _hole(config: HoleByCoordinates, catalogue: FeatureCatalogue) -> Feature:
    """The hole of the part whose rim is where the task says."""
    axis = np.array(config.axis) / np.linalg.norm(config.axis)
    best = min(
        catalogue.holes,
        key=lambda hole: float(np.linalg.norm(hole.centre_mm - config.centre_mm)),
        default=None,
    )
    if best is None:
        raise FeatureError(
            f"feature '{config.id}': the part has no round hole", where=config.id
        )
    off_mm = float(np.linalg.norm(best.centre_mm - config.centre_mm))
    differs = abs(best.diameter_mm - config.diameter_mm)
    allowed = _HOLE_SLACK_MM + best.polygon_error_mm
    if off_mm > allowed or differs > 2 * allowed or axis @ best.axis < _SAME_AXIS:
        centre = ", ".join(f"{v:.3f}" for v in best.centre_mm)
        raise FeatureError(
            f"feature '{config.id}': no such hole on the part",
            hint=f"the nearest one has its rim's centre at ({centre}) mm, diameter "
            f"{best.diameter_mm:.3f} mm; `mvp-cell features PART` lists all",
            where=config.id,
        )
    return replace(best, id=config.id)
