"""The rim of a hole measured in a picture: the same step fit, along an ellipse."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from mvp.imaging.edge_blocks import BLOCK_PX, BlockSamples, judge_blocks
from mvp.imaging.edge_fit import StepFit, StepSamples, fit_step, rescaled
from mvp.imaging.edge_search import local_step
from mvp.imaging.esf import angle_bin, spread_at
from mvp.imaging.hole_ellipse import Ellipse, fitted_ellipse
from mvp.imaging.measure_edges import FAINT, SATURATED, WINDOW_PX

if TYPE_CHECKING:
    from mvp.geometry import BoolArray, FloatArray, IntArray
    from mvp.imaging.edge_samples import Picture
    from mvp.imaging.expectation import DrawnEdges, ExpectedRim

_CAP = 2000
_SECTORS = 8
_BINS = 360
_SECTOR_PX = 14.0
_LEVEL_SECTORS = 8, 24
_GUARD_PX = 1.5
_STRIP_STEP_PX = 0.5
_FEWEST_PIXELS = 80
_LARGEST_CHANGE = 0.2
_LEAST_SNR = 4.0


@dataclass(frozen=True, eq=False)
class RimMeasurement:
    """What the picture says about one rim.

    Attributes:
        found: a significant closed step was fitted.
        reason: why not.
        ellipse: in ideal px.
        axes_sd_px: standard deviations of the full axes (larger, smaller).
        blur_q_px2, blur_q_sd: b^2 and its standard deviation.
        step: median |difference| of the levels, share of full scale.
        snr: step over the noise of one pixel.
        saturated: share of clipped pixels in the band.
        visible_fraction: share of its blocks that show the step.
    """

    found: bool
    reason: str
    ellipse: Ellipse
    axes_sd_px: tuple[float, float] = (float("nan"), float("nan"))
    blur_q_px2: float = float("nan")
    blur_q_sd: float = float("nan")
    step: float = float("nan")
    snr: float = 0.0
    saturated: float = 0.0
    visible_fraction: float = 0.0

    @property
    def blur_px(self) -> float:
        """Blur diameter."""
        return float(np.sqrt(max(self.blur_q_px2, 0.0)))


@dataclass(frozen=True, eq=False)
class _RimBand:
    angle: FloatArray
    t_px: FloatArray
    grey: FloatArray
    clear: BoolArray
    bins: IntArray


def measure_rim(
    picture: Picture,
    expected: Ellipse,
    others: DrawnEdges,
    rim: ExpectedRim,
    *,
    search_px: float,
) -> RimMeasurement:
    """Search the centre and size, fit the step along the rim, judge its blocks."""
    start = _start(picture, expected, search_px, rim.blur_px)
    if start is None:
        return RimMeasurement(False, "outside the picture", expected)
    reach = WINDOW_PX + rim.blur_px
    band = _band(picture, start, expected, others, rim.own, reach)
    fit = _fit(picture, start, band, rim.blur_px, None)
    if fit is None:
        return RimMeasurement(False, "too few pixels", expected)
    blocks = _blocks(picture, start, band, fit, rim)
    if 0.3 < blocks.fraction < 0.999:
        blur = float(np.sqrt(max(fit.q_px2, 0.0)))
        fit = _fit(picture, start, band, blur, blocks.usable(band.angle)) or fit
        blocks = _blocks(picture, start, band, fit, rim)
    found = _measurement(picture, start, band, fit, blocks.fraction)
    reason = found.reason or _out_of_place(found, expected, search_px)
    return replace(found, found=not reason, reason=reason)


def _out_of_place(found: RimMeasurement, expected: Ellipse, search_px: float) -> str:
    ellipse = found.ellipse
    off = np.hypot(ellipse.x_px - expected.x_px, ellipse.y_px - expected.y_px)
    growth = abs(ellipse.axes_px[0] / expected.axes_px[0] - 1)
    if off > 1.5 * search_px + 2 or growth > _LARGEST_CHANGE:
        return "the fit left the search band"
    return ""


def _start(
    picture: Picture, expected: Ellipse, search_px: float, blur_px: float
) -> Ellipse | None:
    """The shift and size with the strongest sum of steps over the sectors."""
    count = int(np.clip(expected.circumference_px, 32, 160)) // _SECTORS * _SECTORS
    angle = (np.arange(count) + 0.5) / count * 2 * np.pi
    normal = expected.normals(angle)
    grow = np.linspace(-0.5, 0.5, 7) * search_px
    reach = 1.6 * search_px + 3 + blur_px
    t = np.arange(-reach, reach + 0.01, _STRIP_STEP_PX)
    places = expected.points(angle)[:, None] + t[None, :, None] * normal[:, None]
    strip = picture.at(places)
    usable: BoolArray = np.asarray(np.isfinite(strip).all(axis=1))
    if usable.mean() < 0.5:
        return None
    width = max(round((1.5 + blur_px / 2) / _STRIP_STEP_PX), 2)
    step = local_step(np.where(usable[:, None], strip, 0.0), width) * usable[:, None]
    shifts = np.arange(-search_px, search_px + 0.01, 0.75)
    dx, dy, dr = (v.ravel() for v in np.meshgrid(shifts, shifts, grow, indexing="ij"))
    off = np.outer(dx, normal[:, 0]) + np.outer(dy, normal[:, 1]) + dr[:, None]
    place = np.rint((off - t[0]) / _STRIP_STEP_PX).astype(np.int64)
    value = step[np.arange(count), np.clip(place, 0, len(t) - 1)]
    sector = np.abs(value.reshape(len(dx), _SECTORS, -1).mean(axis=2)).sum(axis=1)
    prior = 1 - 0.4 * (dx**2 + dy**2 + dr**2) / (3 * max(search_px, 1.0) ** 2)
    best = int((sector * prior).argmax())
    return Ellipse(
        expected.x_px + float(dx[best]),
        expected.y_px + float(dy[best]),
        expected.semi_a_px + float(dr[best]),
        expected.semi_b_px + float(dr[best]),
        expected.turn_rad,
    )


def _band(
    picture: Picture,
    ellipse: Ellipse,
    expected: Ellipse,
    others: DrawnEdges,
    own: IntArray,
    half_width_px: float,
) -> _RimBand:
    plane = picture.plane
    outline = plane.raw(ellipse.points(np.linspace(0, 2 * np.pi, 73)))
    wide = half_width_px * np.array([1 / plane.optics.pixel_x_px, 1.0]) * 1.2 + 2
    rows, columns = picture.grey.shape
    low = np.maximum(np.floor(outline.min(axis=0) - wide), 0).astype(int)
    high = np.minimum(np.ceil(outline.max(axis=0) + wide), [columns - 1, rows - 1])
    x, y = np.meshgrid(
        np.arange(low[0], int(high[0]) + 1), np.arange(low[1], int(high[1]) + 1)
    )
    raw = np.stack([x.ravel(), y.ravel()], axis=1)
    ideal = plane.ideal(raw.astype(np.float64))
    angle = ellipse.nearest(ideal)
    t = ellipse.distance(ideal, angle)
    keep = np.abs(t) <= min(half_width_px, 0.6 * min(ellipse.axes_px) / 2)
    raw, angle, t = raw[keep], angle[keep], t[keep]
    inner, outer = _clear_range(expected, others, own, half_width_px)
    place = (angle / (2 * np.pi) % 1.0 * _BINS).astype(np.int64) % _BINS
    clear = (t > inner[place]) & (t < outer[place])
    bins = angle_bin(ellipse.normals(angle))
    return _RimBand(angle, t, picture.grey[raw[:, 1], raw[:, 0]], clear, bins)


def _clear_range(
    expected: Ellipse, others: DrawnEdges, own: IntArray, half_width_px: float
) -> tuple[FloatArray, FloatArray]:
    """Per bin of the rim: how far in and out no other predicted line disturbs."""
    centre = np.array([expected.x_px, expected.y_px])
    reach = max(expected.axes_px) / 2 + half_width_px + 10 + others.blur_px
    box = np.abs((others.start_px + others.end_px) / 2 - centre)
    half = np.abs(others.end_px - others.start_px) / 2
    close = (box - half < reach[:, None]).all(axis=1)
    foreign = ~np.isin(others.edge, own)
    places, guard = _sampled(others, np.flatnonzero(foreign & close))
    angle = expected.nearest(places)
    t = expected.distance(places, angle)
    near = np.abs(t) < half_width_px + 6 + guard
    angle, t, guard = angle[near], t[near], guard[near]
    outer, inner = np.full(_BINS, np.inf), np.full(_BINS, -np.inf)
    # A line reaches as many bins to either side as its guard is wide.
    per_px = _BINS / expected.circumference_px
    first = np.floor((angle / (2 * np.pi) % 1.0) * _BINS).astype(np.int64)
    widest = int(np.ceil(float(guard.max(initial=0.0)) * per_px))
    for step in range(-widest, widest + 1):
        reached = np.flatnonzero(np.ceil(guard * per_px) >= abs(step))
        place = (first[reached] + step) % _BINS
        at, half = t[reached], guard[reached]
        np.minimum.at(outer, place, np.where(at > -half, at - half, np.inf))
        np.maximum.at(inner, place, np.where(at < half, at + half, -np.inf))
    return inner, outer


def _sampled(others: DrawnEdges, which: IntArray) -> tuple[FloatArray, FloatArray]:
    """Points every half pixel along pieces, with the half width of their spread."""
    start, end = others.start_px[which], others.end_px[which]
    count = (np.linalg.norm(end - start, axis=1) * 2).astype(np.int64) + 2
    piece = np.repeat(np.arange(len(which)), count)
    first = np.cumsum(count) - count
    share = (np.arange(len(piece)) - first[piece]) / (count[piece] - 1)
    places = start[piece] + share[:, None] * (end - start)[piece]
    return places, (_GUARD_PX + others.blur_px[which] / 2)[piece]


def _sector_basis(angle: FloatArray, ellipse: Ellipse) -> FloatArray:
    """Periodic hats (n, sectors): levels may change along the rim."""
    low, high = _LEVEL_SECTORS
    sectors = int(np.clip(ellipse.circumference_px / _SECTOR_PX, low, high))
    place = (angle / (2 * np.pi) % 1.0) * sectors
    away = np.abs(place[:, None] - np.arange(sectors)[None])
    away = np.minimum(away, sectors - away)
    return np.asarray(np.clip(1 - away, 0, None))


def _fit(
    picture: Picture,
    ellipse: Ellipse,
    band: _RimBand,
    blur_px: float,
    keep: BoolArray | None,
) -> StepFit | None:
    chosen = np.flatnonzero(band.clear if keep is None else band.clear & keep)
    if len(chosen) < _FEWEST_PIXELS:
        return None
    chosen = chosen[:: -(-len(chosen) // _CAP)]
    angle = band.angle[chosen]
    samples = StepSamples(
        band.t_px[chosen],
        ellipse.modes(angle),
        _sector_basis(angle, ellipse),
        band.grey[chosen],
        band.bins[chosen],
    )
    fit = fit_step(
        samples,
        picture.plane.optics,
        place=np.zeros(5),
        q_px2=max(blur_px, 0.7) ** 2,
        shading=False,
    )
    return rescaled(fit, picture.noise)


@dataclass(frozen=True, eq=False)
class _Blocks:
    """Blocks of even eccentric angle: judged, and good."""

    judged: BoolArray
    good: BoolArray

    @property
    def fraction(self) -> float:
        return float(self.good.sum() / max(self.judged.sum(), 1))

    def usable(self, angle: FloatArray) -> BoolArray:
        return np.asarray((self.good | ~self.judged)[_block_of(angle, len(self.good))])


def _block_of(angle: FloatArray, count: int) -> IntArray:
    return np.asarray((angle / (2 * np.pi) % 1.0 * count).astype(np.int64) % count)


def _blocks(
    picture: Picture,
    ellipse: Ellipse,
    band: _RimBand,
    fit: StepFit,
    rim: ExpectedRim,
) -> _Blocks:
    count = max(int(ellipse.circumference_px / BLOCK_PX), 6)
    angle = band.angle[band.clear]
    basis = _sector_basis(angle, ellipse)
    across = band.t_px[band.clear] - ellipse.modes(angle) @ fit.place
    contrast = fit.high - fit.low
    bins = band.bins[band.clear]
    samples = BlockSamples(
        _block_of(angle, count),
        count,
        basis @ contrast,
        spread_at(picture.plane.optics, across, fit.q_px2, bins),
        band.grey[band.clear] - basis @ fit.low,
    )
    judged, good = judge_blocks(
        samples,
        noise=picture.noise,
        blur_px=float(np.sqrt(max(fit.q_px2, 0.0))),
        height=float(np.median(np.abs(contrast))),
    )
    judged &= _expected_blocks(rim, count)
    return _Blocks(judged, good & judged)


def _expected_blocks(rim: ExpectedRim, count: int) -> BoolArray:
    """Blocks in which the plan sees the rim with an even contrast.

    Where the step jumps another edge runs into the rim; where it changes sign there is
    none.
    """
    plan = fitted_ellipse(rim.points_px)
    angle = plan.nearest(rim.points_px)
    seen = rim.visible & ~(rim.contrast < FAINT)
    seen &= rim.even if len(rim.even) else True
    middle = (np.arange(count) + 0.5) / count * 2 * np.pi
    away = np.abs(np.angle(np.exp(1j * (middle[:, None] - angle[None]))))
    return np.asarray(seen[away.argmin(axis=1)])


def _measurement(
    picture: Picture, start: Ellipse, band: _RimBand, fit: StepFit, visible: float
) -> RimMeasurement:
    step = float(np.median(np.abs(fit.high - fit.low)))
    core = band.clear & (np.abs(band.t_px) < 2.0)
    clipped = band.grey[core] >= SATURATED
    reason = ""
    if step < _LEAST_SNR * picture.noise:
        reason = "no step above the noise"
    elif visible < 0.3:
        reason = "seen on less than a third of its length"
    return RimMeasurement(
        found=not reason,
        reason=reason,
        ellipse=_displaced(start, fit.place),
        axes_sd_px=_axes_sd(start, fit),
        blur_q_px2=fit.q_px2,
        blur_q_sd=float(np.sqrt(max(fit.covariance[5, 5], 0.0))),
        step=step,
        snr=step / picture.noise,
        saturated=float(clipped.mean()) if len(clipped) else 0.0,
        visible_fraction=visible,
    )


def _displaced(ellipse: Ellipse, place: FloatArray) -> Ellipse:
    """The ellipse moved along its normals by the fitted modes."""
    angle = np.arange(72) / 72 * 2 * np.pi
    off = ellipse.modes(angle) @ place
    return fitted_ellipse(ellipse.points(angle) + off[:, None] * ellipse.normals(angle))


def _axes_sd(ellipse: Ellipse, fit: StepFit) -> tuple[float, float]:
    """Standard deviations of the full axes by differences over the five modes."""
    base = np.array(_displaced(ellipse, fit.place).axes_px)
    by_mode = np.stack(
        [
            (np.array(_displaced(ellipse, fit.place + step).axes_px) - base) / 0.05
            for step in 0.05 * np.eye(5)
        ],
        axis=1,
    )
    covariance = by_mode @ fit.covariance[:5, :5] @ by_mode.T
    sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return float(sd[0]), float(sd[1])
