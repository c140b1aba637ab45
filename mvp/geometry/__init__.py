"""Poses with checked frames, boxes, triangle meshes, CAD loading."""

from mvp.geometry.arrays import BoolArray, FloatArray, IntArray, as_points, unit
from mvp.geometry.box import Box
from mvp.geometry.convex import Facing, FeaturePiece
from mvp.geometry.edges import EdgeTable, edge_table
from mvp.geometry.mesh import TriangleMesh, concatenated
from mvp.geometry.patches import face_groups, planar_patches
from mvp.geometry.pose import Pose

__all__ = [
    "BoolArray",
    "Box",
    "EdgeTable",
    "Facing",
    "FeaturePiece",
    "FloatArray",
    "IntArray",
    "Pose",
    "TriangleMesh",
    "as_points",
    "concatenated",
    "edge_table",
    "face_groups",
    "planar_patches",
    "unit",
]
