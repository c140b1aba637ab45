"""The report of a hand-eye calibration."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibration.poses import Poses, difference, only
from calibration.report.model import Quantity, ReportData
from calibration.report.numbers import sigma_text, value_text
from calibration.report.plots import (
    BudgetPart,
    Coverage,
    ErrorBudget,
    Outline,
    ResidualField,
    Scene,
    Slack,
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
    target_outline,
)

if TYPE_CHECKING:
    from calibration.hand_eye import (
        HandEyeData,
        HandEyeResult,
        HandEyeSolution,
        Observability,
        Reading,
        ReadingCheck,
        RobotNoise,
    )
    from calibration.report.model import About
    from calibration.report.plots import Plot

_READINGS = 4
_KNOWN_SCALE = 0.1
_GOOD_COVERAGE = (
    "Good: points in most fields, so that no error of the lens in one place is taken for "
    "one of the hand."
)
Table = tuple[str, tuple[str, ...], tuple[tuple[str, ...], ...]]


def hand_eye_report(
    result: HandEyeResult,
    data: HandEyeData,
    about: About,
    *,
    robot: RobotNoise,
    stand_off_mm: float,
) -> ReportData:
    """Everything that the page of a hand-eye calibration shows.

    Args:
        result: with or without a solution.
        data: what it was made from.
        about: device, day, pictures.
        robot: the noise that was stated.
        stand_off_mm: working distance from the entrance pupil.
    """
    found = result.solution
    if found is None:
        return ReportData(
            "hand-eye",
            about,
            "No transform: these views do not allow one to be believed.",
            result.verdict,
            (),
            (Coverage.of(data.seen.pixels, _size(data), _GOOD_COVERAGE),),
            tables=tuple(_tables(result, None)),
        )
    error = NORMAL_95 * found.error_mm(stand_off_mm)
    held = float(np.sqrt((found.left_out_mm**2).mean()))
    return ReportData(
        "hand-eye",
        about,
        f"At {stand_off_mm:.0f} mm the camera is known to {error:.2g} mm (95 %); in views "
        f"that took no part the target was {held:.2g} mm off (RMS).",
        result.verdict,
        _quantities(found, stand_off_mm),
        tuple(_plots(found, data, robot, stand_off_mm)),
        tuple(_tables(result, found)),
        (f"Worst determined combination: {found.weakest.words}.",),
    )


def _size(data: HandEyeData) -> tuple[int, int]:
    return data.seen.width_px, data.seen.height_px


def _quantities(found: HandEyeSolution, stand_off_mm: float) -> tuple[Quantity, ...]:
    moving, fixed = found.moving_from_camera, found.fixed_from_target
    freedom = np.maximum(found.robot_freedom, 1.0)
    spread = found.robot_sigmas / np.sqrt(2 * freedom)
    return (
        *pose_quantities(moving, found.covariance, f"camera in {moving.target}"),
        *pose_quantities(
            fixed, found.estimate.covariance[6:12, 6:12], f"target in {fixed.target}"
        ),
        Quantity(
            "robot noise, position",
            float(found.robot_sigmas[0]),
            float(spread[0]),
            "mm",
            "on each axis, as found",
        ),
        Quantity(
            "robot noise, angle",
            float(np.degrees(found.robot_sigmas[1])),
            float(np.degrees(spread[1])),
            "deg",
            "on each axis, as found",
        ),
        Quantity("noise of a coordinate", found.sigma_px, None, "px", "as found"),
        Quantity(
            f"error at {stand_off_mm:.0f} mm",
            found.error_mm(stand_off_mm),
            None,
            "mm",
            "expected, RMS",
        ),
        Quantity(
            "error at the target, held out",
            float(np.sqrt((found.left_out_mm**2).mean())),
            None,
            "mm",
            "RMS over views that took no part",
        ),
    )


def _plots(
    found: HandEyeSolution, data: HandEyeData, robot: RobotNoise, stand_off_mm: float
) -> list[Plot]:
    count = 2 * len(data.seen.view)
    errors = found.estimate.residuals[:count].reshape(-1, 2) * found.sigma_px
    return [
        _budget(found, robot, stand_off_mm),
        ViewBars(
            "error at the target in each view when it is left out",
            "mm",
            data.seen.names,
            found.left_out_mm,
        ),
        Slack(
            data.seen.names,
            found.slack[:, :3],
            np.degrees(found.slack[:, 3:]),
            (robot.position_mm, float(np.degrees(robot.angle_rad))),
            (float(found.robot_sigmas[0]), float(np.degrees(found.robot_sigmas[1]))),
        ),
        _scene(found, data),
        ResidualField(data.seen.pixels, errors, _size(data), found.sigma_px),
        Coverage.of(data.seen.pixels, _size(data), _GOOD_COVERAGE),
    ]


def _budget(
    found: HandEyeSolution, robot: RobotNoise, stand_off_mm: float
) -> ErrorBudget:
    """Lengths over all three axes (root mean square) for a point on the axis."""
    axis = found.moving_from_camera.apply(np.array([[0.0, 0.0, stand_off_mm]]))[0]
    lever = float(np.linalg.norm(axis))
    position, angle = found.robot_sigmas
    arm = float(np.sqrt(3 * position**2 + 2 * (angle * lever) ** 2))
    mm_per_px = stand_off_mm / float(np.sqrt(found.camera.fx_px * found.camera.fy_px))
    return ErrorBudget(
        stand_off_mm,
        "a point that one picture puts into the cell",
        (
            BudgetPart(
                "calibration", found.error_mm(stand_off_mm), "this hand-eye result"
            ),
            BudgetPart(
                "robot",
                arm,
                f"{position:.2g} mm and {np.degrees(angle):.2g} deg on each axis, found "
                f"({robot.position_mm:.2g} mm and {np.degrees(robot.angle_rad):.2g} deg "
                "stated), for one pose",
            ),
            BudgetPart(
                "pixel noise",
                float(np.sqrt(2)) * found.sigma_px * mm_per_px,
                f"{found.sigma_px:.2g} px of one point",
            ),
        ),
    )


def _scene(found: HandEyeSolution, data: HandEyeData) -> Scene:
    """In base axes, the robot taken at its word."""
    x, z = only(found.moving_from_camera), only(found.fixed_from_target)
    tools = data.base_from_tool
    in_hand = data.mount == "eye-in-hand"
    cameras = tools @ x if in_hand else x
    targets = z if in_hand else tools @ z
    rectangle = target_outline(data.seen)
    corners = targets.apply(np.broadcast_to(rectangle, (len(targets), 5, 3)))
    held = cameras if in_hand else targets
    arms = np.stack([tools.translation_mm, held.translation_mm], axis=1)
    apart = cameras.translation_mm - targets.apply(
        np.broadcast_to(rectangle.mean(axis=0), (len(targets), 3))
    )
    distances = np.linalg.norm(apart, axis=1)
    base = Poses(np.eye(3)[None], np.zeros((1, 3)))
    return Scene(
        "base",
        matrices(cameras),
        data.seen.names if in_hand else ("camera",),
        half_angles(found.camera, _size(data)),
        drawn_reach_mm(distances),
        (
            Outline("target", tuple(corners)),
            Outline("hand", tuple(arms), "robot"),
            axes_outline(base, axes_length_mm(distances)),
        ),
    )


def _tables(result: HandEyeResult, found: HandEyeSolution | None) -> list[Table]:
    tables: list[Table] = []
    if found is not None:
        tables.append(_closed_forms(found))
    if result.observability is not None:
        tables.append(_turning(result.observability))
    if result.readings is not None:
        tables.append(_read(result.readings))
    return tables


def _turning(seen: Observability) -> Table:
    rows = tuple(
        (f"({', '.join(f'{v:z.2f}' for v in axis)})", f"{spread:.1f} deg")
        for axis, spread in zip(seen.axes, seen.spread_deg, strict=True)
    )
    title = f"How much the views turn (axes of the {seen.frame} frame)"
    return (title, ("axis", "rotation, RMS over pairs"), rows)


def _read(readings: ReadingCheck) -> Table:
    told = readings.told
    others = [one for one in readings.ranked if one.name != told.name]
    rows = tuple(
        (one.name, f"{one.misfit_mm:.3g} mm", _scale_words(one))
        for one in (told, *others[:_READINGS])
    )
    heads = ("reading of the robot poses", "disagreement", "robot's mm by target's")
    return ("Were the robot's numbers understood?", heads, rows)


def _scale_words(reading: Reading) -> str:
    """A scale that is not known to a tenth says nothing."""
    if not 0 < reading.scale_sigma < _KNOWN_SCALE * reading.scale:
        return "–"
    sigma = sigma_text(reading.scale_sigma)
    return f"{value_text(reading.scale, reading.scale_sigma)} ± {sigma}"


def _closed_forms(found: HandEyeSolution) -> Table:
    refined = only(found.moving_from_camera)
    rows = []
    for name, pose in found.closed_forms.items():
        off = difference(only(pose), refined)[0]
        length, turn = np.linalg.norm(off[:3]), np.degrees(np.linalg.norm(off[3:]))
        rows.append((name, f"{length:.3g} mm", f"{turn:.3g} deg"))
    heads = ("closed form", "position off the result", "angle off the result")
    return ("What the closed forms say", heads, tuple(rows))
