"""One straight edge measured in a picture: place, slope, blur, visibility."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from mvp.imaging.edge_blocks import (
    BLOCK_PX,
    BlockSamples,
    judge_blocks,
    share_with_step,
)
from mvp.imaging.edge_fit import StepFit, StepSamples, fit_step, rescaled
from mvp.imaging.edge_samples import Band, Line, Picture, band_of
from mvp.imaging.edge_search import find_start
from mvp.imaging.esf import BLUR_MAX_PX, angle_bin, spread_at

if TYPE_CHECKING:
    from mvp.geometry import BoolArray, FloatArray, IntArray
    from mvp.imaging.expectation import DrawnEdges

WINDOW_PX = 4.0
SATURATED = 0.975
FAINT = 0.03
# A fainter step is not told from a slope of the grey across it.
SHADED_SNR = 10.0
_CAP = {"feature": 2400, "neighbour": 1200, "auxiliary": 900}
_SMALLEST_SNR = 4.0
_FEWEST_PIXELS = 40


@dataclass(frozen=True, eq=False)
class EdgeMeasurement:
    """What the picture says about one edge.

    Attributes:
        found: a step was fitted that is significant and where it was searched.
        reason: why not.
        line: the measured line, its ends the expected ends moved across.
        offset_px: of the measured from the expected line, at the middle of the piece.
        slope: its turn against the expected line, rad.
        covariance: (2, 2) of offset and slope.
        blur_q_px2: b^2 of the fit, may be slightly negative.
        blur_q_sd: its standard deviation.
        step: signed difference of the two levels, fraction of full scale.
        step_slope: how much it grows from the middle to the end.
        snr: |step| over the noise of one pixel.
        misfit: residual over noise.
        saturated: share of clipped pixels in the band.
        visible_fraction: share of its blocks that show the step.
        extent_px: first and last place (along, from the middle) that shows the step.
    """

    found: bool
    reason: str
    line: Line
    offset_px: float = float("nan")
    slope: float = float("nan")
    covariance: FloatArray | None = None
    blur_q_px2: float = float("nan")
    blur_q_sd: float = float("nan")
    step: float = float("nan")
    step_slope: float = 0.0
    snr: float = 0.0
    misfit: float = float("nan")
    saturated: float = 0.0
    visible_fraction: float = 0.0
    extent_px: tuple[float, float] = (float("nan"), float("nan"))

    @property
    def blur_px(self) -> float:
        """Blur diameter."""
        return float(np.sqrt(max(self.blur_q_px2, 0.0)))

    @property
    def offset_sd_px(self) -> float:
        """Standard deviation of the offset."""
        if self.covariance is None:
            return float("nan")
        return float(np.sqrt(max(self.covariance[0, 0], 0.0)))


@dataclass(frozen=True)
class EdgeTask:
    """How to measure one edge.

    Attributes:
        role: feature, neighbour or auxiliary: how many pixels are spent.
        search_px: how far from the expected line to look.
        blur_px: where the blur search starts.
        visible: expected visibility at even places along the line.
    """

    role: str
    search_px: float
    blur_px: float
    visible: BoolArray


def measure_edge(
    picture: Picture, line: Line, others: DrawnEdges, task: EdgeTask
) -> EdgeMeasurement:
    """Search, fit, drop blocks that do not show the step, fit again."""
    start = find_start(picture, line, task.search_px, task.blur_px)
    if start is None:
        return EdgeMeasurement(False, "outside the picture", line)
    shifted = _moved(line, start.offset_px, start.slope)
    moved_others = _shifted(others, start.offset_px * line.across)
    window = WINDOW_PX + task.blur_px
    band = band_of(picture, shifted, window, moved_others, extra_blur_px=0.0)
    fit = _fit(picture, shifted, band, task, None)
    if fit is None:
        return EdgeMeasurement(False, "too few pixels", line)
    if fit.q_px2 > (1.6 * task.blur_px + 2.0) ** 2:
        blur = min(float(np.sqrt(fit.q_px2)), BLUR_MAX_PX)
        window = WINDOW_PX + blur
        extra = max(blur - task.blur_px, 0.0)
        band = band_of(picture, shifted, window, moved_others, extra_blur_px=extra)
        fit = _fit(picture, shifted, band, task, fit) or fit
    blocks = _blocks(shifted, band, fit, picture, task)
    if 0.3 < blocks.fraction < 0.999:
        kept = _fit(picture, shifted, band, task, fit, blocks.good_at(band.s_px))
        if kept is not None:
            fit = kept
            blocks = _blocks(shifted, band, fit, picture, task)
    return _measurement(picture, line, shifted, band, fit, blocks, task)


def share_seen(
    picture: Picture, line: Line, others: DrawnEdges, blur_px: float
) -> float:
    """How much of a line shows some step, when no step was found on the whole."""
    band = band_of(picture, line, 2.5 + blur_px / 2, others)
    index, count, _ = _block_index(line, band)
    use = band.clear & (index >= 0) & (index < count)
    bins = np.full(int(use.sum()), int(angle_bin(line.across)))
    samples = BlockSamples(
        index[use],
        count,
        np.ones(int(use.sum())),
        spread_at(picture.plane.optics, band.t_px[use], blur_px**2, bins),
        band.grey[use],
    )
    return share_with_step(samples, noise=picture.noise)


def _block_index(line: Line, band: Band) -> tuple[IntArray, int, float]:
    """Block of every pixel, their number, and where the first one begins."""
    count = max(int((line.length_px - 2 * BLOCK_PX) // BLOCK_PX), 1)
    first = -count * BLOCK_PX / 2
    return np.floor((band.s_px - first) / BLOCK_PX).astype(np.int64), count, first


def _moved(line: Line, offset_px: float, slope: float) -> Line:
    half = slope * line.length_px / 2
    return Line(
        line.start_px + (offset_px - half) * line.across,
        line.end_px + (offset_px + half) * line.across,
    )


def _shifted(others: DrawnEdges, by_px: FloatArray) -> DrawnEdges:
    return replace(
        others, start_px=others.start_px + by_px, end_px=others.end_px + by_px
    )


def trim_px(line: Line, blur_px: float) -> float:
    """What is left out at each end, where other edges join."""
    return float(min(max(0.12 * line.length_px, blur_px / 2 + 1), 0.3 * line.length_px))


def _basis(line: Line, s_px: FloatArray) -> FloatArray:
    return np.stack([np.ones_like(s_px), s_px / (line.length_px / 2)], axis=1)


def _fit(
    picture: Picture,
    line: Line,
    band: Band,
    task: EdgeTask,
    before: StepFit | None,
    keep: BoolArray | None = None,
) -> StepFit | None:
    blur = task.blur_px if before is None else float(np.sqrt(max(before.q_px2, 0.0)))
    inside = band.clear & (np.abs(band.s_px) < line.length_px / 2 - trim_px(line, blur))
    if keep is not None:
        inside &= keep
    chosen = np.flatnonzero(inside)
    if len(chosen) < _FEWEST_PIXELS:
        return None
    chosen = chosen[:: max(1, len(chosen) // _CAP[task.role])]
    basis = _basis(line, band.s_px[chosen])
    bins = np.full(len(chosen), int(angle_bin(line.across)))
    samples = StepSamples(band.t_px[chosen], basis, basis, band.grey[chosen], bins)
    place = np.zeros(2) if before is None else before.place
    fit = fit_step(
        samples,
        picture.plane.optics,
        place=place,
        q_px2=max(blur, 0.7) ** 2,
        shading=False,
    )
    height = abs(float(fit.high[0] - fit.low[0]))
    if height > SHADED_SNR * max(fit.noise, picture.noise):
        fit = fit_step(
            samples,
            picture.plane.optics,
            place=fit.place,
            q_px2=fit.q_px2,
            shading=True,
        )
    return rescaled(fit, picture.noise)


@dataclass(frozen=True, eq=False)
class _Blocks:
    """Blocks along an edge: middle (from the middle of the edge), judged, good."""

    places_px: FloatArray
    judged: BoolArray
    good: BoolArray
    first_px: float

    @property
    def fraction(self) -> float:
        return float(self.good.sum() / max(self.judged.sum(), 1))

    def good_at(self, s_px: FloatArray) -> BoolArray:
        index = np.floor((s_px - self.first_px) / BLOCK_PX).astype(np.int64)
        inside = (index >= 0) & (index < len(self.good))
        ok = self.good | ~self.judged
        return np.asarray(inside & ok[np.clip(index, 0, len(ok) - 1)])


def _blocks(
    line: Line, band: Band, fit: StepFit, picture: Picture, task: EdgeTask
) -> _Blocks:
    """The step in blocks along the edge, the first and last 6 px left out."""
    half = line.length_px / 2
    index, count, first = _block_index(line, band)
    use = band.clear & (index >= 0) & (index < count)
    basis = _basis(line, band.s_px[use])
    across = band.t_px[use] - basis @ fit.place
    bins = np.full(len(across), int(angle_bin(line.across)))
    samples = BlockSamples(
        index[use],
        count,
        basis @ (fit.high - fit.low),
        spread_at(picture.plane.optics, across, fit.q_px2, bins),
        band.grey[use] - basis @ fit.low,
    )
    judged, good = judge_blocks(
        samples,
        noise=picture.noise,
        blur_px=float(np.sqrt(max(fit.q_px2, 0.0))),
        height=abs(float(fit.high[0] - fit.low[0])),
    )
    places = np.asarray(first + (np.arange(count) + 0.5) * BLOCK_PX, np.float64)
    share = (places + half) / line.length_px * (len(task.visible) - 1)
    nearest = np.clip(np.rint(share).astype(int), 0, len(task.visible) - 1)
    judged &= task.visible[nearest]
    return _Blocks(places, judged, good & judged, first)


def _measurement(
    picture: Picture,
    line: Line,
    shifted: Line,
    band: Band,
    fit: StepFit,
    blocks: _Blocks,
    task: EdgeTask,
) -> EdgeMeasurement:
    offset, slope = fit.place[0], fit.place[1] / (shifted.length_px / 2)
    measured = _moved(shifted, float(offset), float(slope))
    middle, turn = _against(line, measured)
    scale = np.diag([1.0, 2 / shifted.length_px])
    step, step_slope = map(float, fit.high - fit.low)
    snr = abs(step) / max(picture.noise, 1e-9)
    core = np.abs(band.t_px) < 2.0 + np.sqrt(max(fit.q_px2, 0.0)) / 2
    clipped = band.grey[core & band.clear] >= SATURATED
    good = blocks.places_px[blocks.good]
    extent = (
        (float(good.min()) - BLOCK_PX / 2, float(good.max()) + BLOCK_PX / 2)
        if len(good)
        else (float("nan"), float("nan"))
    )
    reason = ""
    if snr < _SMALLEST_SNR:
        reason = "no step above the noise"
    elif abs(middle) > task.search_px + 2.5 or abs(turn) > 0.12:
        reason = "the fit left the search band"
    elif blocks.fraction < 0.3:
        reason = "seen on less than a third of its length"
    return EdgeMeasurement(
        found=not reason,
        reason=reason,
        line=measured,
        offset_px=middle,
        slope=turn,
        covariance=scale @ fit.covariance[:2, :2] @ scale,
        blur_q_px2=fit.q_px2,
        blur_q_sd=float(np.sqrt(max(fit.covariance[2, 2], 0.0))),
        step=step,
        step_slope=step_slope,
        snr=snr,
        misfit=fit.noise / picture.noise,
        saturated=float(clipped.mean()) if len(clipped) else 0.0,
        visible_fraction=blocks.fraction,
        extent_px=extent,
    )


def _against(line: Line, measured: Line) -> tuple[float, float]:
    """Offset at the middle and turn of a measured line against an expected one."""
    first = float(line.place(measured.start_px)[1])
    last = float(line.place(measured.end_px)[1])
    return (first + last) / 2, (last - first) / max(line.length_px, 1e-9)
