"""How far a target is from flat and square, found together with camera and poses.

A sheet that is not glued to something stiff is bowed or twisted; a print is longer along
one axis than along the other. Both pull the focal length, and residuals hardly show it:
the five numbers here are free, held by what is known of the target, so that the camera
is right and its stated deviation includes them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Generic

import numpy as np
from scipy import sparse

from calibration.bundle import BundleProblem, BundleState, Camera
from calibration.verdict import Limit

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from calibration.estimate import Estimate, Jacobian
    from calibration.verdict import Cause
    from mvp.geometry import FloatArray

SHAPE_NAMES = ("bow_x_mm", "bow_y_mm", "twist_mm", "stretch_y", "shear")
FLAT = Limit(
    "target-not-flat",
    "the target is not flat",
    "%",
    0.25,
    0.75,
    "use a board of glass or aluminium, or glue the print to one: a bent target also "
    "spoils hand-eye and part poses",
)
SQUARE = Limit(
    "target-stretched",
    "the target is stretched",
    "%",
    0.3,
    1.5,
    "measure squares along both sides with a caliper, print without scaling, and check "
    "the pixel pitches in the cell file",
)
_PRINT_FLAT, _PRINT_SQUARE = 5e-3, 5e-3
_CLEARLY = 4.0
_FLAT_ENOUGH, _SQUARE_ENOUGH = 1e-4, 3e-4


@dataclass(frozen=True)
class ShapePrior:
    """What is known of a target before it is seen: one standard deviation each.

    Attributes:
        flat_mm: of the middle off the plane of the ends.
        square: of the angle between its axes (rad), and of the stretch if that is None.
        stretch: of a length along y by one along x, where both were measured.
    """

    flat_mm: float
    square: float
    stretch: float | None = None

    def __post_init__(self) -> None:
        if not self.sigmas.min() > 0:
            raise ValueError("standard deviations are positive")

    @classmethod
    def of_a_print(cls, points_target_mm: FloatArray) -> ShapePrior:
        """A print on something that is nearly flat: wide, for the pictures to decide."""
        length = float(np.ptp(points_target_mm, axis=0).max())
        return cls(_PRINT_FLAT * length, _PRINT_SQUARE)

    def known(
        self, *, flat_mm: float | None = None, stretch: float | None = None
    ) -> ShapePrior:
        """With what somebody measured or knows of it; None: nobody does.

        Args:
            flat_mm: one standard deviation of how far it is from flat.
            stretch: one standard deviation of a length along y by one along x; a caliper
                never makes it exact, and no print is worse than an unknown one.
        """
        if stretch is not None:
            stretch = float(np.clip(stretch, _SQUARE_ENOUGH, self.square))
        return replace(self, flat_mm=flat_mm or self.flat_mm, stretch=stretch)

    @property
    def sigmas(self) -> FloatArray:
        """(5,), of ``SHAPE_NAMES``."""
        stretch = self.square if self.stretch is None else self.stretch
        return np.array([self.flat_mm] * 3 + [stretch, self.square])


@dataclass(frozen=True, eq=False)
class TargetShape:
    """Where the points of a nearly flat target really lie.

    Attributes:
        middle_mm: (2,), of the target, in its frame.
        half_mm: (2,), half its width and height.
        values: (5,) of ``SHAPE_NAMES``: the middle lies deeper than the ends along x
            and y by a bow; the corners lie off the plane by the twist; lengths along y
            are longer by the stretch; x grows with y by the shear.
    """

    middle_mm: FloatArray
    half_mm: FloatArray
    values: FloatArray

    @classmethod
    def flat(cls, points_target_mm: FloatArray) -> TargetShape:
        """A target that is as stated; points (m, 3)."""
        low, high = points_target_mm[:, :2].min(0), points_target_mm[:, :2].max(0)
        half = np.maximum((high - low) / 2, np.finfo(float).tiny)
        return cls((low + high) / 2, half, np.zeros(len(SHAPE_NAMES)))

    @property
    def sides_mm(self) -> FloatArray:
        """(2,): width and height between the outermost points."""
        return 2 * self.half_mm

    def slopes(self, points_target_mm: FloatArray) -> FloatArray:
        """(m, 3, 5): change of each point for a unit of each value."""
        away = points_target_mm[:, :2] - self.middle_mm
        u, v = (away / self.half_mm).T
        found = np.zeros((len(away), 3, len(SHAPE_NAMES)))
        found[:, 2, :3] = np.stack([1 - u**2, 1 - v**2, u * v], axis=1)
        found[:, 1, 3] = found[:, 0, 4] = away[:, 1]
        return found

    def moved(self, points_target_mm: FloatArray) -> FloatArray:
        """The points (m, 3) where they really are."""
        return points_target_mm + self.slopes(points_target_mm) @ self.values


@dataclass(frozen=True, eq=False)
class ShapedState(Generic[Camera]):
    """Camera and poses, and the target that they saw."""

    bundle: BundleState[Camera]
    shape: TargetShape


@dataclass(frozen=True, eq=False)
class ShapedProblem(Generic[Camera]):
    """A bundle whose target may be bowed, twisted, stretched and sheared.

    Attributes:
        flat: the same of a target that is as stated.
        prior: on the shape.
    """

    flat: BundleProblem[Camera]
    prior: ShapePrior

    @property
    def names(self) -> tuple[str, ...]:
        """Of the bundle, then ``SHAPE_NAMES``."""
        return (*self.flat.names, *SHAPE_NAMES)

    @property
    def scales(self) -> FloatArray:
        """About what moves a corner by 1 px: for directions in words only."""
        seen = self.flat.seen
        reach = float(np.ptp(seen.points_target_mm, axis=0).max())
        pixels = max(seen.width_px, seen.height_px)
        own = np.array([reach / pixels] * 3 + [1 / pixels] * 2)
        return np.concatenate([self.flat.scales, own])

    @property
    def prior_rows(self) -> int:
        """Those of the bundle, then one for each of ``SHAPE_NAMES``."""
        return self.flat.prior_rows + len(SHAPE_NAMES)

    def bundle(self, shape: TargetShape) -> BundleProblem[Camera]:
        """The same views of a target of this shape."""
        seen = self.flat.seen
        points = shape.moved(seen.points_target_mm)
        return replace(self.flat, seen=replace(seen, points_target_mm=points))

    def residuals(self, state: ShapedState[Camera]) -> FloatArray:
        """(2 m + priors,), whitened."""
        seen = self.bundle(state.shape).residuals(state.bundle)
        return np.concatenate([seen, state.shape.values / self.prior.sigmas])

    def jacobian(self, state: ShapedState[Camera]) -> Jacobian:
        """(2 m + priors, n + 6 views + 5); sparse where there are several views."""
        bundle, own = self.bundle(state.shape), self._own(state)
        held = np.diag(1 / self.prior.sigmas)
        left = bundle.jacobian(state.bundle)
        if isinstance(left, np.ndarray):
            below = np.zeros((len(held), left.shape[1]))
            return np.block([[left, own], [below, held]])
        blocks = [[left, sparse.csr_matrix(own)], [None, sparse.csr_matrix(held)]]
        return sparse.csr_matrix(sparse.bmat(blocks, format="csr"))

    def moved(
        self, state: ShapedState[Camera], step: FloatArray
    ) -> ShapedState[Camera]:
        """The state after a step of everything."""
        count = len(SHAPE_NAMES)
        shape = replace(state.shape, values=state.shape.values + step[-count:])
        return ShapedState(self.flat.moved(state.bundle, step[:-count]), shape)

    def _own(self, state: ShapedState[Camera]) -> FloatArray:
        """(2 m + priors of the bundle, 5): slopes for the shape."""
        seen, rows = self.flat.seen, self.flat.seen.view
        there = state.bundle
        found = there.camera.project_with_derivatives(
            there.rotation[rows],
            there.translation_mm[rows],
            state.shape.moved(seen.points_target_mm),
        )
        slopes = found.d_point @ state.shape.slopes(seen.points_target_mm)
        sigma = np.broadcast_to(np.asarray(self.flat.sigma_px), (len(rows),))
        slopes = (slopes / sigma[:, None, None]).reshape(-1, len(SHAPE_NAMES))
        priors = np.zeros((self.flat.prior_rows, len(SHAPE_NAMES)))
        return np.concatenate([slopes, priors])


@dataclass(frozen=True, eq=False)
class FoundShape:
    """The shape of a target as its pictures show it.

    Attributes:
        shape: best values.
        covariance: (5, 5) of ``SHAPE_NAMES``.
    """

    shape: TargetShape
    covariance: FloatArray

    @classmethod
    def of(cls, shape: TargetShape, estimate: Estimate) -> FoundShape:
        """From a fit of a ``ShapedProblem``."""
        return cls(shape, estimate.block(SHAPE_NAMES))

    @property
    def sigmas(self) -> FloatArray:
        """(5,): one standard deviation of each."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def found(self) -> tuple[str, ...]:
        """Those of ``SHAPE_NAMES`` that are certain, and large enough to matter."""
        length = float(self.shape.sides_mm.max())
        least = [_FLAT_ENOUGH * length] * 3 + [_SQUARE_ENOUGH] * 2
        size = np.abs(self.shape.values)
        there = (size > _CLEARLY * self.sigmas) & (size > least)
        return tuple(
            name for name, is_it in zip(SHAPE_NAMES, there, strict=True) if is_it
        )

    @property
    def words(self) -> str:
        """One line for a person; empty for a target as it was stated."""
        said = list(self._said(self.found))
        if not said:
            return ""
        return (
            f"the target is not as stated: {', '.join(said)}; the result allows for it"
        )

    def causes(self) -> tuple[Cause, ...]:
        """What speaks against a result that was found with this target.

        The five numbers take away what is even; of a strong bow enough is left that is
        not.
        """
        size, length = np.abs(self.shape.values), float(self.shape.sides_mm.max())
        percent = 100 * size / ([length] * 3 + [1.0] * 2)
        causes: list[Cause] = []
        for limit, names, part in (
            (FLAT, SHAPE_NAMES[:3], " of its length"),
            (SQUARE, SHAPE_NAMES[3:], ""),
        ):
            mine = [name for name in names if name in self.found]
            share = max(
                (percent[SHAPE_NAMES.index(name)] for name in mine), default=0.0
            )
            words = f"{limit.what}: {', '.join(self._said(mine))}"
            for cause in limit.check(float(share)):
                most = limit.marginal if cause.grade == "marginal" else limit.no_go
                words += f"; that is {share:.2g} %{part}, above {most:.2g} %"
                causes.append(replace(cause, message=words))
        return tuple(causes)

    def _said(self, names: Sequence[str]) -> Iterator[str]:
        """The values of some names in words."""
        for name in names:
            index = SHAPE_NAMES.index(name)
            value, sigma = float(self.shape.values[index]), float(self.sigmas[index])
            amount = f"{abs(value):.2f} +- {sigma:.1g} mm"
            share = f"{100 * abs(value):.2f} +- {100 * sigma:.1g} %"
            longer = ("y", "x") if value > 0 else ("x", "y")
            yield {
                "bow_x_mm": f"bow {amount} along x",
                "bow_y_mm": f"bow {amount} along y",
                "twist_mm": f"corners twisted by {amount}",
                "stretch_y": f"{share} longer along {longer[0]} than along {longer[1]}",
                "shear": f"its axes are {share} off a right angle",
            }[name]
