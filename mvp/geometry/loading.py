"""Read a part from a CAD or mesh file, in mm, healed, with a report."""

from __future__ import annotations

import hashlib
import io
import logging
import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from mvp.errors import GeometryError
from mvp.geometry.brep import ANGULAR_RAD, LINEAR_MM, tessellated
from mvp.geometry.healing import HealingReport, healed
from mvp.geometry.mesh import TriangleMesh
from mvp.geometry.patches import face_groups
from mvp.geometry.stl import read_stl, stl_triangle_count
from mvp.geometry.units import (
    MM_PER,
    Units,
    UnitsSource,
    noted_units,
    size_text,
    size_warnings,
    step_units,
)

if TYPE_CHECKING:
    from mvp.geometry.arrays import FloatArray, IntArray

_log = logging.getLogger(__name__)

_BREP: dict[str, Literal["step", "iges"]] = {
    ".step": "step",
    ".stp": "step",
    ".igs": "iges",
    ".iges": "iges",
}
_MESHES = (".stl", ".obj", ".ply", ".glb")
EXTENSIONS = (*_BREP, *_MESHES)
MAX_TRIANGLES = 2_000_000


@dataclass(frozen=True, eq=False)
class LoadedPart:
    """A part as the rest of the program uses it.

    Attributes:
        path: the file it came from.
        mesh: healed, mm.
        units: of the numbers in the file.
        units_source: ``"given"`` by the caller, declared in the ``"file"``, or
            ``"guessed"`` (mm).
        healing: what was repaired, and what is left.
        sha256: of the file's bytes, hex.
        warnings: what a person should check, such as a suspicious size.
    """

    path: Path
    mesh: TriangleMesh
    units: Units
    units_source: UnitsSource
    healing: HealingReport
    sha256: str
    warnings: tuple[str, ...] = ()

    @property
    def size_text(self) -> str:
        """The part's size in mm and inches."""
        return size_text(self.mesh.bounds)

    def lines(self) -> list[str]:
        """Size, units and healing in sentences, warnings last."""
        said = {
            "given": "as given",
            "file": "as the file says",
            "guessed": "a guess: the file does not say",
        }[self.units_source]
        size = f"size {self.size_text}; units {self.units}, {said}"
        return [size, *self.healing.lines(), *self.warnings]

    def to_json(self) -> dict[str, Any]:
        """Everything but the mesh, as plain data."""
        return {
            "file": self.path.name,
            "sha256": self.sha256,
            "units": self.units,
            "units_source": self.units_source,
            "low_mm": self.mesh.bounds.low_mm.tolist(),
            "high_mm": self.mesh.bounds.high_mm.tolist(),
            "size_mm": self.mesh.bounds.size_mm.tolist(),
            "healing": self.healing.to_json(),
            "warnings": list(self.warnings),
        }


def load_part(
    path: Path,
    *,
    units: Units | None = None,
    max_triangles: int = MAX_TRIANGLES,
    linear_mm: float = LINEAR_MM,
    angular_rad: float = ANGULAR_RAD,
) -> LoadedPart:
    """Read a STEP, IGES, STL, OBJ, PLY or GLB file.

    Args:
        path: the file; its extension tells the format.
        units: of the numbers in the file; overrides what the file says.
        max_triangles: a larger mesh is refused.
        linear_mm: largest distance of triangles from a curved B-rep face.
        angular_rad: largest angle between neighbouring facets of one.

    Raises:
        GeometryError: no such file, an unknown format, not a mesh, no triangles,
            coordinates that are not finite, or too many triangles.
    """
    path = Path(path)
    extension = _extension(path)
    content = _bytes(path)
    if extension in _BREP:
        kind = _BREP[extension]
        _require_brep(content, kind, path)
        raw = tessellated(
            content,
            file_type=kind,
            name=path.name,
            linear_mm=linear_mm,
            angular_rad=angular_rad,
        )
        stated = step_units(content)
        declared, scale = stated or "mm", 1.0
        source: UnitsSource = "file"
        if units is not None:
            scale, source = MM_PER[units] / MM_PER[declared], "given"
    else:
        raw = _mesh_file(content, extension, path, max_triangles)
        declared, source = _mesh_units(content, extension)
        stated = declared if source == "file" else None
        scale = MM_PER[units or declared]
        source = "given" if units is not None else source
    _require_sound(raw, path, max_triangles)
    part = _finished(raw, scale, path, content, units or declared, source)
    part = _warned(part, stated)
    _log.info("%s: %s", path.name, "; ".join(part.lines()))
    return part


def _warned(part: LoadedPart, stated: Units | None) -> LoadedPart:
    """The part with a warning when given units override what its file states."""
    if stated is None or part.units == stated:
        return part
    text = f"the file says {stated}; the given units, {part.units}, override it"
    return replace(part, warnings=(text, *part.warnings))


