"""From measurements to the one most likely fault, in a fixed order."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from mvp.imaging.blur_excess import BlurExcess
    from mvp.imaging.expectation import ViewExpectation
    from mvp.imaging.register import Alignment
    from mvp.imaging.verify_data import Cause, Exposure

_OVEREXPOSED_SHARE = 0.8
_UNDEREXPOSED_LEVEL = 0.15
_MOTION_PX2 = 3.0
_BLUR_IN_C2 = 1.5
_ZOOM_SCALE = 0.025
_ZOOM_SHIFT_PX = 6.0
_ZOOM_ROLL_DEG = 0.8
_ZOOM_RESIDUAL_PX = 0.45
_SHIFT_PX = 3.0
_ROLL_DEG = 0.5
_RESIDUAL_PX = 0.35
_SCALE = 0.01
_SURE_SD = 3.0
_CLIPPED_SHARE = 0.5

CHECK_FIRST: dict[Cause, str] = {
    "overexposed": "shorten the exposure or dim the light; was the exposure metered?",
    "underexposed": "is the light on? is the iris open? lengthen the exposure",
    "motion": "settle time of the arm, vibration of the mount, frame time stamps",
    "defocus": "focus motor position and backlash, lens table, extension tube",
    "zoom": "zoom and focus motor positions and lens table (focal length), and the size "
    "(scale) of the part",
    "misalignment": "part in its place? then hand-eye and part-pose calibration",
    "occlusion": "something in front of the part: clamps, cables, chips, a wrong part",
    "low contrast": "move the light: both faces of the edge have the same grey",
    "resolution": "camera too far or zoom too short; is the requirement right?",
    "shape": "compare the part to its CAD file: revision, scale, damage",
    "no end found": "choose a feature that ends at corners the camera can see",
}


@dataclass(frozen=True)
class Evidence:
    """All that a cause is judged from.

    Attributes:
        alignment: of the whole picture against the plan.
        residual_px: what it leaves (root mean square).
        excess: blur beyond prediction.
        lost: features that were not found or are seen on less than three quarters,
            although they should stand out.
        found: share of the expected edge length that was found.
        clipped: share of the feature edges and their neighbours with saturated pixels.
        kept: every feature was found where the plan and the other edges put it.
        witnesses: how many edges the residual rests on.
        scale_sd: standard deviation of the alignment's scale.
    """

    alignment: Alignment
    residual_px: float
    excess: BlurExcess | None
    lost: tuple[str, ...]
    found: float
    clipped: float = 0.0
    kept: bool = False
    witnesses: int = 0
    scale_sd: float = 0.0

    @property
    def roll_deg(self) -> float:
        """Turn of the picture, without its sign."""
        return abs(float(np.rad2deg(self.alignment.roll_rad)))

    @property
    def scale_change(self) -> float:
        """Relative change of size, with its sign."""
        return self.alignment.scale - 1


@dataclass(frozen=True)
class Finding:
    """A cause and a sentence with its figures."""

    cause: Cause
    explanation: str


def exposure_fault(exposure: Exposure) -> Finding | None:
    """Too bright or too dark to measure anything."""
    if exposure.saturated > _OVEREXPOSED_SHARE:
        return Finding(
            "overexposed",
            f"{exposure.saturated:.0%} of the pixels about the features are saturated"
            f" (limit {_OVEREXPOSED_SHARE:.0%})",
        )
    if exposure.level_95 < _UNDEREXPOSED_LEVEL:
        return Finding(
            "underexposed",
            f"about the features the grey level reaches only {exposure.level_95:.0%}"
            f" of full scale (limit {_UNDEREXPOSED_LEVEL:.0%})",
        )
    return None


def picture_fault(evidence: Evidence, expectation: ViewExpectation) -> Finding | None:
    """Motion, defocus, zoom, misalignment, occlusion: the first that applies."""
    for judge in (_blur_fault, _scale_fault, _clipped_fault, _place_fault):
        finding = judge(evidence, expectation)
        if finding is not None:
            return finding
    if evidence.lost:
        names = ", ".join(evidence.lost)
        return Finding(
            "occlusion",
            f"{names}: hidden or interrupted, while the rest is in its place",
        )
    return None


def _blur_fault(evidence: Evidence, expectation: ViewExpectation) -> Finding | None:
    excess = evidence.excess
    if excess is None:
        return None
    limit = _BLUR_IN_C2 * max(expectation.c_px, 0.8) ** 2
    directional = excess.directional_px2
    if (
        directional > max(_MOTION_PX2, limit)
        and directional > 1.5 * excess.with_direction_px2
        and excess.gain > 2.0
    ):
        angle = np.rad2deg(excess.direction_rad)
        return Finding(
            "motion",
            f"edges are smeared over about {excess.path_px:.1f} px along {angle:.0f} deg"
            f" (blur along it {np.sqrt(directional):.1f} px, limit "
            f"{np.sqrt(max(_MOTION_PX2, limit)):.1f} px)",
        )
    if excess.isotropic_px2 > limit:
        return Finding(
            "defocus",
            "all edges are blurred by about "
            f"{np.sqrt(excess.isotropic_px2):.1f} px more than planned (limit "
            f"{np.sqrt(limit):.1f} px)",
        )
    return None


def _scale_fault(evidence: Evidence, expectation: ViewExpectation) -> Finding | None:
    """A large change of size, which brings small shifts and turns of its own."""
    limit = max(_ZOOM_SCALE, 2 * scale_tolerance(expectation))
    if (
        abs(evidence.scale_change) > limit
        and evidence.alignment.shift_px
        < max(_ZOOM_SHIFT_PX, shift_tolerance_px(expectation))
        and evidence.roll_deg < _ZOOM_ROLL_DEG
        and evidence.residual_px < _ZOOM_RESIDUAL_PX
    ):
        text = f"scaled by {evidence.scale_change:+.1%} (limit {limit:.1%})"
        return Finding("zoom", f"the picture is {text} against the plan")
    return None


def _clipped_fault(evidence: Evidence, expectation: ViewExpectation) -> Finding | None:
    """Clipping moves edges; something bright in the way clips only a few of them."""
    if evidence.clipped < _CLIPPED_SHARE or not expectation.feature_edges:
        return None
    return Finding(
        "overexposed",
        f"{evidence.clipped:.0%} of the edges about the features are saturated"
        f" (limit {_CLIPPED_SHARE:.0%})",
    )


def _place_fault(evidence: Evidence, expectation: ViewExpectation) -> Finding | None:
    broken = _Limits.of(expectation).broken(evidence)
    if not broken:
        return None
    # A wrong pose also shifts, turns or distorts; size alone is a matter of the lens or
    # of the part.
    size_alone = [word for word, _ in broken] == ["scaled"]
    cause: Cause = "zoom" if size_alone else "misalignment"
    return Finding(cause, "; ".join(text for _, text in broken))


@dataclass(frozen=True)
class _Limits:
    """How far a whole picture may lie from the plan."""

    shift_px: float
    roll_deg: float
    scale: float
    residual_px: float

    @classmethod
    def of(cls, expectation: ViewExpectation) -> _Limits:
        """What the plan's tolerance explains, or what measuring leaves."""
        return cls(
            max(_SHIFT_PX, shift_tolerance_px(expectation)),
            max(_ROLL_DEG, expectation.tolerance.angle_deg),
            max(_SCALE, scale_tolerance(expectation)),
            residual_limit_px(expectation),
        )

    def broken(self, evidence: Evidence) -> list[tuple[str, str]]:
        """The rules that do not hold: a word, and a text with number and limit.

        Edges that fit no common motion accuse nobody while every feature is found in
        its place.
        """
        shift_px, change = evidence.alignment.shift_px, evidence.scale_change
        broken = []
        if shift_px > self.shift_px:
            text = f"shifted by {shift_px:.1f} px (limit {self.shift_px:.1f} px)"
            broken.append(("shifted", f"the picture is {text} against the plan"))
        if evidence.roll_deg > self.roll_deg:
            text = (
                f"turned by {evidence.roll_deg:.2f} deg (limit {self.roll_deg:.2f} deg)"
            )
            broken.append(("turned", f"the picture is {text} against the plan"))
        if abs(change) > max(self.scale, _SURE_SD * evidence.scale_sd):
            text = f"scaled by {change:+.1%} (limit {self.scale:.1%})"
            broken.append(("scaled", f"the picture is {text} against the plan"))
        excused = evidence.kept and np.isfinite(evidence.residual_px)
        if evidence.residual_px > self.residual_px and not excused:
            broken.append(("residual", residual_words(evidence, self.residual_px)))
        return broken


