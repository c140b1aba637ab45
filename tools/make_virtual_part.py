"""Write the part of the virtual cell: the paper's object as a binary STL file, mm."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from mvp.scene import paper_object

ROOT = Path(__file__).resolve().parents[1]
PART = ROOT / "cell_configs" / "virtual" / "parts" / "paper_object.stl"


def main(path: Path) -> None:
    mesh = paper_object()
    records = np.zeros(
        len(mesh.faces),
        dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("unused", "<u2")],
    )
    records["normal"] = mesh.normals
    records["corners"] = mesh.triangles_mm
    header = b"paper object, mm".ljust(80, b" ")
    count = np.array([len(records)], dtype="<u4").tobytes()
    path.write_bytes(header + count + records.tobytes())


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else PART)
