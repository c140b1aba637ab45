"""What the virtual camera looks at: meshes with an albedo, planes with a print."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import cv2
import numpy as np

from mvp.geometry import Pose, TriangleMesh

if TYPE_CHECKING:
    from mvp.imaging.light import Float32Array


@dataclass(frozen=True, eq=False)
class PlanarTexture:
    """A print on a flat face.

    Attributes:
        albedo: (rows, columns) reflectance, 0 .. 1.
        mesh_from_texture: the print's frame: x along columns, y along rows, origin at
            the outer corner of texel (0, 0), z towards the reader or away from him.
        mm_per_texel: size of a texel.
    """

    albedo: Float32Array
    mesh_from_texture: Pose
    mm_per_texel: float

    def __post_init__(self) -> None:
        albedo = np.array(self.albedo, dtype=np.float32)
        if albedo.ndim != 2 or not self.mm_per_texel > 0:
            raise ValueError("a print is a 2-D picture with a positive texel size")
        object.__setattr__(self, "albedo", albedo)

    @cached_property
    def room_texels(self) -> Float32Array:
        """(rows, columns) how far, along rows and columns, the print is of one colour."""
        around = np.ones((3, 3), np.uint8)
        lowest, highest = (
            cv2.erode(self.albedo, around),
            cv2.dilate(self.albedo, around),
        )
        plain = (lowest == highest).astype(np.uint8)
        return np.asarray(cv2.distanceTransform(plain, cv2.DIST_C, 3), np.float32)


@dataclass(frozen=True, eq=False)
class RenderBody:
    """A body of the scene.

    Attributes:
        mesh: in its own frame, mm.
        albedo: diffuse reflectance.
        world_from_mesh: where it stands; None: the mesh is in the world frame.
        texture: a print on its faces that lie in the print's plane.
    """

    mesh: TriangleMesh
    albedo: float = 0.8
    world_from_mesh: Pose | None = None
    texture: PlanarTexture | None = None


def textured_plane(
    albedo: Float32Array,
    mm_per_texel: float,
    world_from_texture: Pose | None = None,
    *,
    name: str = "target",
) -> RenderBody:
    """A flat target exactly as large as its print, in the frame of the print.

    The print is seen from the side of negative z (x right, y down, as in a picture)
    and from behind alike.
    """
    rows, columns = np.asarray(albedo).shape
    width, height = columns * mm_per_texel, rows * mm_per_texel
    vertices = np.array(
        [[0, 0, 0], [0, height, 0], [width, height, 0], [width, 0, 0]], np.float64
    )
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    mesh = TriangleMesh(vertices, faces, np.zeros(2, np.int64), name)
    texture = PlanarTexture(albedo, Pose.identity("mesh", "texture"), mm_per_texel)
    return RenderBody(mesh, 1.0, world_from_texture, texture)
