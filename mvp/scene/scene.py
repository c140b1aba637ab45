"""A part, what stands round it, and what must be seen of it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from mvp.geometry import TriangleMesh, concatenated
from mvp.scene.face_names import face_by_place, listed_faces

if TYPE_CHECKING:
    from mvp.scene.features import Feature


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything in the part frame, mm.

    Attributes:
        part: the part that carries the features.
        fixtures: other bodies that can hide a feature.
        features: what must be seen, in the order of the task.
        fixtures_as_drawn: the fixtures in the frame of their own files, in which their
            faces are counted; ``fixtures`` if left out.
    """

    part: TriangleMesh
    fixtures: tuple[TriangleMesh, ...]
    features: tuple[Feature, ...]
    fixtures_as_drawn: tuple[TriangleMesh, ...] = ()

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
        """How messages call a face of ``occluders``: "face F3 of fixture clamp".

        A planar face has the id under which ``mvp-cell features`` lists it; any other
        is told by a point on it, in the frame of its body's file.

        Raises:
            KeyError: the scene has no such face.
        """
        number = face_id
        for body, mesh, listed in self._bodies:
            count = int(mesh.face_ids.max(initial=-1)) + 1
            if 0 <= number < count:
                known = listed.get(number)
                name = f"face {known}" if known else face_by_place(mesh, number)
                return f"{name} of {body}"
            number -= count
        raise KeyError(face_id)

    @cached_property
    def _bodies(self) -> tuple[tuple[str, TriangleMesh, dict[int, str]], ...]:
        """What each body is called, as its file has it, and its listed faces."""
        fixtures = self.fixtures_as_drawn or self.fixtures
        named = [("part", self.part), *((f"fixture {m.name}", m) for m in fixtures)]
        return tuple((name, mesh, listed_faces(mesh)) for name, mesh in named)
