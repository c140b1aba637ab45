"""Cameras that another program calibrated, as results of a cell, and back.

A foreign file has numbers and nothing else: no covariance, no serial number, no date, no
temperature, no pictures. What a person does not add stays unknown. Its verdict is at best
MARGINAL, and without serial number and date nobody can tell that this camera was measured
at all: it counts as nominal.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibration.camera_verdict import CENTRE, FOCAL
from calibration.exchange import (
    CameraFile,
    kalibr_camchain,
    opencv_yaml,
    read_camera,
    ros_camera_info,
    with_notes,
)
from calibration.projection import CAMERA_NAMES, PinholeCamera, to_normalised
from calibration.results import FILE_NAMES
from mvp.calibrated import (
    CameraCalibration,
    Provenance,
    Quality,
    Validity,
    VerdictCause,
)
from mvp.cell.calibration_gates import IMPORTED, measure_again
from mvp.errors import CalibrationError, UsageError
from mvp.wizard import ImportedCamera

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from mvp.geometry import FloatArray
    from mvp.wizard import CameraStatement

_WRITERS: dict[str, Callable[[CameraFile], str]] = {
    "opencv": opencv_yaml,
    "ros": ros_camera_info,
    "kalibr": kalibr_camchain,
}
_TITLES = {"opencv": "OpenCV", "ros": "ROS camera_info", "kalibr": "Kalibr camchain"}
_UNKNOWN_DATE = "unknown"
_OTHER_ASPECT = 0.01
_HOLDS_K = 5.0  # as a session's result


class YamlCameraFiles:
    """OpenCV YAML, ROS camera_info and Kalibr camchain."""

    formats = tuple(_WRITERS)

    def read(self, path: Path, stated: CameraStatement) -> ImportedCamera:
        """See ``CameraFiles``."""
        file = read_camera(path)
        if file.simulated and not stated.simulated:
            raise _refused(
                path,
                "this camera comes from a simulated cell, as its notes say, and cannot "
                "be used on a real one",
                "name a file of a camera that was measured on this cell",
            )
        _check_size(path, file, stated.sensor)
        _check_focal(path, file, stated)
        _check_optics(path, file)
        wide = _widest(file)
        _check_sigmas(stated.sigmas, wide)
        usual = {k: v for k, v in wide.items() if k not in _fixed(file.camera)}
        result = _result(path, file, stated, usual | dict(stated.sigmas))
        return ImportedCamera(result, file.format, file.unused, _unsaid(stated, usual))

    def text(
        self, name: str, camera: CameraCalibration, *, label: str, notes: Sequence[str]
    ) -> str:
        """See ``CameraFiles``."""
        fx, fy = camera.reference_fx_px, camera.reference_fy_px
        if fx is None or fy is None:
            raise ValueError("the camera has no principal distance")
        rest = [getattr(camera, FILE_NAMES.get(one, one)) for one in CAMERA_NAMES[2:]]
        pinhole = PinholeCamera(fx, fy, *rest)
        file = CameraFile(pinhole, camera.width_px, camera.height_px, label)
        return with_notes(_WRITERS[name](file), notes)


def _check_size(path: Path, file: CameraFile, sensor: CameraCalibration) -> None:
    """Raises CalibrationError where these cannot be pictures of this sensor."""
    focal, _, size = file.keys
    if (file.width_px, file.height_px) != (sensor.width_px, sensor.height_px):
        raise _refused(
            path,
            f"{size}: pictures of {file.width_px} x {file.height_px} px, but the camera "
            f"of this cell has {sensor.width_px} x {sensor.height_px} px",
            "calibrate with whole pictures of this camera, neither scaled nor cut; or "
            "correct size and pitch in the camera calibration of the cell first",
        )
    aspect = file.camera.fx_px / file.camera.fy_px
    square = sensor.pitch_y_um / sensor.pitch_x_um
    if abs(aspect / square - 1) > _OTHER_ASPECT:
        raise _refused(
            path,
            f"{focal}: fx / fy is {aspect:.4g}, but pixels of {sensor.pitch_x_um:g} x "
            f"{sensor.pitch_y_um:g} um make it {square:.4g}",
            "calibrate with pictures that are scaled alike in both directions",
        )


def _check_focal(path: Path, file: CameraFile, stated: CameraStatement) -> None:
    """Another unit, or pictures that were scaled, show in the principal distance."""
    (low, high), pitch_um = stated.principal_mm, stated.sensor.pitch_x_um
    fx = file.camera.fx_px
    if low <= fx * pitch_um / 1000 <= high:
        return
    hint = (
        "state the intrinsics of whole pictures in px; or correct pixel pitch and lens "
        "table of the cell first"
    )
    for unit, in_mm in (("mm", 1.0), ("m", 1000.0)):
        if low <= fx * in_mm <= high:
            hint = f"this looks like {unit}: divide by the pitch of {pitch_um:g} um"
    raise _refused(
        path,
        f"{file.keys[0]}: fx = {fx:g} px on pixels of {pitch_um:g} um is a principal "
        f"distance of {fx * pitch_um / 1000:.4g} mm, but the lens of this cell can only "
        f"have {low:.3g} to {high:.3g} mm",
        hint,
    )


def _check_optics(path: Path, file: CameraFile) -> None:
    focal, distortion, _ = file.keys
    camera = file.camera
    inside = 0 <= camera.cx_px < file.width_px and 0 <= camera.cy_px < file.height_px
    if not inside:
        raise _refused(
            path,
            f"{focal}: the principal point ({camera.cx_px:g}, {camera.cy_px:g}) px is "
            "outside of the picture",
            "state it in px from the top-left pixel",
        )
    with np.errstate(all="ignore"):  # what is too large for a float shows as nan
        border = to_normalised(camera, _border(file))
    if not np.isfinite(border).all():
        raise _refused(
            path,
            f"{distortion}: this distortion folds over inside of the picture",
            "state k1, k2, p1, p2, k3 of coordinates x / z, y / z, in this order",
        )


def _refused(path: Path, what: str, hint: str) -> CalibrationError:
    return CalibrationError(f"{path}: {what}", hint=hint, where=str(path))


def _border(file: CameraFile) -> FloatArray:
    """(16, 2) pixels around the picture."""
    right, low = file.width_px - 1.0, file.height_px - 1.0
    share = np.linspace(0, 1, 5)[:-1]
    there, zero = 1 - share, np.zeros(4)
    x = np.concatenate([share * right, zero + right, there * right, zero])
    y = np.concatenate([zero, share * low, zero + low, there * low])
    return np.stack([x, y], axis=-1)


def _widest(file: CameraFile) -> dict[str, float]:
    """Standard deviations of a camera that is just not a NO-GO, by name.

    Of a term of the distortion: what moves the farthest corner as far as the principal
    point may be off.
    """
    camera = file.camera
    centre = np.array([camera.cx_px, camera.cy_px])
    far = np.abs(_border(file) - centre).max(axis=0)
    r = float(np.hypot(*(far / [camera.fx_px, camera.fy_px])))
    bar = CENTRE.no_go / camera.fx_px
    focal = FOCAL.no_go / 100
    return {
        "fx_px": focal * camera.fx_px,
        "fy_px": focal * camera.fy_px,
        "cx_px": CENTRE.no_go,
        "cy_px": CENTRE.no_go,
        "k1": bar / r**3,
        "k2": bar / r**5,
        "p1": bar / (3 * r**2),
        "p2": bar / (3 * r**2),
        "k3": bar / r**7,
    }


def _fixed(camera: PinholeCamera) -> set[str]:
    """Terms that the file's model does without: k1 has always been looked for."""
    return {name for name in ("k2", "p1", "p2", "k3") if getattr(camera, name) == 0}


