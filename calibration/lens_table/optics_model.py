"""f, the extension x = d - f and the pupil offset e against what nodes measured.

A node measures f_cal = d - e m and the sharp distance from the pupil
D = f d / (d - f) - e, where m = x / f (thick lens in air). One alone cannot tell f, x and
e apart; two focus settings with the same f and e can. The reciprocal of D is used: the
error of a contrast sweep is even in it, and it is finite for a lens set to infinity.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import block_diag

if TYPE_CHECKING:
    from calibration.lens_table.nodes import NodeSet
    from mvp.geometry import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Bases:
    """How the unknowns of all nodes depend on fewer parameters: value = basis @ them.

    Attributes:
        x: (n, .) extension.
        e: (n, .) pupil offset.
        centre_x: (n, .).
        centre_y: (n, .).
        k1: (n, .).
    """

    x: FloatArray
    e: FloatArray
    centre_x: FloatArray
    centre_y: FloatArray
    k1: FloatArray


@dataclass(frozen=True, eq=False)
class OpticsProblem:
    """Whitened differences between the thick lens and all nodes.

    The parameters are f of every zoom, then those of the bases in their order, then the
    origin of the pupil's place at every zoom where it was measured.

    Attributes:
        seen: the nodes.
        bases: of x, e, centre and k1.
        e_prior_mm: mean and one standard deviation of every parameter of e.
        pupil_follows: the pupil moves with x (the lens moves as one piece), so its place
            along the axis counts.
    """

    seen: NodeSet
    bases: Bases
    e_prior_mm: tuple[float, float] | None = None
    pupil_follows: bool = False

    @cached_property
    def _parts(self) -> tuple[slice, ...]:
        b = self.bases
        widths = [len(self.seen.zoom_steps)]
        widths += [m.shape[1] for m in (b.x, b.e, b.centre_x, b.centre_y, b.k1)]
        widths += [self._origins.shape[1]]
        ends = np.cumsum([0, *widths])
        return tuple(slice(a, b) for a, b in itertools.pairwise(ends))

    @cached_property
    def _origins(self) -> FloatArray:
        """(pupil rows, zooms with a measured pupil), one where a row has its origin."""
        rows = self._pupil[0]
        zooms = np.unique(self.seen.zoom_of[rows])
        return np.asarray(self.seen.zoom_of[rows][:, None] == zooms[None], np.float64)

    @cached_property
    def _sharp(self) -> tuple[IntArray, FloatArray, FloatArray]:
        """Node, reciprocal distance, its sigma."""
        rows, distance, sigma = self.seen.measured("sharp_mm")
        return rows, 1 / distance, sigma / distance**2

    @cached_property
    def _pupil(self) -> tuple[IntArray, FloatArray, FloatArray]:
        rows, place, sigma = self.seen.measured("pupil_mm")
        count = len(rows) if self.pupil_follows else 0
        return rows[:count], place[:count], sigma[:count]

    @cached_property
    def _whitening(self) -> FloatArray:
        """(n, 4, 4): inverse Cholesky factors."""
        return np.linalg.inv(np.linalg.cholesky(self.seen.covariances))

    @property
    def names(self) -> tuple[str, ...]:
        """One for each parameter."""
        stems = (
            "x_mm",
            "e_mm",
            "centre_x_px",
            "centre_y_px",
            "k1_per_mm2",
            "origin_mm",
        )
        names = [f"f_mm at zoom {step}" for step in self.seen.zoom_steps]
        for stem, part in zip(stems, self._parts[1:], strict=True):
            names += [f"{stem} {i + 1}" for i in range(part.stop - part.start)]
        return tuple(names)

    @property
    def scales(self) -> FloatArray:
        """About what matters equally in a picture."""
        sizes = (0.005, 0.005, 0.1, 1.0, 1.0, 1e-5, 0.1)
        counts = [part.stop - part.start for part in self._parts]
        return np.repeat(sizes, counts)

    @property
    def prior_rows(self) -> int:
        """One for each parameter of e with a prior."""
        return 0 if self.e_prior_mm is None else self.bases.e.shape[1]

    def unknowns(self, state: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """f, x and e of every node, mm."""
        f = state[self._parts[0]][self.seen.zoom_of]
        return (
            f,
            np.asarray(self.bases.x @ state[self._parts[1]]),
            np.asarray(self.bases.e @ state[self._parts[2]]),
        )

    def node_values(self, state: FloatArray) -> FloatArray:
        """(n, 4) of ``NODE_NAMES`` as the model has them."""
        f, x, e = self.unknowns(state)
        b, parts = self.bases, self._parts
        rest = [
            basis @ state[part]
            for basis, part in zip(
                (b.centre_x, b.centre_y, b.k1), parts[3:6], strict=True
            )
        ]
        return np.stack([f + x - e * x / f, *rest], axis=1)

    def residuals(self, state: FloatArray) -> FloatArray:
        """Node values, sharp distances, pupil places, priors; nan where f or x <= 0."""
        f, x, e = self.unknowns(state)
        values = self.node_values(state) - self.seen.values
        nodes = np.einsum("nij,nj->ni", self._whitening, values).ravel()
        rows, near, near_sigma = self._sharp
        predicted = x / (f**2 + x * (f - e))
        sharp = (predicted[rows] - near) / near_sigma
        rows, place, place_sigma = self._pupil
        origins = self._origins @ state[self._parts[6]]
        pupil = (origins + (x + e)[rows] - place) / place_sigma
        found = np.concatenate([nodes, sharp, pupil, self._prior(state)])
        return found if (f > 0).all() and (x > -0.5 * f).all() else found * np.nan

    def jacobian(self, state: FloatArray) -> FloatArray:
        """Derivative of the residuals for the parameters."""
        f, x, e = self.unknowns(state)
        zoom = np.eye(len(self.seen.zoom_steps))[self.seen.zoom_of]
        bx, be = self.bases.x, self.bases.e
        rows, _, near_sigma = self._sharp
        g2 = (f**2 + x * (f - e)) ** 2
        sharp = self._row(
            zoom * (-x * (2 * f + x) / g2)[:, None],
            bx * (f**2 / g2)[:, None],
            be * (x**2 / g2)[:, None],
        )[rows]
        rows, _, place_sigma = self._pupil
        pupil = self._row(zoom * 0, bx, be)[rows]
        pupil[:, self._parts[6]] = self._origins
        prior = np.zeros((self.prior_rows, len(self.names)))
        if self.e_prior_mm is not None:
            prior[:, self._parts[2]] = np.eye(self.prior_rows) / self.e_prior_mm[1]
        blocks = [self._node_rows(f, x, e, zoom), sharp / near_sigma[:, None]]
        return np.concatenate([*blocks, pupil / place_sigma[:, None], prior])

    def moved(self, state: FloatArray, step: FloatArray) -> FloatArray:
        """A plain sum."""
        return state + step

    def optics_rows(self, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Derivatives (n, parameters) of d and of x of every node."""
        zoom = np.eye(len(self.seen.zoom_steps))[self.seen.zoom_of]
        x = self._row(zoom * 0, self.bases.x, self.bases.e * 0)
        f = self._row(zoom, self.bases.x * 0, self.bases.e * 0)
        return f + x, x

    def defocus_rows(self, state: FloatArray) -> FloatArray:
        """Derivatives (n, parameters) of m - f_cal / z at each node's sharp distance z."""
        f, x, e = self.unknowns(state)
        zoom = np.eye(len(self.seen.zoom_steps))[self.seen.zoom_of]
        near = x / (f**2 + x * (f - e))
        return self._row(
            zoom * (-x / f**2 - (1 + e * x / f**2) * near)[:, None],
            self.bases.x * (1 / f - (1 - e / f) * near)[:, None],
            self.bases.e * (x / f * near)[:, None],
        )

    def parameters(self, state: FloatArray, of: int) -> FloatArray:
        """One block: 0 f, 1 x, 2 e, 3 centre x, 4 centre y, 5 k1, 6 origins."""
        return np.asarray(state[self._parts[of]])

    def block(self, covariance: FloatArray, of: int) -> FloatArray:
        """The covariance of one block, numbered as in ``parameters``."""
        part = self._parts[of]
        return np.asarray(covariance[part, part])

    def _node_rows(
        self, f: FloatArray, x: FloatArray, e: FloatArray, zoom: FloatArray
    ) -> FloatArray:
        found = np.zeros((len(self.seen), 4, len(self.names)))
        found[:, 0] = self._row(
            zoom * (1 + e * x / f**2)[:, None],
            self.bases.x * (1 - e / f)[:, None],
            self.bases.e * (-x / f)[:, None],
        )
        b = self.bases
        for i, basis in enumerate((b.centre_x, b.centre_y, b.k1)):
            found[:, i + 1, self._parts[i + 3]] = basis
        white = self._whitening @ found
        return np.asarray(white.reshape(-1, len(self.names)))

    def _row(self, zoom: FloatArray, x: FloatArray, e: FloatArray) -> FloatArray:
        row = np.zeros((len(self.seen), len(self.names)))
        for part, values in zip(self._parts, (zoom, x, e), strict=False):
            row[:, part] = values
        return row

    def _prior(self, state: FloatArray) -> FloatArray:
        if self.e_prior_mm is None:
            return np.zeros(0)
        mean, sigma = self.e_prior_mm
        return np.asarray((state[self._parts[2]] - mean) / sigma)


