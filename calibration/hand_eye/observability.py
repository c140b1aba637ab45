"""Do the motions determine a hand-eye transform at all, and if not, what is missing?

Rotations about one axis only leave the translation along that axis free, and with noise
the rotation about it as well; the residuals of a fit cannot show this.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibration.verdict import Cause, Limit

if TYPE_CHECKING:
    from calibration.hand_eye.motions import Motions
    from mvp.geometry import FloatArray

SECOND_AXIS_DEG = 2.0

_LARGEST = Limit(
    "rotations-small",
    "the largest rotation between two views",
    "deg",
    marginal=30.0,
    no_go=10.0,
    action="take views that differ by 30 to 90 deg, about at least two axes",
    at_least=True,
)
_SECOND = Limit(
    "second-axis-weak",
    "the rotation about a second axis (root mean square over pairs)",
    "deg",
    marginal=6.0,
    no_go=SECOND_AXIS_DEG,
    action="tilt the camera by 20 deg and more about another axis in four more views",
    at_least=True,
)


@dataclass(frozen=True, eq=False)
class Observability:
    """How much the views turn against each other.

    Attributes:
        spread_deg: (3,), root mean square rotation between two views about the axes
            below, the largest first.
        axes: (3, 3), one axis per row, in the moving frame (``tool`` or ``base``).
        largest_deg: largest rotation between two views.
        frame: name of the moving frame.
    """

    spread_deg: FloatArray
    axes: FloatArray
    largest_deg: float
    frame: str

    @property
    def determined(self) -> bool:
        """Two rotation axes or more: rotation and translation have one solution."""
        return bool(self.spread_deg[1] >= SECOND_AXIS_DEG)

    @property
    def undetermined(self) -> str:
        """In words, what the views leave free; empty when nothing."""
        if self.determined:
            return ""
        if self.spread_deg[0] < SECOND_AXIS_DEG:
            return "the translation of the camera in every direction"
        axis = _axis_words(self.axes[0], self.frame)
        return f"translation along and rotation about {axis}"

    def causes(self) -> tuple[Cause, ...]:
        """What speaks against the views."""
        if self.determined:
            return _LARGEST.check(self.largest_deg) + _SECOND.check(self.spread_deg[1])
        kind = "no-rotation" if self.spread_deg[0] < SECOND_AXIS_DEG else "one-axis"
        seen = (
            "the views do not turn against each other"
            if kind == "no-rotation"
            else "all views turn about one axis"
        )
        wanted = "any two axes" if kind == "no-rotation" else self._missing_axes()
        return (
            Cause(
                kind,
                "no-go",
                f"{seen}: undetermined is {self.undetermined}",
                f"second rotation axis missing: turn by +-20 deg about {wanted} "
                "in four more views",
            ),
        )

    def _missing_axes(self) -> str:
        words = [_axis_words(axis, self.frame) for axis in self.axes[1:]]
        return " or ".join(words)


def observability(motions: Motions, frame: str) -> Observability:
    """How well motions determine a hand-eye transform.

    Args:
        motions: of all pairs of views.
        frame: name of the moving frame.
    """
    turns = motions.moving.rotvec_rad
    _, sizes, axes = np.linalg.svd(turns, full_matrices=True)
    spread = np.zeros(3)
    spread[: len(sizes)] = sizes / np.sqrt(len(turns))
    largest = float(np.linalg.norm(turns, axis=1).max())
    upright = axes * np.sign(axes[np.arange(3), np.abs(axes).argmax(axis=1)])[:, None]
    return Observability(np.degrees(spread), upright, float(np.degrees(largest)), frame)


def _axis_words(axis: FloatArray, frame: str) -> str:
    main = int(np.abs(axis).argmax())
    if abs(axis[main]) > np.cos(np.radians(10)):
        return f"the {'xyz'[main]} axis of the {frame}"
    numbers = ", ".join(f"{round(float(value), 2) + 0.0:.2f}" for value in axis)
    return f"the axis ({numbers}) of the {frame}"
