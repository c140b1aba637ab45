"""Poses with checked frames, boxes, triangle meshes, CAD loading."""

from mvp.geometry.arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    as_points,
    plane_axes,
    unit,
)
from mvp.geometry.box import Box
from mvp.geometry.convex import Facing, FeaturePiece
from mvp.geometry.edges import EdgeTable, edge_table
from mvp.geometry.healing import HealingReport, healed
from mvp.geometry.loading import EXTENSIONS, LoadedPart, load_part
from mvp.geometry.mesh import TriangleMesh, box_mesh, concatenated
from mvp.geometry.patches import face_groups, planar_patches
from mvp.geometry.pose import Pose
from mvp.geometry.sobol import sobol_points
from mvp.geometry.stl import write_stl
from mvp.geometry.units import MM_PER, Units, UnitsSource

__all__ = [
    "EXTENSIONS",
    "MM_PER",
    "BoolArray",
    "Box",
    "EdgeTable",
    "Facing",
    "FeaturePiece",
    "FloatArray",
    "HealingReport",
    "IntArray",
    "LoadedPart",
    "Pose",
    "TriangleMesh",
    "Units",
    "UnitsSource",
    "as_points",
    "box_mesh",
    "concatenated",
    "edge_table",
    "face_groups",
    "healed",
    "load_part",
    "planar_patches",
    "plane_axes",
    "sobol_points",
    "unit",
    "write_stl",
]
