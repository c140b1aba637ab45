"""What must be seen: point, edge, face, hole. Frozen data in the part frame, mm.

Every feature answers the same four questions:

- ``key_points_mm``: points that must be in focus and inside the field of view;
- ``sight_pieces()``: convex pieces that must be seen whole (visibility);
- ``segments_mm``: line segments whose image must be resolved (resolution);
- ``outline_mm``: the polylines that a picture shows of it (drawing, verification).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, Protocol, TypeAlias

if TYPE_CHECKING:
    from mvp.geometry import FeaturePiece, FloatArray

Kind: TypeAlias = Literal["point", "edge", "face", "hole"]


class Feature(Protocol):
    """What planner, verifier and report ask of any kind of feature."""

    @property
    def id(self) -> str:
        """Stable name, as used in tasks and reports."""
        ...

    @property
    def kind(self) -> Kind:
        """Which of the four kinds it is."""
        ...

    @property
    def key_points_mm(self) -> FloatArray:
        """(k, 3) points that must be in focus and inside the field of view."""
        ...

    @property
    def segments_mm(self) -> FloatArray:
        """(s, 2, 3) segments whose image must be resolved."""
        ...

    @property
    def outline_mm(self) -> tuple[FloatArray, ...]:
        """Polylines (n, 3) that a picture shows of it."""
        ...

    def sight_pieces(self) -> tuple[FeaturePiece, ...]:
        """The convex pieces that must be seen whole."""
        ...
