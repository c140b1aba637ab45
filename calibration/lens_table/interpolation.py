"""A curve through the nodes of one motor, chosen by how well it foretells left-out nodes.

The planner follows a monotone cubic through the table (``mvp.optics``). Where another curve
foretells better (a zoom's focal length is nearly exponential in its steps), the table is
filled from that curve so densely that the monotone cubic through it is the same curve.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np
from scipy.interpolate import PchipInterpolator

if TYPE_CHECKING:
    from collections.abc import Callable

    from mvp.geometry import FloatArray, IntArray

Shape: TypeAlias = Literal["monotone-cubic", "polynomial"]
_Curve: TypeAlias = "Callable[[FloatArray], FloatArray]"

_HIGHEST_DEGREE = 4
_PIECES = 4
_WORTH = 0.8


@dataclass(frozen=True, eq=False)
class AxisNodes:
    """Measured values of one motor axis.

    Attributes:
        steps: (k,), distinct and rising.
        values_mm: (k,).
        sigma_mm: (k,), one standard deviation of each.
    """

    steps: IntArray
    values_mm: FloatArray
    sigma_mm: FloatArray

    def __post_init__(self) -> None:
        if not len(self.steps) == len(self.values_mm) == len(self.sigma_mm) >= 1:
            raise ValueError("steps, values and sigmas must be as many, one or more")
        if (np.diff(self.steps) <= 0).any():
            raise ValueError("the steps must rise")

    @property
    def monotone(self) -> bool:
        """All values rise, or all fall."""
        rises = np.diff(self.values_mm)
        return bool((rises > 0).all() or (rises < 0).all())

    def without(self, index: int) -> AxisNodes:
        """All nodes but one."""
        keep = np.arange(len(self.steps)) != index
        return AxisNodes(self.steps[keep], self.values_mm[keep], self.sigma_mm[keep])


@dataclass(frozen=True)
class CurveKind:
    """How values follow the steps.

    Attributes:
        shape: a monotone cubic through all nodes, or a weighted polynomial.
        degree: of the polynomial; 0 for the cubic.
        logarithmic: of the value's logarithm.
    """

    shape: Shape
    degree: int = 0
    logarithmic: bool = False

    @property
    def words(self) -> str:
        """For reports."""
        of = "log value" if self.logarithmic else "value"
        degree = f" of degree {self.degree}" if self.degree else ""
        return f"{self.shape}{degree}, {of}"


@dataclass(frozen=True, eq=False)
class AxisCurve:
    """A curve, and what it foretells of nodes that it does not know.

    Attributes:
        kind: which was chosen.
        nodes: the measured ones.
        left_out_mm: (k - 2,), error at every inner node when it is left out.
        left_out_sigmas: root mean square of those errors by the sigma of the nodes
            around; nan for two nodes, of which none can be left out.
        table_steps: steps of the exported table.
        table_mm: its values.
    """

    kind: CurveKind
    nodes: AxisNodes
    left_out_mm: FloatArray
    left_out_sigmas: float
    table_steps: IntArray
    table_mm: FloatArray

    @property
    def monotone(self) -> bool:
        """The exported table rises or falls throughout."""
        rises = np.diff(self.table_mm)
        return bool((rises > 0).all() or (rises < 0).all())

    def slope_mm(self, steps: FloatArray | IntArray) -> FloatArray:
        """Change of the value by one step."""
        curve = PchipInterpolator(self.table_steps, self.table_mm)
        return np.asarray(curve.derivative()(steps))


def best_curve(nodes: AxisNodes) -> AxisCurve:
    """The simplest curve that foretells left-out nodes about as well as the best.

    Only inner nodes are left out: a table is not followed beyond its ends.
    """
    plain = CurveKind("monotone-cubic")
    if len(nodes.steps) < 3 or not nodes.monotone:
        return _drawn(plain, nodes)
    scored = [(_score(left_out(kind, nodes), nodes), kind) for kind in _kinds(nodes)]
    best = min(score for score, _ in scored)
    kind = next(kind for score, kind in scored if score * _WORTH <= best)
    drawn = _drawn(kind, nodes)
    return drawn if drawn.monotone else _drawn(plain, nodes)


def free_curve(nodes: AxisNodes) -> AxisCurve:
    """``best_curve`` of a value in any unit that need neither rise nor fall."""
    plain = CurveKind("monotone-cubic")
    if len(nodes.steps) < 3:
        return AxisCurve(
            plain, nodes, np.zeros(0), float("nan"), nodes.steps, nodes.values_mm
        )
    errors = {kind: left_out(kind, nodes) for kind in _kinds(nodes)}
    scores = {kind: _score(found, nodes) for kind, found in errors.items()}
    best = min(scores.values())
    kind = next(kind for kind, score in scores.items() if score * _WORTH <= best)
    steps = _filled(nodes.steps)
    values = _curve(kind, nodes)(steps.astype(np.float64))
    return AxisCurve(kind, nodes, errors[kind], scores[kind], steps, values)


def left_out(kind: CurveKind, nodes: AxisNodes) -> FloatArray:
    """(k - 2,): foretold less measured at the inner nodes, each left out in turn."""
    inner = range(1, len(nodes.steps) - 1)
    foretold = [
        _curve(kind, nodes.without(i))(nodes.steps[i : i + 1].astype(np.float64))[0]
        for i in inner
    ]
    return np.asarray(np.array(foretold) - nodes.values_mm[1:-1])


def _kinds(nodes: AxisNodes) -> list[CurveKind]:
    """The simplest first; no polynomial with as many numbers as nodes that are left."""
    logs = [False, True] if (nodes.values_mm > 0).all() else [False]
    kinds = [CurveKind("monotone-cubic", 0, log) for log in logs]
    highest = min(_HIGHEST_DEGREE, len(nodes.steps) - 3)
    degrees = range(1, highest + 1)
    return kinds + [CurveKind("polynomial", n, log) for n in degrees for log in logs]


def _score(errors_mm: FloatArray, nodes: AxisNodes) -> float:
    """By the sigma of each node and its two neighbours, which foretell it."""
    variance = nodes.sigma_mm**2
    local = (variance[:-2] + variance[1:-1] + variance[2:]) / 3
    return float(np.sqrt(np.mean(errors_mm**2 / local)))


def _curve(kind: CurveKind, nodes: AxisNodes) -> _Curve:
    x, y, sigma = nodes.steps.astype(np.float64), nodes.values_mm, nodes.sigma_mm
    if kind.logarithmic:
        y, sigma = np.log(y), sigma / y
    if kind.shape == "monotone-cubic":
        inner = PchipInterpolator(x, y)
    else:
        inner = np.polynomial.Polynomial.fit(x, y, kind.degree, w=1 / sigma)

    def curve(steps: FloatArray) -> FloatArray:
        found = np.asarray(inner(steps))
        return np.asarray(np.exp(found)) if kind.logarithmic else found

    return curve


def _drawn(kind: CurveKind, nodes: AxisNodes) -> AxisCurve:
    errors = left_out(kind, nodes) if nodes.monotone else np.zeros(0)
    steps, values = nodes.steps, nodes.values_mm
    if kind != CurveKind("monotone-cubic"):
        steps = _filled(nodes.steps)
        values = _curve(kind, nodes)(steps.astype(np.float64))
    score = _score(errors, nodes) if len(errors) else float("nan")
    return AxisCurve(kind, nodes, errors, score, steps, values)


def _filled(steps: IntArray) -> IntArray:
    """The nodes and whole steps between them, a quarter of each gap apart."""
    index = np.arange(_PIECES * (len(steps) - 1) + 1) / _PIECES
    between = np.interp(index, np.arange(len(steps)), steps)
    return np.unique(np.rint(between).astype(np.int64))
