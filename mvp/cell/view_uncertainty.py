"""What the calibrations of a cell say about the errors of its views.

Shift and turn of the camera follow from the covariances when camera, hand-eye and part
pose all have one; f, d and a when the lens table has one. Whatever is not known stays as
[uncertainty] of the cell file states it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mvp.calibrated.content import content_sha256
from mvp.constraints import Uncertainty
from mvp.planning.plan import ErrorSpread, KeptProbability
from mvp.planning.probability import error_covariance, linearised
from mvp.planning.probability_errors import CellErrors, PoseChain, camera_spread
from mvp.planning.rows import RowTable

if TYPE_CHECKING:
    from mvp.calibrated import LensTableCalibration, NamedCovariance, RigidCalibration
    from mvp.cell.calibrations import Calibrations
    from mvp.cell.loading import LoadedCell
    from mvp.geometry import FloatArray
    from mvp.optics import Views
    from mvp.planning import PlanningProblem

_POSE = ("camera", "hand_eye", "part_pose")
_LENS = ("lens_table",)
_COMMANDED = ("reach", "lens_range")


def stated_uncertainty(cell: LoadedCell) -> Uncertainty:
    """The errors that the cell file states."""
    stated = cell.config.uncertainty
    return Uncertainty(
        position_mm=stated.position_mm,
        angle_rad=float(np.radians(stated.angle_deg)),
        d_mm=stated.d_mm,
        f_mm=stated.f_mm,
        a_mm=stated.a_mm,
    )


def view_errors(cell: LoadedCell) -> CellErrors | None:
    """The errors that follow from the calibrations; None when those say nothing."""
    found = cell.calibrations
    pose, lens = _pose_chain(cell), _lens_covariance(found.lens_table)
    if pose is None and lens is None:
        return None
    return CellErrors(stated_uncertainty(cell), pose, lens)


def robot_covariance(cell: LoadedCell) -> FloatArray:
    """(6, 6) of ``base_from_tool``: how far the flange is from where the arm says."""
    stated = cell.config.uncertainty
    sigmas = [stated.robot_position_mm] * 3
    sigmas += [np.radians(stated.robot_angle_deg)] * 3
    return np.diag(np.square(sigmas))


def _pose_chain(cell: LoadedCell) -> PoseChain | None:
    found = cell.calibrations
    hand_eye, part = _rigid(found.hand_eye), _rigid(found.part_pose)
    camera = found.camera
    if hand_eye is None or part is None or camera.covariance is None:
        return None
    across, down = _centre_sigma_px(camera.covariance, found.lens_table)
    return PoseChain(
        found.base_from_part,
        found.tool_from_camera,
        part,
        hand_eye,
        robot_covariance(cell),
        _by_hand_eye(found),
        (
            across * camera.pitch_x_um / 1000,
            down * camera.pitch_y_um / 1000,
        ),
        found.lens_table.pupil_offset_standard_deviation_mm,
    )


def _centre_sigma_px(
    camera: NamedCovariance, table: LensTableCalibration
) -> tuple[float, float]:
    """Of the principal point: the lens table's where it holds one, else the camera's."""
    by_zoom = table.by_zoom
    if by_zoom is not None and by_zoom.centre_x_px:
        known = by_zoom.standard_deviation
        return known.get("centre_x_px", 0.0), known.get("centre_y_px", 0.0)
    across, down = (_variance(camera, name) ** 0.5 for name in ("cx_px", "cy_px"))
    return across, down


def _rigid(model: RigidCalibration) -> FloatArray | None:
    if model.covariance is None:
        return None
    return np.asarray(model.covariance, dtype=np.float64)


def _by_hand_eye(found: Calibrations) -> FloatArray:
    """How the part's pose hangs on the hand-eye transform that is in use."""
    lever, through = found.part_pose.by_hand_eye, found.part_pose.hand_eye_sha256
    if lever is None or through != content_sha256(found.hand_eye):
        return np.zeros((6, 6))
    return np.asarray(lever, dtype=np.float64)


def _variance(covariance: NamedCovariance, name: str) -> float:
    """Of one parameter; 0 when it was held fixed."""
    if name not in covariance.parameters:
        return 0.0
    place = covariance.parameters.index(name)
    return max(covariance.matrix[place][place], 0.0)


def _lens_covariance(table: LensTableCalibration) -> FloatArray | None:
    """(3, 3) of f, d and a: d = f + x carries the error of f."""
    if table.covariance is None:
        return None
    f_variance = table.f_standard_deviation_mm**2
    d_variance = max(table.d_standard_deviation_mm**2, f_variance)
    found = np.diag([f_variance, d_variance, table.a_standard_deviation_mm**2])
    found[0, 1] = found[1, 0] = f_variance
    return found


def kept_probability(
    cell: LoadedCell,
    problem: PlanningProblem,
    view: Views,
    *,
    clearance_sigmas: float | None,
    number: int,
) -> KeptProbability:
    """The probability that a view (N = 1) keeps each requirement, for the plan.

    Args:
        cell: whose calibrations.
        problem: what the view must keep, and its errors.
        view: as it will be commanded.
        clearance_sigmas: standard deviations before anything touches; None: no error
            brings anything together.
        number: of the view: seeds the samples.
    """
    rng = np.random.default_rng([number, 1])
    optical = linearised(problem, view, rng)
    touching = _tail(clearance_sigmas)
    each: dict[str, float] = dict(optical.each.items())
    each |= {"clearance": 1 - touching} | dict.fromkeys(_COMMANDED, 1.0)
    return KeptProbability(
        each=each,
        together=max(optical.together - touching, 0.0),
        weakest=_weakest(each, problem, view, clearance_sigmas),
        spread=_spread(cell, problem, view),
    )


def _weakest(
    each: dict[str, float],
    problem: PlanningProblem,
    view: Views,
    clearance_sigmas: float | None,
) -> str:
    """The least probable one; of those that are all but certain the nearest to it."""
    table = RowTable.of(problem)
    index = table.index(view)[0]
    sigmas: dict[str, float] = {
        kind: float(index[table.mask(kind)].min())
        for kind in dict.fromkeys(table.kinds)
        if kind not in problem.hard_kinds
    }
    if clearance_sigmas is not None:
        sigmas["clearance"] = clearance_sigmas
    return min(each, key=lambda kind: (each[kind], sigmas.get(kind, np.inf)))


def _tail(sigmas: float | None) -> float:
    from scipy.special import ndtr

    return 0.0 if sigmas is None else float(ndtr(-sigmas))


def _spread(cell: LoadedCell, problem: PlanningProblem, view: Views) -> ErrorSpread:
    covariance = error_covariance(problem, view)
    camera = camera_spread(covariance)
    d_mm, f_mm, a_mm = np.sqrt(np.diag(covariance)[6:])
    errors = problem.errors
    known: list[str] = []
    if isinstance(errors, CellErrors):
        known += _POSE if errors.pose is not None else ()
        known += _LENS if errors.lens is not None else ()
    return ErrorSpread(
        position_mm=camera.position_mm,
        position_95_mm=camera.position_95_mm,
        angle_deg=float(np.degrees(camera.angle_rad)),
        angle_95_deg=float(np.degrees(camera.angle_95_rad)),
        f_mm=float(f_mm),
        d_mm=float(d_mm),
        a_mm=float(a_mm),
        sources=known,
    )
