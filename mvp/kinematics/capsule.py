"""Capsules: the rounded sticks that stand for arm links, camera and lens."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mvp.geometry import FloatArray, as_points

if TYPE_CHECKING:
    from collections.abc import Sequence


@dataclass(frozen=True, eq=False)
class Capsule:
    """All points within ``radius_mm`` of a segment.

    Attributes:
        name: how messages call it.
        start_mm: (3,) one end of the segment.
        end_mm: (3,) the other end; may be the same point.
        radius_mm: > 0.
    """

    name: str
    start_mm: FloatArray
    end_mm: FloatArray
    radius_mm: float

    def __post_init__(self) -> None:
        for field in ("start_mm", "end_mm"):
            point = np.array(as_points(getattr(self, field), name=field))
            if point.shape != (3,):
                raise ValueError(f"{field} of capsule {self.name!r} is one point")
            object.__setattr__(self, field, point)
        if not (np.isfinite(self.radius_mm) and self.radius_mm > 0):
            raise ValueError(f"capsule {self.name!r} needs a positive radius")


@dataclass(frozen=True, eq=False)
class Capsules:
    """The same k capsules in M configurations.

    Attributes:
        names: k names.
        radius_mm: (k,).
        start_mm: (M, k, 3).
        end_mm: (M, k, 3).
    """

    names: tuple[str, ...]
    radius_mm: FloatArray
    start_mm: FloatArray
    end_mm: FloatArray

    def at(self, index: int) -> tuple[Capsule, ...]:
        """The capsules of one configuration."""
        return tuple(
            Capsule(name, self.start_mm[index, k], self.end_mm[index, k], float(radius))
            for k, (name, radius) in enumerate(
                zip(self.names, self.radius_mm, strict=True)
            )
        )

    def joined(self, other: Capsules) -> Capsules:
        """These capsules followed by others, configuration by configuration."""
        return Capsules(
            self.names + other.names,
            np.concatenate([self.radius_mm, other.radius_mm]),
            np.concatenate([self.start_mm, other.start_mm], axis=1),
            np.concatenate([self.end_mm, other.end_mm], axis=1),
        )


def carried(
    bodies: Sequence[Capsule], rotation: FloatArray, translation_mm: FloatArray
) -> Capsules:
    """Bodies fixed to a moving frame, at M poses (M, 3, 3), (M, 3) of that frame."""
    start = np.array([b.start_mm for b in bodies]).reshape(-1, 3)
    end = np.array([b.end_mm for b in bodies]).reshape(-1, 3)
    shift = translation_mm[:, None, :]
    return Capsules(
        tuple(b.name for b in bodies),
        np.array([b.radius_mm for b in bodies], dtype=np.float64),
        np.einsum("mij,kj->mki", rotation, start) + shift,
        np.einsum("mij,kj->mki", rotation, end) + shift,
    )
