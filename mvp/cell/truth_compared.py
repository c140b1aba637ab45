"""The calibrations of a simulated cell beside what is true in its world.

Planner, verifier and wizards never see the truth; this is for people who want to know
whether a calibration is as good as it says.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np
from pydantic import Field

from mvp.cell.truth import truth_of
from mvp.errors import UsageError
from mvp.fileedge import FileModel
from mvp.kinematics import tool_from_camera_at
from mvp.optics import LensTable

if TYPE_CHECKING:
    from collections.abc import Iterator

    from mvp.calibrated import RigidCalibration
    from mvp.cell.calibrations import CalibrationModels
    from mvp.cell.loading import LoadedCell
    from mvp.geometry import Pose

NORMAL_95 = 1.96
_AXES = "xyz"


class Compared(FileModel):
    """One value.

    ``file``: the calibration it is from, as in ``[calibration]``. ``what``: in words,
    with where it holds. ``error``: believed minus true. ``stated``: half the stated 95 %
    interval; null: nothing is stated. ``unit``: of both.
    """

    file: str
    what: str
    error: float
    stated: float | None
    unit: str

    @property
    def inside(self) -> bool | None:
        """Whether the true value lies in the interval; None: there is none."""
        return None if self.stated is None else abs(self.error) <= self.stated


class TruthDocument(FileModel):
    """``truth --json``. ``inside`` of the ``stated`` values lie in their intervals."""

    schema_: Literal["mvp-cell/truth/1"] = Field(
        default="mvp-cell/truth/1", alias="schema"
    )
    cell: str
    values: list[Compared]
    stated: int
    inside: int


def truth_document(cell: LoadedCell) -> TruthDocument:
    """Every value with its true error.

    Raises:
        UsageError: a real cell, whose truth nobody knows.
        CalibrationError: a file of the truth cannot be read.
    """
    if cell.config.world is None:
        raise UsageError(
            f"{cell.config.name} is not simulated: nobody knows what is true there",
            hint="its reports say how good the calibrations are; held-out views test them",
            where=str(cell.source.path),
        )
    rows = compare(cell)
    stated = [row for row in rows if row.stated is not None]
    inside = sum(bool(row.inside) for row in stated)
    return TruthDocument(
        cell=cell.config.name, values=rows, stated=len(stated), inside=inside
    )


def compare(cell: LoadedCell) -> list[Compared]:
    """Every value of the four calibrations that the truth has as well."""
    believed, true = cell.calibrations, truth_of(cell)
    return [
        *_camera(believed, true),
        *_lens(believed, true),
        *_hand_eye(believed, true),
        *_rigid(
            "part_pose",
            "part",
            believed.part_pose,
            believed.base_from_part,
            true.base_from_part,
        ),
    ]


def _row(
    file: str, what: str, error: float, stated: float | None, unit: str
) -> Compared:
    return Compared(file=file, what=what, error=error, stated=stated, unit=unit)


def _stated(sigma: float | None) -> float | None:
    return None if not sigma else NORMAL_95 * sigma


def _camera(believed: CalibrationModels, true: CalibrationModels) -> Iterator[Compared]:
    spread = believed.camera.standard_deviation
    for name, what, unit in (
        ("centre_x_px", "centre x", "px"),
        ("centre_y_px", "centre y", "px"),
        ("k1", "k1", ""),
    ):
        error = getattr(believed.camera, name) - getattr(true.camera, name)
        yield _row("camera", what, error, _stated(spread.get(name)), unit)


def _lens(believed: CalibrationModels, true: CalibrationModels) -> Iterator[Compared]:
    """At the worst step of the believed table."""
    model = believed.lens_table
    ours, theirs = (LensTable.from_calibration(m.lens_table) for m in (believed, true))
    sigma_f, sigma_d = model.f_standard_deviation_mm, model.d_standard_deviation_mm
    for what, axis, truth, sigma in (
        ("f", ours.zoom, theirs.zoom, sigma_f),
        ("d - f", ours.focus, theirs.focus, float(np.hypot(sigma_f, sigma_d))),
        ("a", ours.iris, theirs.iris, model.a_standard_deviation_mm),
    ):
        errors = axis.values_mm - truth.value_mm(axis.steps)
        worst = int(np.argmax(np.abs(errors)))
        where = f"{what} at {axis.name} step {axis.steps[worst]:.0f}"
        yield _row("lens_table", where, float(errors[worst]), _stated(sigma), "mm")
    error = ours.pupil_offset_mm - theirs.pupil_offset_mm
    sigma = model.pupil_offset_standard_deviation_mm
    yield _row("lens_table", "pupil offset e", error, _stated(sigma), "mm")


def _hand_eye(
    believed: CalibrationModels, true: CalibrationModels
) -> Iterator[Compared]:
    """With the motors where they stood for the believed result."""
    model = believed.hand_eye
    hand = true.tool_from_camera
    if model.reference_d_mm is not None and model.reference_f_mm is not None:
        ours, theirs = (
            LensTable.from_calibration(m.lens_table) for m in (believed, true)
        )
        steps = ours.steps(
            model.reference_f_mm, model.reference_d_mm, float(np.mean(ours.a_range_mm))
        )
        hand = tool_from_camera_at(
            hand,
            d_mm=theirs.at(steps).d_mm,
            reference_d_mm=true.hand_eye.reference_d_mm,
        )
    yield from _rigid("hand_eye", "camera", model, believed.tool_from_camera, hand)


def _rigid(
    file: str, what: str, model: RigidCalibration, ours: Pose, theirs: Pose
) -> Iterator[Compared]:
    """Errors in the target frame, as the covariance is."""
    shift = ours.translation_mm - theirs.translation_mm
    turn = np.degrees((ours @ theirs.inverse()).rotvec_rad)
    sigma: list[float | None] = [None] * 6
    if model.covariance is not None:
        spread = np.sqrt(np.diag(model.covariance))
        sigma = [*spread[:3].tolist(), *np.degrees(spread[3:]).tolist()]
    errors = [*shift.tolist(), *turn.tolist()]
    names = [f"{what} {axis}" for axis in _AXES]
    names += [f"{what} turned about {axis}" for axis in _AXES]
    for number, (name, error) in enumerate(zip(names, errors, strict=True)):
        unit = "mm" if number < 3 else "deg"
        yield _row(file, name, error, _stated(sigma[number]), unit)


def told(rows: list[Compared]) -> Iterator[str]:
    """A table in plain text."""
    yield f"{'':11}{'':36}{'error':>10}{'95 %':>11}"
    for row in rows:
        stated = "-" if row.stated is None else f"+-{row.stated:.4f}"
        mark = {True: "", False: "  OUTSIDE", None: ""}[row.inside]
        yield (
            f"{row.file:11}{row.what:36}{row.error:>10.4f}{stated:>11} {row.unit}{mark}"
        )
    stated_rows = [row for row in rows if row.stated is not None]
    inside = sum(bool(row.inside) for row in stated_rows)
    yield f"{inside} of {len(stated_rows)} lie inside of what is stated"
