"""STL, both kinds, without loss of what the file says."""

from __future__ import annotations

import re
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np

from mvp.errors import GeometryError, OutputError

if TYPE_CHECKING:
    from pathlib import Path

    from mvp.geometry.arrays import FloatArray
    from mvp.geometry.mesh import TriangleMesh

_HEADER, _RECORD = 84, 50
_VERTEX = re.compile(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)", re.IGNORECASE)


def stl_triangle_count(content: bytes) -> int | None:
    """Number of triangles that a binary STL announces, None when it is not binary."""
    if len(content) < _HEADER:
        return None
    count = int(np.frombuffer(content, "<u4", count=1, offset=80)[0])
    exact = len(content) == _HEADER + _RECORD * count
    text = content.lstrip()[:5].lower() == b"solid" and b"vertex" in content[:4096]
    return count if exact or not text else None


def read_stl(content: bytes, *, name: str) -> FloatArray:
    """Corner points (m, 3, 3) in the file's own unit.

    Raises:
        GeometryError: cut short, or no STL.
    """
    count = stl_triangle_count(content)
    if count is None:
        return _read_text(content, name)
    if len(content) < _HEADER + _RECORD * count:
        raise GeometryError(
            f"{name}: not an STL file, or cut short: {count} triangles announced, "
            f"{(len(content) - _HEADER) // _RECORD} there",
            hint="export or copy the file again",
            where=name,
        )
    record = np.dtype(
        [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")]
    )
    table = np.frombuffer(content, record, count=count, offset=_HEADER)
    return table["corners"].astype(np.float64)


def _read_text(content: bytes, name: str) -> FloatArray:
    found = _VERTEX.findall(content)
    if content.lstrip()[:5].lower() != b"solid" or len(found) % 3:
        raise GeometryError(
            f"{name}: not an STL file",
            hint="check that the file is a mesh; STEP files end in .step or .stp",
            where=name,
        )
    try:
        return np.array(found, dtype=object).astype(np.float64).reshape(-1, 3, 3)
    except ValueError as error:
        raise GeometryError(
            f"{name}: a coordinate is not a number ({error})",
            hint="export the file again",
            where=name,
        ) from error


def write_stl(mesh: TriangleMesh, path: Path) -> None:
    """Write a text STL in mm with all digits, whole or not at all.

    Raises:
        OutputError: the folder or the disk does not take it.
    """
    lines = [f"solid {mesh.name} units=mm"]
    for normal, corners in zip(mesh.normals, mesh.triangles_mm, strict=True):
        lines.append("facet normal " + _numbers(normal))
        lines.append(" outer loop")
        lines += ["  vertex " + _numbers(corner) for corner in corners]
        lines += [" endloop", "endfacet"]
    lines.append(f"endsolid {mesh.name}\n")
    draft = path.with_name(f".{path.name}.part")
    try:
        # The name of a mesh may hold letters that STL does not know.
        draft.write_bytes("\n".join(lines).encode("ascii", "replace"))
        draft.replace(path)
    except OSError as error:
        with suppress(OSError):
            draft.unlink(missing_ok=True)
        raise OutputError(
            f"cannot write {path}: {error.strerror or error}",
            hint="check that the folder exists and is writable",
            where=str(path),
        ) from error


def _numbers(values: FloatArray) -> str:
    return " ".join(repr(float(value) + 0.0) for value in values)
