"""Cameras from and for other programs: OpenCV YAML, ROS camera_info, Kalibr camchain.

All three hold a pinhole camera with Brown's distortion. What our model cannot say (fisheye
and rational models) and what theirs cannot say (k3 in Kalibr) is refused, never dropped.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibration.plain_yaml import PlainYamlError, read_plain_yaml
from calibration.projection import PinholeCamera
from mvp.errors import CalibrationError
from mvp.fileedge import read_file

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from calibration.plain_yaml import Value
    from mvp.geometry import FloatArray

_LARGEST_FILE = 1 << 20
_HINT = "name an OpenCV, ROS camera_info or Kalibr camchain file of a pinhole camera"
_ROS_MODELS = ("plumb_bob", "rational_polynomial")


@dataclass(frozen=True)
class CameraFile:
    """What all three formats have in common.

    Attributes:
        camera: intrinsics and distortion.
        width_px: columns of the pictures.
        height_px: rows of the pictures.
        name: of the camera; empty when the file has none.
    """

    camera: PinholeCamera
    width_px: int
    height_px: int
    name: str = ""


def read_camera(path: Path) -> CameraFile:
    """Read any of the three formats; which one shows in its keys.

    Raises:
        CalibrationError: unreadable, another format, or a model that is not ours.
    """
    content = read_file(path, CalibrationError, hint=_HINT, at_most=_LARGEST_FILE)
    try:
        return parse_camera(content.decode("utf-8"))
    except (PlainYamlError, UnicodeDecodeError) as error:
        raise CalibrationError(
            f"{path}: {error}", hint=_HINT, where=str(path)
        ) from error
    except CalibrationError as error:
        raise CalibrationError(
            f"{path}: {error.message}", hint=error.hint, where=str(path)
        ) from error


def parse_camera(text: str) -> CameraFile:
    """As ``read_camera``, from the text.

    Raises:
        PlainYamlError: the text is not such YAML.
        CalibrationError: another format, or a model that is not ours.
    """
    data = read_plain_yaml(text)
    for key in sorted(data):
        chain = data[key]
        if isinstance(chain, dict) and "camera_model" in chain:
            return _from_kalibr(chain, key)
    if "camera_matrix" in data or "K" in data or "k" in data:
        return _from_matrix(data)
    raise CalibrationError("no camera is described here", hint=_HINT)


def opencv_yaml(file: CameraFile) -> str:
    """For ``cv2.FileStorage``: keys as its calibration sample writes them."""
    return (
        "%YAML:1.0\n---\n"
        f"image_width: {file.width_px}\nimage_height: {file.height_px}\n"
        + _opencv_matrix("camera_matrix", file.camera.matrix)
        + _opencv_matrix("distortion_coefficients", file.camera.distortion[:, None])
    )


def ros_camera_info(file: CameraFile) -> str:
    """For ROS ``camera_info_manager``; rectification is the identity."""
    camera = file.camera
    projection = np.column_stack([camera.matrix, np.zeros(3)])
    return (
        f"image_width: {file.width_px}\nimage_height: {file.height_px}\n"
        f"camera_name: {_quoted(file.name or 'camera')}\n"
        + _ros_matrix("camera_matrix", camera.matrix)
        + "distortion_model: plumb_bob\n"
        + _ros_matrix("distortion_coefficients", camera.distortion[None])
        + _ros_matrix("rectification_matrix", np.eye(3))
        + _ros_matrix("projection_matrix", projection)
    )


def kalibr_camchain(file: CameraFile, *, topic: str = "") -> str:
    """For Kalibr: one camera, ``pinhole`` and ``radtan``.

    Raises:
        CalibrationError: k3 is not zero, which Kalibr's model does not have.
    """
    camera = file.camera
    if camera.k3:
        raise CalibrationError(
            f"Kalibr's radtan model has no k3 (it is {camera.k3:.3g} here)",
            hint="calibrate again with k3 held at zero",
        )
    intrinsics = [camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px]
    distortion = [camera.k1, camera.k2, camera.p1, camera.p2]
    return (
        "cam0:\n"
        "  camera_model: pinhole\n"
        f"  intrinsics: {_numbers(intrinsics)}\n"
        "  distortion_model: radtan\n"
        f"  distortion_coeffs: {_numbers(distortion)}\n"
        f"  resolution: [{file.width_px}, {file.height_px}]\n"
        f"  rostopic: {_quoted(topic or '/' + (file.name or 'camera'))}\n"
    )


def _from_kalibr(chain: Mapping[str, Value], key: str) -> CameraFile:
    model, distortion = chain.get("camera_model"), chain.get("distortion_model")
    if model != "pinhole" or distortion not in ("radtan", "none"):
        raise _foreign(f"{key} is {model} with {distortion} distortion")
    terms = _vector(chain.get("distortion_coeffs", []), "distortion_coeffs")
    intrinsics = _vector(chain.get("intrinsics"), "intrinsics", count=4)
    size = _vector(chain.get("resolution"), "resolution", count=2)
    return _file(intrinsics, terms, size[0], size[1], str(chain.get("rostopic") or key))


def _from_matrix(data: Mapping[str, Value]) -> CameraFile:
    """OpenCV, ROS calibration file, or a ROS message printed as text."""
    model = data.get("distortion_model") or "plumb_bob"
    if model not in _ROS_MODELS:
        raise _foreign(f"the distortion model is {model}")
    matrix = _vector(_first(data, "camera_matrix", "K", "k"), "camera_matrix", count=9)
    named = _first(data, "distortion_coefficients", "D", "d")
    terms = _vector([] if named is None else named, "distortion_coefficients")
    if abs(matrix[1]) > 1e-9:
        raise _foreign("the pixel axes are skewed")
    width = _first(data, "image_width", "width")
    height = _first(data, "image_height", "height")
    if not (isinstance(width, float) and isinstance(height, float)):
        raise CalibrationError("image_width or image_height is missing", hint=_HINT)
    intrinsics = matrix[[0, 4, 2, 5]]
    return _file(intrinsics, terms, width, height, str(data.get("camera_name") or ""))


def _file(
    intrinsics: FloatArray, terms: FloatArray, width: float, height: float, name: str
) -> CameraFile:
    if len(terms) > 5 and terms[5:].any():
        raise _foreign("the distortion has more terms than k1, k2, p1, p2, k3")
    if not ((intrinsics[:2] > 0).all() and width > 1 and height > 1):
        raise CalibrationError("focal length and size must be positive", hint=_HINT)
    padded = np.concatenate([terms[:5], np.zeros(5 - min(len(terms), 5))])
    camera = PinholeCamera.from_values(np.concatenate([intrinsics, padded]))
    return CameraFile(camera, int(width), int(height), name)


def _first(data: Mapping[str, Value], *keys: str) -> Value:
    return next((data[key] for key in keys if data.get(key) is not None), None)


def _vector(value: Value, name: str, *, count: int | None = None) -> FloatArray:
    """Numbers, flat; of a matrix its ``data``."""
    if isinstance(value, dict):
        value = value.get("data")
    try:
        numbers = np.asarray(value, dtype=np.float64).ravel()
    except (TypeError, ValueError):
        numbers = np.array([np.nan])
    if not np.isfinite(numbers).all() or count not in (None, numbers.size):
        wanted = "numbers" if count is None else f"{count} numbers"
        raise CalibrationError(f"{name} must be {wanted}", hint=_HINT)
    return numbers


def _foreign(what: str) -> CalibrationError:
    return CalibrationError(
        f"{what}, which is not a pinhole camera with k1, k2, p1, p2, k3",
        hint="calibrate with this model, or export it from there",
    )


def _numbers(values: Sequence[float] | FloatArray) -> str:
    return "[" + ", ".join(repr(float(value)) for value in values) + "]"


def _quoted(text: str) -> str:
    return '"' + text.replace('"', "'").replace("\n", " ") + '"'


def _opencv_matrix(name: str, matrix: FloatArray) -> str:
    rows, columns = matrix.shape
    return (
        f"{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n"
        f"   data: {_numbers(matrix.ravel())}\n"
    )


def _ros_matrix(name: str, matrix: FloatArray) -> str:
    rows, columns = matrix.shape
    data = _numbers(matrix.ravel())
    return f"{name}:\n  rows: {rows}\n  cols: {columns}\n  data: {data}\n"