def start_state(problem: OpticsProblem) -> FloatArray:
    """A start from the data: e = 0, d = f_cal, f from the sharp distances.

    Raises:
        ValueError: a zoom has no sharp distance at all.
    """
    seen = problem.seen
    rows, distance, _ = seen.measured("sharp_mm")
    f_cal = seen.values[rows, 0]
    guess = f_cal * distance / (f_cal + distance)
    zooms = [guess[seen.zoom_of[rows] == z] for z in range(len(seen.zoom_steps))]
    if any(len(values) == 0 for values in zooms):
        raise ValueError("every zoom needs a sharp distance")
    f = np.array([float(np.median(values)) for values in zooms])
    x = np.maximum(seen.values[:, 0] - f[seen.zoom_of], 1e-3 * f[seen.zoom_of])
    b = problem.bases
    targets = (x, x * 0, *seen.values[:, 1:].T)
    fitted = [
        np.linalg.lstsq(basis, wanted, rcond=None)[0]
        for basis, wanted in zip(
            (b.x, b.e, b.centre_x, b.centre_y, b.k1), targets, strict=True
        )
    ]
    origins = np.zeros(len(problem.names) - len(f) - sum(map(len, fitted)))
    return np.concatenate([f, *fitted, origins])


def same_for(index: IntArray) -> FloatArray:
    """A basis (n, k) with one parameter for each distinct index 0 .. k - 1."""
    return np.eye(int(index.max()) + 1)[index]


def polynomial(steps: FloatArray | IntArray, degree: int) -> FloatArray:
    """A basis (n, degree + 1) of powers of the steps, scaled to -1 .. 1."""
    low, high = float(np.min(steps)), float(np.max(steps))
    span = (high - low) / 2 or 1.0
    scaled = (np.asarray(steps, np.float64) - (low + high) / 2) / span
    return np.vander(scaled, degree + 1, increasing=True)


def each_zoom(zoom_of: IntArray, basis: FloatArray) -> FloatArray:
    """The basis (n, k) anew for every zoom: (n, zooms * k). Nodes sorted by zoom."""
    blocks = [basis[zoom_of == zoom] for zoom in range(int(zoom_of.max()) + 1)]
    return np.asarray(block_diag(*blocks))
