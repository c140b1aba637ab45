"""A scene on a machined part for planners: three edges of a notch of NIST CTC-01.

Stated for the comparison that this scene stands for: the part, three edges of one
notch, and that four candidates of ten see them. The three upper edges of the
rectangular notch at x = -150, y = 100-125 are chosen for that: their smallest sphere
has a radius of 43 mm and their region holds 0.46 of the workspace, a cube of 1.3 m
round them. Its facets number some 800 here against 466 there, so another notch or
another tessellation was meant; no bar rests on that number.
"""

from __future__ import annotations

import numpy as np

from mvp.cell.places import bundled_root
from mvp.constraints import enclosing_sphere
from mvp.geometry import Box, load_part
from mvp.scene import edge_feature
from mvp.testing.planning_scenes import HALF_MM, PlanningScene

PART = "nist_ctc_01_asme1_rd.stp"
_EDGES_MM = {
    "root": ((-182.5, 100.0, 0.0), (-117.5, 100.0, 0.0)),
    "left flank": ((-192.5, 110.0, 0.0), (-192.5, 125.0, 0.0)),
    "right flank": ((-107.5, 110.0, 0.0), (-107.5, 125.0, 0.0)),
}


def notch_scene() -> PlanningScene:
    """Three edges of the notch; the walls of the workspace count as facets."""
    mesh = load_part(bundled_root() / "virtual" / "parts" / PART).mesh
    edges = tuple(
        edge_feature(name, start, end, mesh) for name, (start, end) in _EDGES_MM.items()
    )
    ends = np.concatenate([edge.key_points_mm for edge in edges])
    centre, _ = enclosing_sphere(ends)
    return PlanningScene(mesh, edges, Box(centre - HALF_MM, centre + HALF_MM))
