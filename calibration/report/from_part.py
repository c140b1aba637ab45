"""The report of a part that was found in the cell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibration.part_pose import own_shares
from calibration.part_pose.problem import rim_centres
from calibration.poses import Poses, only
from calibration.projection import project, skew
from calibration.report.model import Quantity, ReportData
from calibration.report.plots import (
    BudgetPart,
    Coverage,
    ErrorBudget,
    Outline,
    ResidualField,
    Scene,
    ViewBars,
)
from calibration.report.shapes import (
    NORMAL_95,
    axes_length_mm,
    axes_outline,
    drawn_reach_mm,
    half_angles,
    matrices,
    pose_quantities,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibration.part_pose import (
        HandEye,
        LocatedPart,
        PartSight,
        PartView,
        Resection,
    )
    from calibration.projection import PinholeCamera
    from calibration.report.model import About
    from calibration.verdict import Verdict
    from mvp.geometry import FloatArray


_EDGE_PIECES = 60
_GOOD_COVERAGE = (
    "Good: features far apart in the picture. They need not fill it: lens and sensor were "
    "calibrated before."
)


@dataclass(frozen=True, eq=False)
class PartPicture:
    """One picture of the part.

    Attributes:
        name: as in the bars.
        camera: at the lens setting of the picture.
        size_px: columns and rows.
        sight: what was seen.
        resection: the poses that explain it.
        view: the chosen pose, with the tool's.
    """

    name: str
    camera: PinholeCamera
    size_px: tuple[int, int]
    sight: PartSight
    resection: Resection
    view: PartView


def part_report(
    located: LocatedPart,
    pictures: Sequence[PartPicture],
    hand_eye: HandEye,
    about: About,
    *,
    verdict: Verdict,
    outline_mm: Sequence[FloatArray] = (),
) -> ReportData:
    """Everything that the page of a part's pose shows.

    Args:
        located: the result.
        pictures: what it was made from, in the order of ``located.off``.
        hand_eye: with its covariance and the robot's.
        about: device, day, pictures.
        verdict: of all pictures and of their agreement.
        outline_mm: polylines (k, 3) of the part, to draw; what was seen when empty.
    """
    middle = np.concatenate([p.sight.places_part_mm for p in pictures]).mean(axis=0)
    parts = _shares(located, pictures, hand_eye, middle)
    total = float(np.sqrt(sum(part.sigma_mm**2 for part in parts)))
    distance = float(np.mean([_distance_mm(p, middle) for p in pictures]))
    many = f"{len(pictures)} pictures" if len(pictures) > 1 else "one picture"
    return ReportData(
        "part",
        about,
        f"From {many} the features of the part are known to {NORMAL_95 * total:.2g} mm "
        "(95 %, over all three axes) in the cell.",
        verdict,
        _quantities(located),
        (
            ErrorBudget(distance, "the middle of the features, all three axes", parts),
            _bars(pictures),
            _apart(located, pictures),
            _scene(located, pictures, hand_eye, outline_mm, middle),
            *_in_the_picture(pictures),
        ),
        (_branches(pictures),),
    )


def _quantities(located: LocatedPart) -> tuple[Quantity, ...]:
    return (
        *pose_quantities(located.base_from_part, located.covariance, "part in base"),
        Quantity(
            "chance of views that disagree so much",
            100 * located.probability,
            None,
            "%",
            "if all stated uncertainties are right",
        ),
    )


def _in_the_picture(
    pictures: Sequence[PartPicture],
) -> tuple[()] | tuple[ResidualField, Coverage]:
    """Where points were seen and how far off; nothing where no points were used."""
    pixels, errors = _residuals(pictures)
    if not len(pixels):
        return ()
    size = pictures[0].size_px
    sigma = float(np.sqrt(np.mean([_noise_px(p.sight) ** 2 for p in pictures])))
    field = ResidualField(pixels, errors, size, sigma)
    return field, Coverage.of(pixels, size, _GOOD_COVERAGE)


def _distance_mm(picture: PartPicture, middle: FloatArray) -> float:
    return float(np.linalg.norm(picture.view.camera_from_part.apply(middle)))


def _noise_px(sight: PartSight) -> float:
    kinds = (sight.points, sight.circles, sight.edges)
    return max(kind.sigma_px for kind in kinds if len(kind.pixels))


def _residuals(pictures: Sequence[PartPicture]) -> tuple[FloatArray, FloatArray]:
    """Pixels (m, 2) and errors (m, 2) of points and rims; of edges across them."""
    pixels, errors = [np.zeros((0, 2))], [np.zeros((0, 2))]
    for picture in pictures:
        pose = picture.view.camera_from_part
        state = (pose.rotation, pose.translation_mm)
        points, circles = picture.sight.points, picture.sight.circles
        if len(points.pixels):
            pixels.append(points.pixels)
            predicted = project(picture.camera, *state, points.points_part_mm)
            errors.append(predicted - points.pixels)
        if len(circles.pixels):
            pixels.append(circles.pixels)
            predicted, _ = rim_centres(picture.camera, *state, circles)
            errors.append(predicted - circles.pixels)
        if len(picture.sight.edges.pixels):
            pixels.append(picture.sight.edges.pixels)
            errors.append(_across_edges(picture))
    return np.concatenate(pixels), np.concatenate(errors)


def _across_edges(picture: PartPicture) -> FloatArray:
    """(k, 2): from each place found on an edge straight to the predicted edge."""
    edges, pose = picture.sight.edges, picture.view.camera_from_part
    share = np.linspace(-0.02, 1.02, _EDGE_PIECES)[:, None]
    ends = edges.ends_part_mm
    along = ends[:, :1] + share * (ends[:, 1:] - ends[:, :1])
    lines = project(picture.camera, pose.rotation, pose.translation_mm, along)
    slopes = np.gradient(lines, axis=1)
    slopes = slopes / np.linalg.norm(slopes, axis=2, keepdims=True)
    off = lines[edges.edge] - edges.pixels[:, None]
    rows = np.arange(len(off))
    nearest = np.linalg.norm(off, axis=2).argmin(axis=1)
    shift, slope = off[rows, nearest], slopes[edges.edge, nearest]
    return np.asarray(shift - (shift * slope).sum(axis=1, keepdims=True) * slope)


def _shares(
    located: LocatedPart,
    pictures: Sequence[PartPicture],
    hand_eye: HandEye,
    middle: FloatArray,
) -> tuple[BudgetPart, ...]:
    """Picture, robot and hand-eye: what each does to the middle of the features."""
    lever = located.base_from_part.rotate(middle)
    at = np.hstack([np.eye(3), -skew(lever)])
    by_picture, by_robot = own_shares([p.view for p in pictures], hand_eye)
    eye = located.by_hand_eye @ hand_eye.covariance @ located.by_hand_eye.T
    named = (
        ("calibration", eye, "hand-eye, the same in all views"),
        ("robot", by_robot, "its poses in these views"),
        ("pixel noise", by_picture, "features found in the pictures"),
    )
    return tuple(
        BudgetPart(name, float(np.sqrt(np.trace(at @ spread @ at.T))), source)
        for name, spread, source in named
    )


def _bars(pictures: Sequence[PartPicture]) -> ViewBars:
    return ViewBars(
        "residual of each picture, by its stated noise (RMS)",
        "sigma",
        tuple(picture.name for picture in pictures),
        np.array([picture.resection.best.error_sigma for picture in pictures]),
        1.5,
        "a feature was mistaken for another, or the intrinsics do not fit",
    )


def _apart(located: LocatedPart, pictures: Sequence[PartPicture]) -> ViewBars:
    return ViewBars(
        "where each picture puts the part, off the mean",
        "mm",
        tuple(picture.name for picture in pictures),
        np.linalg.norm(located.off[:, :3], axis=1),
        None,
        "the part moved, or the hand-eye calibration is off",
    )


def _scene(
    located: LocatedPart,
    pictures: Sequence[PartPicture],
    hand_eye: HandEye,
    outline_mm: Sequence[FloatArray],
    middle: FloatArray,
) -> Scene:
    tools = Poses.of([picture.view.base_from_tool for picture in pictures])
    cameras = tools @ only(hand_eye.tool_from_camera)
    part = located.base_from_part
    lines = list(outline_mm) or [
        edge for picture in pictures for edge in picture.sight.edges.ends_part_mm
    ]
    marks = [_cross_mark(p) for picture in pictures for p in _places(picture.sight)]
    shown = lines or [line for mark in marks for line in mark]
    distances = np.array([_distance_mm(picture, middle) for picture in pictures])
    arms = np.stack([tools.translation_mm, cameras.translation_mm], axis=1)
    first = pictures[0]
    return Scene(
        "base",
        matrices(cameras),
        tuple(picture.name for picture in pictures),
        half_angles(first.camera, first.size_px),
        drawn_reach_mm(distances),
        (
            Outline("part", tuple(part.apply(line) for line in shown), "part"),
            Outline("hand", tuple(arms), "robot"),
            axes_outline(only(part), 0.5 * axes_length_mm(distances)),
        ),
    )


def _places(sight: PartSight) -> FloatArray:
    return np.concatenate([sight.points.points_part_mm, sight.circles.centres_part_mm])


def _cross_mark(place: FloatArray) -> list[FloatArray]:
    """Three short lines through a point."""
    return [place + np.outer([-1.5, 1.5], axis) for axis in np.eye(3)]


def _branches(
    pictures: Sequence[PartPicture],
) -> tuple[str, tuple[str, ...], tuple[tuple[str, ...], ...]]:
    rows = []
    for picture in pictures:
        found = picture.resection
        if len(found.branches) == 1:
            rows.append((picture.name, "none", "–", ""))
            continue
        best, other = found.branches[:2]
        turn = np.degrees(best.camera_from_part.angle_to_rad(other.camera_from_part))
        settled = "settled by the expected pose" if found.settled_by_prior else ""
        told = "cannot be told apart" if found.ambiguous else "told apart"
        rows.append(
            (picture.name, f"turned by {turn:.0f} deg", f"{found.error_ratio:.2g}",
             settled or told)
        )  # fmt: skip
    heads = ("picture", "second pose", "its error by the best one's", "")
    return ("Mirror poses", heads, tuple(rows))
