"""A new calibration beside the one before: how far apart on the work, and is it chance?

Differences are given where they matter, in mm and px at the working distance, each with
the standard deviation that both results together state. More than three of these is an
alarm: the cell has changed, or one of the two results is wrong.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np
from scipy.stats import chi2, norm

from calibration.poses import difference, only
from calibration.projection import (
    CAMERA_NAMES,
    PinholeCamera,
    project_with_derivatives,
    skew,
    to_normalised,
)
from mvp.geometry import Pose
from mvp.optics import MotorAxis, focus_distance_mm, principal_distance_mm

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.calibrated import (
        AxisTable,
        CameraCalibration,
        LensTableCalibration,
        Provenance,
        RigidCalibration,
    )
    from mvp.geometry import FloatArray
    from mvp.optics import AxisName

Kind: TypeAlias = Literal["camera", "lens", "hand-eye", "part"]

ALARM_SIGMAS = 3.0
_GRID = (9, 12)
_NEAR_AND_FAR = (0.9, 1.0, 1.1)
_OTHER_SETTING = 0.01
_RANK_SHARE = 1e-12
_STEPS = 25
_FAR_MM = 1e9
_AXES: tuple[AxisName, ...] = ("zoom", "focus", "iris")
_FILE_NAMES = {"cx_px": "centre_x_px", "cy_px": "centre_y_px"}


@dataclass(frozen=True)
class Difference:
    """One quantity, new less previous.

    Attributes:
        name: what differs, and where.
        change: in ``unit``.
        sigma: one standard deviation of the change if nothing changed; None where one of
            the results does not say how good it is.
        unit: of both.
    """

    name: str
    change: float
    sigma: float | None
    unit: str

    @property
    def sigmas(self) -> float | None:
        """Size of the change by its standard deviation."""
        if self.sigma is None:
            return None
        return abs(self.change) / self.sigma if self.sigma > 0 else float("inf")


@dataclass(frozen=True)
class Comparison:
    """Two results of one kind.

    Attributes:
        kind: of both.
        previous_date: ISO 8601.
        date: of the new one.
        differences: the one that matters most first; empty when nothing can be compared.
        sigmas: of all differences together: the number of standard deviations of one
            normal number that is as improbable; None where it is not known.
        remarks: what makes the comparison doubtful or impossible.
        words: one or two sentences.
    """

    kind: Kind
    previous_date: str
    date: str
    differences: tuple[Difference, ...]
    sigmas: float | None
    remarks: tuple[str, ...]
    words: str

    @property
    def alarm(self) -> bool:
        """The change is too large for chance."""
        return self.sigmas is not None and self.sigmas > ALARM_SIGMAS


def compare_cameras(
    previous: CameraCalibration, new: CameraCalibration, *, distance_mm: float
) -> Comparison:
    """Where both cameras see points at a distance.

    Args:
        previous: the one before.
        new: the new one.
        distance_mm: of a plane from the entrance pupil.
    """
    other = _other_device(previous.provenance, new.provenance)
    if (previous.width_px, previous.height_px) != (new.width_px, new.height_px):
        other = (*other, "the pictures have another size")
    if other:
        return _incomparable("camera", previous.provenance, new.provenance, other)
    old, now = _camera_of(previous, new), _camera_of(new, previous)
    spreads = _camera_covariance(previous), _camera_covariance(new)
    size = (new.width_px, new.height_px)
    direct, left = _seen_apart((old, now), spreads, size, distance_mm)
    mm = distance_mm / float(np.sqrt(now.fx_px * now.fy_px))
    at = f"at {distance_mm:.0f} mm"
    found = (
        _scaled(direct, f"largest shift {at}", mm, "mm"),
        _scaled(direct, f"largest shift {at}", 1.0, "px"),
        _scaled(left, f"what no motion of the camera imitates, {at}", mm, "mm"),
    )
    remarks: tuple[str, ...] = ()
    if abs(now.fx_px / old.fx_px - 1) > _OTHER_SETTING:
        percent = 100 * (now.fx_px / old.fx_px - 1)
        remarks = (
            f"the principal distances differ by {percent:.1f} %: were both results "
            "taken at the same lens setting?",
        )
    sigmas = None
    if spreads[0] is not None and spreads[1] is not None:
        sigmas = _equivalent(now.values - old.values, spreads[0] + spreads[1])
    return _compared(
        "camera", previous.provenance, new.provenance, found, sigmas, remarks
    )


def compare_lens_tables(
    previous: LensTableCalibration,
    new: LensTableCalibration,
    *,
    distance_mm: float,
    half_field_mm: float,
) -> Comparison:
    """What both tables say at the same steps, over the range that both cover.

    Args:
        previous: the one before.
        new: the new one.
        distance_mm: working distance from the entrance pupil.
        half_field_mm: from the middle of the field of view to its corner there.
    """
    stamps = previous.provenance, new.provenance
    other = _other_device(*stamps) + _other_sides(previous, new)
    pairs = [
        _on_common_steps(name, old, now)
        for name, old, now in zip(_AXES, _tables(previous), _tables(new), strict=True)
    ]
    empty = [axis for axis, pair in zip(_AXES, pairs, strict=True) if pair is None]
    other += tuple(f"no steps in common: {axis}" for axis in empty)
    if other:
        return _incomparable("lens", *stamps, other)
    f, x, a = (pair for pair in pairs if pair is not None)
    found = (
        *_on_the_work(previous, new, (f, x), distance_mm, half_field_mm),
        _worst("f", f, previous.f_standard_deviation_mm, new.f_standard_deviation_mm),
        _worst("d", x, previous.d_standard_deviation_mm, new.d_standard_deviation_mm),
        _worst("a", a, previous.a_standard_deviation_mm, new.a_standard_deviation_mm),
        Difference(
            "pupil offset e",
            new.pupil_offset_mm - previous.pupil_offset_mm,
            _both(
                previous.pupil_offset_standard_deviation_mm,
                new.pupil_offset_standard_deviation_mm,
            ),
            "mm",
        ),
    )
    known = [one.sigmas for one in found[2:] if one.sigmas is not None]
    return _compared("lens", *stamps, found, max(known, default=None), ())


def compare_rigid(
    previous: RigidCalibration,
    new: RigidCalibration,
    *,
    at_source_mm: Sequence[float],
) -> Comparison:
    """Where both results put a point: of a hand-eye or of a part pose.

    Args:
        previous: the one before.
        new: the new one, of the same frames.
        at_source_mm: (3,) the point in the source frame: on the optical axis at the
            working distance for a hand-eye, the middle of the features for a part.

    Raises:
        ValueError: results of different frames.
    """
    if (previous.target, previous.source) != (new.target, new.source):
        raise ValueError("only results of the same two frames can be compared")
    kind: Kind = "part" if new.schema_ == "mvp-cell/part-pose/1" else "hand-eye"
    other = () if kind == "part" else _other_device(previous.provenance, new.provenance)
    if other:
        return _incomparable(kind, previous.provenance, new.provenance, other)
    old, now = _rigid_pose(previous, new), _rigid_pose(new, new)
    step = difference(only(now), only(old))[0]
    lever = now.rotate(np.asarray(at_source_mm, dtype=np.float64))
    jacobian = np.hstack([np.eye(3), -skew(lever)])
    shift = jacobian @ step
    spread = _sum_of(previous.covariance, new.covariance)
    at = f"at {np.linalg.norm(at_source_mm):.0f} mm" if kind == "hand-eye" else "there"
    found = (
        _along(f"shift of a point {at}", shift, jacobian, spread, "mm"),
        _along("shift of the origin", step[:3], np.eye(3, 6), spread, "mm"),
        _along(
            "turn", np.degrees(step[3:]), np.degrees(np.eye(3, 6, 3)), spread, "deg"
        ),
    )
    sigmas = None if spread is None else _equivalent(step, spread)
    return _compared(kind, previous.provenance, new.provenance, found, sigmas, ())


def _compared(
    kind: Kind,
    before: Provenance,
    now: Provenance,
    found: tuple[Difference, ...],
    sigmas: float | None,
    remarks: tuple[str, ...],
) -> Comparison:
    if before.origin == "nominal":
        remarks = (*remarks, "the previous values were nominal, not measured")
    words = _words(kind, found[0], sigmas, before)
    return Comparison(kind, before.date, now.date, found, sigmas, remarks, words)


def _words(
    kind: Kind, first: Difference, sigmas: float | None, before: Provenance
) -> str:
    size = (
        f"{first.name[0].upper()}{first.name[1:]}: {abs(first.change):.3g} {first.unit}"
    )
    if sigmas is None:
        return (
            f"{size}. One of the two results does not say how good it is, so nobody can "
            "tell whether this is chance."
        )
    if sigmas <= ALARM_SIGMAS:
        return (
            f"{size}. All changes together are as usual as {sigmas:.1f} standard "
            "deviations of one number: the two results agree."
        )
    if before.origin == "nominal":
        end = "the device is not what its data sheet says; use the measured values."
    elif kind == "part":
        end = f"the part stands elsewhere than on {before.date}."
    else:
        end = (
            f"something has changed since {before.date}. Find out what (a blow, a loose "
            "screw, another lens setting, temperature) before relying on either."
        )
    many = f"{sigmas:.1f}" if sigmas < 100 else "more than 100"
    return (
        f"{size}. All changes together are as unusual as {many} standard deviations of one "
        f"number: {end}"
    )


def _incomparable(
    kind: Kind, before: Provenance, now: Provenance, why: tuple[str, ...]
) -> Comparison:
    words = f"Not to be compared with the result of {before.date}: {'; '.join(why)}."
    return Comparison(kind, before.date, now.date, (), None, why, words)


def _other_device(before: Provenance, now: Provenance) -> tuple[str, ...]:
    if before.device_serial == now.device_serial or before.origin == "nominal":
        return ()
    return (f"it belongs to device {before.device_serial}, not {now.device_serial}",)


def _equivalent(change: FloatArray, spread: FloatArray) -> float:
    """Sigmas of one normal number as improbable as this change of several numbers."""
    scale = np.sqrt(np.diag(spread))
    free = scale > 0
    if not free.any():
        return float("inf") if change.any() else 0.0
    scaled = change[free] / scale[free]
    values, vectors = np.linalg.eigh(
        spread[np.ix_(free, free)] / np.outer(*[scale[free]] * 2)
    )
    known = values > _RANK_SHARE * values[-1]
    square = float((((vectors.T @ scaled)[known]) ** 2 / values[known]).sum())
    log_probability = float(chi2.logsf(square, int(known.sum())))
    if log_probability < -700:
        return float(np.sqrt(square))
    return float(norm.isf(np.exp(log_probability) / 2))


def _along(
    name: str,
    change: FloatArray,
    jacobian: FloatArray,
    spread: FloatArray | None,
    unit: str,
) -> Difference:
    """Length of a change, and its standard deviation in that direction."""
    length = float(np.linalg.norm(change))
    if spread is None:
        return Difference(name, length, None, unit)
    own = jacobian @ spread @ jacobian.T
    if length == 0:
        return Difference(name, 0.0, float(np.sqrt(np.linalg.eigvalsh(own)[-1])), unit)
    direction = change / length
    return Difference(name, length, float(np.sqrt(direction @ own @ direction)), unit)


def _scaled(one: Difference, name: str, factor: float, unit: str) -> Difference:
    sigma = None if one.sigma is None else one.sigma * factor
    return Difference(name, one.change * factor, sigma, unit)


def _both(before: float, now: float) -> float | None:
    return float(np.hypot(before, now)) if before > 0 and now > 0 else None


def _sum_of(
    before: list[list[float]] | None, now: list[list[float]] | None
) -> FloatArray | None:
    if before is None or now is None:
        return None
    return np.asarray(before, np.float64) + np.asarray(now, np.float64)


def _camera_of(file: CameraCalibration, other: CameraCalibration) -> PinholeCamera:
    """Principal distance from the other file (or a guess) where this one has none."""
    guess = float(max(file.width_px, file.height_px))
    return PinholeCamera(
        file.reference_fx_px or other.reference_fx_px or guess,
        file.reference_fy_px or other.reference_fy_px or guess,
        file.centre_x_px,
        file.centre_y_px,
        file.k1,
        file.k2,
        file.p1,
        file.p2,
        file.k3,
    )


def _camera_covariance(file: CameraCalibration) -> FloatArray | None:
    """(9, 9) of ``CAMERA_NAMES``; None where the file tells none."""
    spread = np.zeros((9, 9))
    if file.covariance is not None:
        names = file.covariance.parameters
        index = [CAMERA_NAMES.index(n) for n in names if n in CAMERA_NAMES]
        rows = [i for i, n in enumerate(names) if n in CAMERA_NAMES]
        matrix = np.asarray(file.covariance.matrix, np.float64)
        spread[np.ix_(index, index)] = matrix[np.ix_(rows, rows)]
    elif file.standard_deviation:
        stated = file.standard_deviation
        own = [stated.get(_FILE_NAMES.get(n, n), 0.0) for n in CAMERA_NAMES]
        spread = np.diag(np.square(own))
    return spread if spread.any() else None


def _seen_apart(
    cameras: tuple[PinholeCamera, PinholeCamera],
    spreads: tuple[FloatArray | None, FloatArray | None],
    size_px: tuple[int, int],
    distance_mm: float,
) -> tuple[Difference, Difference]:
    """Largest shift over the picture, px: as it is, and less the best motion."""
    across = np.linspace(0, size_px[0] - 1, _GRID[1])
    down = np.linspace(0, size_px[1] - 1, _GRID[0])
    pixels = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
    rays = to_normalised(cameras[0], pixels)
    rays = rays[np.isfinite(rays).all(axis=1)]
    flat = np.pad(rays, ((0, 0), (0, 1)), constant_values=1.0) * distance_mm
    points = np.concatenate([factor * flat for factor in _NEAR_AND_FAR])
    seen = [
        project_with_derivatives(c, np.eye(3), np.zeros(3), points) for c in cameras
    ]
    change = (seen[1].pixels - seen[0].pixels).ravel()
    motion = seen[1].d_pose.reshape(-1, 6)
    slopes = [one.d_camera.reshape(-1, 9) for one in seen]

    def without(values: FloatArray) -> FloatArray:
        return values - motion @ np.linalg.lstsq(motion, values, rcond=None)[0]

    middle = slice(2 * len(flat), 4 * len(flat))
    return (
        _largest(change[middle], [slope[middle] for slope in slopes], spreads),
        _largest(
            without(change)[middle], [without(s)[middle] for s in slopes], spreads
        ),
    )


def _largest(
    change: FloatArray,
    slopes: list[FloatArray],
    spreads: tuple[FloatArray | None, FloatArray | None],
) -> Difference:
    shifts = change.reshape(-1, 2)
    worst = int(np.linalg.norm(shifts, axis=1).argmax())
    rows = slice(2 * worst, 2 * worst + 2)
    if spreads[0] is None or spreads[1] is None:
        return _along("shift", shifts[worst], np.eye(2), None, "px")
    jacobian = np.hstack([slope[rows] for slope in slopes])
    both = np.zeros((18, 18))
    both[:9, :9], both[9:, 9:] = spreads
    return _along("shift", shifts[worst], jacobian, both, "px")


def _other_sides(
    previous: LensTableCalibration, new: LensTableCalibration
) -> tuple[str, ...]:
    return tuple(
        f"{name} was approached {old.approach}, now {now.approach}"
        for name, old, now in zip(_AXES, _tables(previous), _tables(new), strict=True)
        if old.approach != now.approach
    )


def _tables(file: LensTableCalibration) -> tuple[AxisTable, AxisTable, AxisTable]:
    return file.zoom_f_mm, file.focus_extension_mm, file.iris_a_mm


def _on_common_steps(
    name: AxisName, before: AxisTable, now: AxisTable
) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Steps in both ranges, and the values that both tables have there."""
    first = max(min(before.steps), min(now.steps))
    last = min(max(before.steps), max(now.steps))
    if first >= last:
        return None
    steps = np.linspace(first, last, _STEPS)
    axes = [MotorAxis.from_table(name, table) for table in (before, now)]
    return steps, axes[0].value_mm(steps), axes[1].value_mm(steps)


