"""A part, what stands round it, and what must be seen of it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from mvp.geometry import TriangleMesh, concatenated

if TYPE_CHECKING:
    from mvp.scene.features import Feature


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything in the part frame, mm.

    Attributes:
        part: the part that carries the features.
        fixtures: other bodies that can hide a feature.
        features: what must be seen, in the order of the task.
    """

    part: TriangleMesh
    fixtures: tuple[TriangleMesh, ...]
    features: tuple[Feature, ...]

    def __post_init__(self) -> None:
        ids = [feature.id for feature in self.features]
        if len(set(ids)) != len(ids):
            raise ValueError(f"feature ids must differ, got {ids}")

    @cached_property
    def occluders(self) -> TriangleMesh:
        """Part and fixtures as one soup."""
        return concatenated([self.part, *self.fixtures])

    def feature(self, id: str) -> Feature:
        """The feature of this id.

        Raises:
            KeyError: there is none.
        """
        for feature in self.features:
            if feature.id == id:
                return feature
        raise KeyError(id)

    def face_name(self, face_id: int) -> str:
        """How messages call a face of ``occluders``: "face 3 of fixture clamp".

        Faces are counted from 1 within their body.

        Raises:
            KeyError: the scene has no such face.
        """
        number = face_id
        for mesh in (self.part, *self.fixtures):
            count = int(mesh.face_ids.max(initial=-1)) + 1
            if 0 <= number < count:
                kind = "part" if mesh is self.part else f"fixture {mesh.name}"
                return f"face {number + 1} of {kind}"
            number -= count
        raise KeyError(face_id)
