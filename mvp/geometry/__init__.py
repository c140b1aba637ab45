"""Poses with checked frames, boxes, triangle meshes, CAD loading."""

from mvp.geometry.arrays import BoolArray, FloatArray, IntArray, as_points, unit
from mvp.geometry.box import Box
from mvp.geometry.convex import Facing, FeaturePiece
from mvp.geometry.mesh import TriangleMesh, concatenated
from mvp.geometry.pose import Pose

__all__ = [
    "BoolArray",
    "Box",
    "Facing",
    "FeaturePiece",
    "FloatArray",
    "IntArray",
    "Pose",
    "TriangleMesh",
    "as_points",
    "concatenated",
    "unit",
]