def residual_words(evidence: Evidence, limit_px: float) -> str:
    """What the best shift, turn and scale leave of the edges."""
    if not np.isfinite(evidence.residual_px):
        return "too few of the expected edges were found to say where the picture lies"
    return (
        f"the edges do not lie to each other as planned: residual of "
        f"{evidence.witnesses} edges {evidence.residual_px:.2f} px, limit "
        f"{limit_px:.2f} px"
    )


def residual_limit_px(expectation: ViewExpectation) -> float:
    """How badly edges may fit a shift, turn and scale."""
    return max(_RESIDUAL_PX, parallax_tolerance_px(expectation))


def _depth_mm(expectation: ViewExpectation) -> float:
    depths = [edge.depth_mm for edge in expectation.edges if edge.role != "auxiliary"]
    depths += [float(rim.centre_mm[2]) for rim in expectation.rims]
    depths += [float(point.point_mm[2]) for point in expectation.points]
    return float(np.median(depths)) if depths else 1e3


def shift_tolerance_px(
    expectation: ViewExpectation, place_px: tuple[float, float] = (0.0, 0.0)
) -> float:
    """How far a point may be off when pose and focus use up their tolerance."""
    plane, tolerance = expectation.plane, expectation.tolerance
    f_px = plane.f_cal_mm / plane.px_mm
    radius = float(np.hypot(*place_px))
    turn = np.deg2rad(tolerance.angle_deg) * (f_px + radius**2 / f_px)
    shift = f_px * tolerance.position_mm / _depth_mm(expectation)
    return float(turn + shift + radius * scale_tolerance(expectation))


def parallax_tolerance_px(expectation: ViewExpectation) -> float:
    """How far edges at different depths part when the camera uses up its tolerance."""
    depths = [edge.depth_mm for edge in expectation.edges]
    if not depths:
        return 0.0
    f_px = expectation.plane.f_cal_mm / expectation.plane.px_mm
    spread = 1 / min(depths) - 1 / max(depths)
    return float(f_px * expectation.tolerance.position_mm * spread / 2)


def scale_tolerance(expectation: ViewExpectation) -> float:
    """Relative change of size when pose and focus use up their tolerance."""
    tolerance = expectation.tolerance
    along = tolerance.position_mm / _depth_mm(expectation)
    return float(along + tolerance.d_mm / expectation.plane.d_mm)