def _worst(
    name: str,
    pair: tuple[FloatArray, FloatArray, FloatArray],
    before_sigma: float,
    sigma: float,
) -> Difference:
    steps, before, now = pair
    worst = int(np.abs(now - before).argmax())
    where = f"{name}, worst at step {steps[worst]:.0f}"
    change = float(now[worst] - before[worst])
    return Difference(where, change, _both(before_sigma, sigma), "mm")


def _on_the_work(
    previous: LensTableCalibration,
    new: LensTableCalibration,
    pairs: tuple[tuple[FloatArray, FloatArray, FloatArray], ...],
    distance_mm: float,
    half_field_mm: float,
) -> tuple[Difference, Difference]:
    """Lateral shift at the corner of the field, and shift of the sharp distance.

    At the setting in both tables' middle zoom that is sharp nearest to the distance.
    """
    (_, f_before, f_now), (_, x_before, x_now) = pairs
    middle = len(f_now) // 2
    old = _at_setting(f_before[middle], x_before, previous.pupil_offset_mm)
    now = _at_setting(f_now[middle], x_now, new.pupil_offset_mm)
    best = int(np.abs(now[1] - distance_mm).argmin())
    sigma = _both(previous.d_standard_deviation_mm, new.d_standard_deviation_mm)
    lateral = half_field_mm / float(now[0][best])
    f = float(f_now[middle])
    along = ((distance_mm + new.pupil_offset_mm - f) / f) ** 2
    at = f"at {distance_mm:.0f} mm"
    corner = float(now[0][best] - old[0][best]) * lateral
    sharp = float(now[1][best] - old[1][best])
    return (
        Difference(
            f"shift at the corner of the field {at}",
            corner,
            None if sigma is None else sigma * lateral,
            "mm",
        ),
        Difference(
            f"shift of the sharp distance {at}",
            sharp if np.isfinite(sharp) else 0.0,
            None if sigma is None else sigma * along,
            "mm",
        ),
    )


def _at_setting(
    f_mm: float, x_mm: FloatArray, e_mm: float
) -> tuple[FloatArray, FloatArray]:
    """Principal and sharp distance (from the pupil) at extensions x; the latter finite."""
    d = f_mm + x_mm
    sharp = focus_distance_mm(d, f_mm) - e_mm
    return principal_distance_mm(d, f_mm, e_mm), np.minimum(sharp, _FAR_MM)


def _rigid_pose(file: RigidCalibration, reference: RigidCalibration) -> Pose:
    """The transform at the reference's lens setting: the pupil moves along z with d."""
    pose = Pose.from_matrix(file.target, file.source, np.asarray(file.matrix))
    if file.reference_d_mm is None or reference.reference_d_mm is None:
        return pose
    along = np.array([0.0, 0.0, reference.reference_d_mm - file.reference_d_mm])
    moved = pose.translation_mm + pose.rotate(along)
    return replace(pose, translation_mm=moved)