def _finished(
    raw: TriangleMesh,
    scale: float,
    path: Path,
    content: bytes,
    units: Units,
    source: UnitsSource,
) -> LoadedPart:
    ids_known = path.suffix.lower() in _BREP
    scaled = TriangleMesh(raw.vertices_mm * scale, raw.faces, raw.face_ids, path.stem)
    mesh, report = healed(scaled)
    if not len(mesh.faces):
        raise _empty(path)
    if not ids_known:
        mesh = TriangleMesh(mesh.vertices_mm, mesh.faces, face_groups(mesh), mesh.name)
    return LoadedPart(
        path,
        mesh,
        units,
        source,
        report,
        hashlib.sha256(content).hexdigest(),
        size_warnings(mesh.bounds, units, source),
    )


def _extension(path: Path) -> str:
    extension = path.suffix.lower()
    if extension not in EXTENSIONS:
        raise GeometryError(
            f"{path}: unknown kind of file '{extension}'",
            hint="give one of " + ", ".join(EXTENSIONS),
            where=str(path),
        )
    return extension


def _bytes(path: Path) -> bytes:
    try:
        content = path.read_bytes()
    except FileNotFoundError as error:
        raise GeometryError(
            f"{path}: no such file",
            hint="check the path; in a task it is relative to the task file",
            where=str(path),
        ) from error
    except OSError as error:
        raise GeometryError(
            f"{path}: cannot be read ({error.strerror or error})",
            hint="give a CAD file that you may read",
            where=str(path),
        ) from error
    if not content.strip():
        raise _empty(path)
    return content


def _empty(path: Path) -> GeometryError:
    return GeometryError(
        f"{path}: the file holds no triangle with an area",
        hint="export the part again; check that it is not empty, nor in the wrong units",
        where=str(path),
    )


def _require_brep(content: bytes, kind: Literal["step", "iges"], path: Path) -> None:
    if kind == "step" and b"ISO-10303-21" not in content[:4096]:
        raise GeometryError(
            f"{path}: not a STEP file: it does not begin with ISO-10303-21",
            hint="export the part as STEP AP203, AP214 or AP242",
            where=str(path),
        )


def _mesh_units(content: bytes, extension: str) -> tuple[Units, UnitsSource]:
    if extension == ".glb":
        return "m", "file"
    noted = noted_units(content[:2000])
    return ("mm", "guessed") if noted is None else (noted, "file")


def _mesh_file(
    content: bytes, extension: str, path: Path, max_triangles: int
) -> TriangleMesh:
    """Triangles in the file's own unit."""
    if extension == ".stl":
        _limit(stl_triangle_count(content) or 0, path, max_triangles)
        corners = read_stl(content, name=str(path))
        faces = np.arange(3 * len(corners)).reshape(-1, 3)
        return _plain(corners.reshape(-1, 3), faces, path)
    return _plain(*_by_trimesh(content, extension, path), path)


def _by_trimesh(
    content: bytes, extension: str, path: Path
) -> tuple[FloatArray, IntArray]:
    import trimesh

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            loaded = trimesh.load_scene(
                io.BytesIO(content),
                file_type=extension[1:],
                process=False,
                maintain_order=True,
            ).to_mesh()
        vertices = np.asarray(loaded.vertices, dtype=np.float64).reshape(-1, 3)
        faces = np.asarray(loaded.faces, dtype=np.int64).reshape(-1, 3)
    except Exception as error:
        raise GeometryError(
            f"{path}: not a readable {extension[1:].upper()} mesh ({error})",
            hint="export the part again, as triangles",
            where=str(path),
        ) from error
    if len(faces) and (faces.min() < 0 or faces.max() >= len(vertices)):
        raise GeometryError(
            f"{path}: triangles name vertices that are not in the file",
            hint="export the part again",
            where=str(path),
        )
    return vertices, faces


def _plain(vertices: FloatArray, faces: IntArray, path: Path) -> TriangleMesh:
    """A mesh in the file's own unit, after a check that its numbers are finite."""
    used = np.unique(faces)
    if not np.isfinite(vertices[used]).all():
        count = int((~np.isfinite(vertices[used]).all(axis=1)).sum())
        raise GeometryError(
            f"{path}: {count} vertices are not finite (NaN or infinite)",
            hint="repair the mesh in the program that wrote it",
            where=str(path),
        )
    vertices = np.nan_to_num(vertices, nan=0.0, posinf=0.0, neginf=0.0)
    ids = np.zeros(len(faces), dtype=np.int64)
    return TriangleMesh(vertices, faces, ids, path.stem)


def _require_sound(mesh: TriangleMesh, path: Path, max_triangles: int) -> None:
    if not len(mesh.faces):
        raise _empty(path)
    _limit(len(mesh.faces), path, max_triangles)


def _limit(count: int, path: Path, max_triangles: int) -> None:
    if count > max_triangles:
        raise GeometryError(
            f"{path}: {count} triangles are more than the limit of {max_triangles}",
            hint="export the part with a coarser tolerance, or only the region of the "
            "features",
            where=str(path),
        )
