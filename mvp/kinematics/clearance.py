"""How far arm, camera and lens stay from the part, fixtures, keep-outs and themselves.

Distances are exact at a configuration and signed: negative when bodies overlap (as deep
as the capsule's radius, and deeper inside a solid).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from mvp.geometry import FloatArray, IntArray, TriangleMesh, box_mesh
from mvp.kinematics.capsule import Capsule, Capsules, carried
from mvp.kinematics.distance import TriangleBlocks, segment_segment

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.geometry import BoolArray, Box
    from mvp.kinematics.model import ArmModel

FAR_MM = 250.0


@dataclass(frozen=True, eq=False)
class Obstacle:
    """Something that stands in the cell, base frame.

    Attributes:
        name: how messages call it.
        mesh: triangles; the inside of a closed mesh counts as solid.
    """

    name: str
    mesh: TriangleMesh

    @cached_property
    def blocks(self) -> TriangleBlocks:
        """The triangles, ready for distances."""
        return TriangleBlocks.of(self.mesh)

    def distance(self, p: FloatArray, q: FloatArray, far_mm: float) -> FloatArray:
        """Signed distance (S,) of segments; ``far_mm`` when farther."""
        outside = self.blocks.distance(p, q, far_mm)
        suspect = np.flatnonzero(self.mesh.bounds.contains(p) & (outside > 0))
        if len(suspect):
            # A mesh with all its faces turned inwards is the same solid.
            inside = suspect[np.abs(self.blocks.winding(p[suspect])) > 0.5]
            outside[inside] *= -1.0
        return outside


@dataclass(frozen=True)
class Nearest:
    """The closest pair of bodies at one configuration.

    Attributes:
        distance_mm: between their surfaces; negative when they overlap.
        body: link, camera or lens.
        other: obstacle or link.
    """

    distance_mm: float
    body: str
    other: str


@dataclass(frozen=True, eq=False)
class Pairs:
    """Distances (M, P) mm of P pairs of bodies in M configurations.

    ``levers``: (P, dof) how much one unit of an axis can change each distance.
    """

    distance_mm: FloatArray
    names: tuple[tuple[str, str], ...]
    levers: FloatArray

    def nearest(self, index: int = 0) -> Nearest:
        """The closest pair of one configuration."""
        pair = int(np.argmin(self.distance_mm[index]))
        return Nearest(float(self.distance_mm[index, pair]), *self.names[pair])


@dataclass(frozen=True, eq=False)
class CellBodies:
    """Everything that moves and everything that stands in the cell.

    Attributes:
        model: the arm.
        tool_bodies: capsules fixed to the flange, tool frame (camera, lens, light).
        obstacles: part, fixtures, keep-outs, base frame.
        far_mm: distances are not followed beyond this.
    """

    model: ArmModel
    tool_bodies: tuple[Capsule, ...]
    obstacles: tuple[Obstacle, ...]
    far_mm: float = FAR_MM

    def moving(self, joints: FloatArray) -> Capsules:
        """Links and tool bodies of M configurations, base frame."""
        links = self.model.links_batch(joints)
        rotation, flange = self.model.forward_batch(joints)
        return links.joined(carried(self.tool_bodies, rotation, flange))

    @cached_property
    def levers(self) -> FloatArray:
        """(k, dof) how far one unit of an axis moves each link and tool body."""
        table = self.model.levers_mm
        turning = np.array([u == "rad" for u in self.model.joint_units], np.float64)
        reach = [
            max(np.linalg.norm(b.start_mm), np.linalg.norm(b.end_mm))
            for b in self.tool_bodies
        ]
        tools = [table[-1] + turning * r for r in reach]
        return np.concatenate([table[:-1], np.reshape(tools, (-1, self.model.dof))])

    def pairs(self, joints: FloatArray) -> Pairs:
        """Distance of every pair that can touch, in M configurations (M, dof)."""
        bodies = self.moving(np.atleast_2d(joints))
        outer, outer_names, outer_levers = self.to_obstacles(bodies)
        own, own_names, own_levers = self._to_itself(bodies)
        return Pairs(
            np.concatenate([outer, own], axis=1),
            outer_names + own_names,
            np.concatenate([outer_levers, own_levers]),
        )

    def nearest(self, joints: FloatArray) -> Nearest:
        """The closest pair of bodies at one configuration (dof,)."""
        pairs = self.pairs(joints)
        if not pairs.names:
            return Nearest(self.far_mm, "arm", "nothing")
        return pairs.nearest()

    def smallest(self, joints: FloatArray) -> FloatArray:
        """Smallest distance (M,) of M configurations, mm."""
        return np.asarray(
            self.pairs(joints).distance_mm.min(axis=1, initial=self.far_mm)
        )

    def to_obstacles(
        self, bodies: Capsules
    ) -> tuple[FloatArray, tuple[tuple[str, str], ...], FloatArray]:
        """Distances (M, P) mm of what ``moving`` gives to every obstacle.

        Also the P pairs of names, and their levers as in ``Pairs``.
        """
        moving = [
            k for k, n in enumerate(bodies.names) if n not in self.model.fixed_links
        ]
        m = len(bodies.start_mm)
        p = bodies.start_mm[:, moving].reshape(-1, 3)
        q = bodies.end_mm[:, moving].reshape(-1, 3)
        columns = [
            o.distance(p, q, self.far_mm).reshape(m, -1) - bodies.radius_mm[moving]
            for o in self.obstacles
        ]
        names = tuple((bodies.names[k], o.name) for o in self.obstacles for k in moving)
        levers = np.tile(self.levers[moving], (len(self.obstacles), 1))
        return np.concatenate([*columns, np.zeros((m, 0))], axis=1), names, levers

    @cached_property
    def _own_pairs(self) -> IntArray:
        """(P, 2) indices of bodies of the arm itself that can touch."""
        links = self.model.links_batch(self.model.joint_low[None]).names
        tools = range(len(links), len(links) + len(self.tool_bodies))
        own = [(links.index(a), links.index(b)) for a, b in self.model.self_pairs]
        own += [(links.index(a), k) for a in self.model.tool_pairs for k in tools]
        return np.array(own, dtype=np.int64).reshape(-1, 2)

    def _to_itself(
        self, bodies: Capsules
    ) -> tuple[FloatArray, tuple[tuple[str, str], ...], FloatArray]:
        first, second = self._own_pairs.T
        gap = segment_segment(
            bodies.start_mm[:, first],
            bodies.end_mm[:, first],
            bodies.start_mm[:, second],
            bodies.end_mm[:, second],
        )
        names = tuple(
            (bodies.names[b], bodies.names[a])
            for a, b in zip(first, second, strict=True)
        )
        touching = bodies.radius_mm[first] + bodies.radius_mm[second]
        # An axis that carries both bodies does not change their distance.
        levers = np.where(self.levers[first] > 0, 0.0, self.levers[second])
        return np.minimum(gap - touching, self.far_mm), names, levers


def blocked_sight(
    bodies: Capsules, pupil_mm: FloatArray, targets_mm: FloatArray
) -> tuple[str, ...]:
    """Bodies of one configuration that stand between the pupil and a target.

    A body that contains the pupil is the lens itself and blocks nothing.

    Args:
        bodies: links and tool bodies, M = 1, base frame.
        pupil_mm: (3,) entrance pupil, base frame.
        targets_mm: (n, 3) points that must be seen, base frame.
    """
    start, end = bodies.start_mm[0], bodies.end_mm[0]
    pupil = np.broadcast_to(pupil_mm, start.shape)
    own = segment_segment(pupil, pupil, start, end) <= bodies.radius_mm
    gap = segment_segment(start[:, None], end[:, None], pupil_mm, targets_mm)
    blocked: BoolArray = (gap < bodies.radius_mm[:, None]).any(axis=1) & ~own
    return tuple(np.array(bodies.names)[blocked].tolist())


def obstacles(
    part: TriangleMesh | None,
    fixtures: Sequence[TriangleMesh] = (),
    keep_outs: Sequence[tuple[str, Box]] = (),
) -> tuple[Obstacle, ...]:
    """Part, fixtures and keep-out boxes as obstacles; all in the base frame."""
    meshes = [m for m in (part, *fixtures) if m is not None and len(m.faces)]
    solid = [Obstacle(mesh.name, mesh) for mesh in meshes]
    return (*solid, *(Obstacle(n, box_mesh(box, name=n)) for n, box in keep_outs))