def _check_sigmas(sigmas: Mapping[str, float], wide: Mapping[str, float]) -> None:
    for name, value in sigmas.items():
        if name not in wide:
            raise _no_sigma(name, "there is no such value", f"one of {', '.join(wide)}")
        if not 0 < value <= wide[name]:
            raise _no_sigma(
                name,
                f"{value:g} cannot be a standard deviation of it",
                f"more than 0 and at most {wide[name]:.3g}, beyond which a camera is a "
                "NO-GO",
            )


def _no_sigma(name: str, why: str, hint: str) -> UsageError:
    return UsageError(f"--sigma {name}: {why}", hint=hint, where="--sigma")


def _result(
    path: Path,
    file: CameraFile,
    stated: CameraStatement,
    sigmas: Mapping[str, float],
) -> CameraCalibration:
    camera, sensor, warm = file.camera, stated.sensor, stated.temperature_c
    known = bool(stated.serial and stated.date)
    provenance = Provenance(
        date=stated.date or _UNKNOWN_DATE,
        device_serial=stated.serial,
        method=f"imported from the {_TITLES[file.format]} file {path.name}",
        simulated=stated.simulated,
        input_sha256=file.sha256,
        temperature_c=warm,
        temperature_source="unknown" if warm is None else "operator",
        origin="measured" if known else "nominal",
        serial_numbers={"camera": stated.serial} if stated.serial else {},
    )
    validity = (
        Validity()
        if warm is None
        else Validity(
            temperature_min_c=warm - _HOLDS_K, temperature_max_c=warm + _HOLDS_K
        )
    )
    values = dict(zip(CAMERA_NAMES, camera.values.tolist(), strict=True))
    focal = {f"reference_{name}": values.pop(name) for name in CAMERA_NAMES[:2]}
    placed = {FILE_NAMES.get(name, name): value for name, value in values.items()}
    return CameraCalibration.model_validate(
        {
            "schema": "mvp-cell/camera/1",
            "provenance": provenance,
            "quality": _quality(path),
            "width_px": sensor.width_px,
            "height_px": sensor.height_px,
            "pitch_x_um": sensor.pitch_x_um,
            "pitch_y_um": sensor.pitch_y_um,
            "standard_deviation": {
                FILE_NAMES.get(name, name): sigmas[name]
                for name in CAMERA_NAMES
                if name in sigmas
            },
            "validity": validity,
        }
        | focal
        | placed
    )


def _quality(path: Path) -> Quality:
    """Nobody here has seen its pictures."""
    message = (
        f"imported from {path.name}: no picture of this cell tests it; its residuals, "
        "coverage and tilt are not known"
    )
    action = measure_again("camera")
    cause = VerdictCause(
        code=IMPORTED, grade="marginal", message=message, action=action
    )
    return Quality(
        verdict="marginal", reasons=[message], causes=[cause], next_action=action
    )


def _unsaid(stated: CameraStatement, usual: Mapping[str, float]) -> tuple[str, ...]:
    """What stays open, and what is taken for it."""
    found = []
    if not stated.serial:
        found.append("the serial number of the camera (--serial)")
    if not stated.date:
        found.append("when it was measured (--date)")
    if stated.temperature_c is None:
        found.append("how warm it was (--temperature-c)")
    open_ = [name for name in usual if name not in stated.sigmas]
    if open_:
        taken = ", ".join(f"{name} +- {usual[name]:.3g}" for name in open_)
        found.append(
            f"how well it is known (--sigma NAME=VALUE): taken as badly as without a "
            f"NO-GO, {taken}"
        )
    return tuple(found)
