"""Cameras from and for other programs: OpenCV YAML, ROS camera_info, Kalibr camchain.

All three hold a pinhole camera with Brown's distortion. What our model cannot say (fisheye
and rational models) and what theirs cannot say (k3 in Kalibr) is refused, never dropped.
"""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeGuard

import numpy as np

from calibration.plain_yaml import PlainYamlError, read_plain_yaml
from calibration.projection import PinholeCamera
from mvp.errors import CalibrationError
from mvp.fileedge import read_file
from mvp.wizard import OF_SIMULATED_CELL

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from calibration.plain_yaml import Value
    from mvp.geometry import FloatArray

_LARGEST_FILE = 1 << 20
_HINT = "name an OpenCV, ROS camera_info or Kalibr camchain file of a pinhole camera"
_PLAIN_MODELS = ("pinhole", "PINHOLE")
_ROS_MODELS = ("plumb_bob", "rational_polynomial")
_NOTE_OF_SIMULATED = re.compile(rf"^# camera .*\b{OF_SIMULATED_CELL} ", re.MULTILINE)
_TERMS = (0, 4, 5, 8, 12, 14)  # as OpenCV has them
_OPENCV_KEYS = frozenset(
    ("camera_matrix", "distortion_coefficients", "image_width", "image_height")
)
_ROS_ONLY = frozenset(
    "camera_name distortion_model rectification_matrix projection_matrix".split()
    + "K k D d R r P p width height".split()
)
_ROS_KEYS = _OPENCV_KEYS | _ROS_ONLY | {"header", "binning_x", "binning_y", "roi"}
_KALIBR_KEYS = frozenset(
    "camera_model intrinsics distortion_model distortion_coeffs resolution rostopic".split()
)


@dataclass(frozen=True)
class CameraFile:
    """What all three formats have in common.

    Attributes:
        camera: intrinsics and distortion.
        width_px: columns of the pictures.
        height_px: rows of the pictures.
        name: of the camera; empty when the file has none.
        format: opencv, ros or kalibr, of a file that was read; so are all that follow.
        keys: under which the file has intrinsics, distortion and size.
        unused: keys that say nothing about intrinsics.
        simulated: its notes say that it was exported from a simulated cell.
        sha256: of the file.
    """

    camera: PinholeCamera
    width_px: int
    height_px: int
    name: str = ""
    format: str = ""
    keys: tuple[str, str, str] = ("", "", "")
    unused: tuple[str, ...] = ()
    simulated: bool = False
    sha256: str = ""


def read_camera(path: Path) -> CameraFile:
    """Read any of the three formats; which one shows in its keys.

    Raises:
        CalibrationError: unreadable, another format, or a model that is not ours.
    """
    content = read_file(path, CalibrationError, hint=_HINT, at_most=_LARGEST_FILE + 1)
    try:
        if len(content) > _LARGEST_FILE:
            raise CalibrationError("larger than any camera file", hint=_HINT)
        text = content.decode("utf-8")
        return replace(
            parse_camera(text),
            simulated=_NOTE_OF_SIMULATED.search(text) is not None,
            sha256=hashlib.sha256(content).hexdigest(),
        )
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
    chains = {
        key: chain
        for key, chain in data.items()
        if isinstance(chain, dict) and "camera_model" in chain
    }
    if len(chains) > 1:
        raise CalibrationError(
            f"{len(chains)} cameras are described here: {', '.join(sorted(chains))}",
            hint="leave only one of them in the file",
        )
    if chains:
        ((key, chain),) = chains.items()
        return _from_kalibr(chain, key)
    if "camera_matrix" in data or "K" in data or "k" in data:
        return _from_matrix(data)
    raise CalibrationError(
        "no camera is described here: neither camera_matrix nor K, nor a camera_model",
        hint=_HINT,
    )


def with_notes(text: str, notes: Sequence[str]) -> str:
    """The same file with lines of comment, which all three programs pass over.

    YAML has no control characters, not even there: they are left out.
    """
    head, mark, body = text.rpartition("---\n")
    plain = (" ".join(note.split()) for note in notes)
    lines = "".join(f"# {''.join(filter(str.isprintable, n))}\n" for n in plain)
    return head + mark + lines + body


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
    there: dict[str, Value] = {"distortion_coeffs": []} if distortion == "none" else {}
    terms = _vector(there | dict(chain), "distortion_coeffs", count=(0, 4))
    contradicted = not len(terms) if distortion == "radtan" else terms.any()
    if contradicted:
        raise CalibrationError(
            f"distortion_coeffs has {len(terms)} numbers, but distortion_model is "
            f"{distortion}",
            hint="radtan has 4 numbers, none has zeros or nothing",
        )
    intrinsics = _vector(chain, "intrinsics", count=(4,))
    size = _vector(chain, "resolution", count=(2,))
    keys = ("intrinsics", "distortion_coeffs", "resolution")
    found = _file(intrinsics, terms, size[0], size[1], keys)
    return replace(
        found,
        name=str(chain.get("rostopic") or key),
        format="kalibr",
        unused=tuple(sorted(chain.keys() - _KALIBR_KEYS)),
    )


def _from_matrix(data: Mapping[str, Value]) -> CameraFile:
    """OpenCV, ROS calibration file, or a ROS message printed as text."""
    _refuse_other_models(data)
    keys = (
        _key(data, "camera_matrix", "K", "k"),
        _key(data, "distortion_coefficients", "D", "d"),
        _key(data, "image_width", "width"),
    )
    matrix = _vector(data, keys[0], count=(9,))
    terms = _vector(data, keys[1], count=_TERMS)
    _refuse_other_matrices(matrix, keys[0])
    width = _number(data, keys[2])
    height = _number(data, _key(data, "image_height", "height"))
    found = _file(matrix[[0, 4, 2, 5]], terms, width, height, keys)
    ros = bool(data.keys() & _ROS_ONLY)
    return replace(
        found,
        name=str(data.get("camera_name") or ""),
        format="ros" if ros else "opencv",
        unused=tuple(sorted(data.keys() - (_ROS_KEYS if ros else _OPENCV_KEYS))),
    )


def _refuse_other_models(data: Mapping[str, Value]) -> None:
    """Other lenses, and pictures that are a part of those that were calibrated."""
    model = data.get("distortion_model") or "plumb_bob"
    if model not in _ROS_MODELS:
        raise _foreign(f"distortion_model is {model}")
    if data.get("fisheye_model"):
        raise _foreign(f"fisheye_model is {data['fisheye_model']}")
    if (data.get("camera_model") or "pinhole") not in _PLAIN_MODELS:
        raise _foreign(f"camera_model is {data['camera_model']}")
    roi = data.get("roi")
    parts = {f"roi.{key}": value for key, value in roi.items()} if _is_map(roi) else {}
    whole = {
        "roi.width": data.get(_key(data, "image_width", "width")),
        "roi.height": data.get(_key(data, "image_height", "height")),
        "roi.do_rectify": parts.get("roi.do_rectify"),
    }
    parts = {k: v for k, v in parts.items() if v != whole.get(k)}
    binned = {key: data.get(key) for key in ("binning_x", "binning_y")}
    for key, value in (parts | {k: v for k, v in binned.items() if v != 1.0}).items():
        if value:
            raise CalibrationError(
                f"{key} is {value}: these pictures are a part of what was calibrated",
                hint="calibrate with whole pictures, or remove the key if they are",
            )


def _refuse_other_matrices(matrix: FloatArray, key: str) -> None:
    if abs(matrix[1]) > 1e-9:
        raise _foreign(f"{key}: the pixel axes are skewed")
    if np.abs(matrix[[3, 6, 7]]).max() > 1e-9 or abs(matrix[8] - 1) > 1e-9:
        raise CalibrationError(
            f"{key} must read fx, 0, cx, 0, fy, cy, 0, 0, 1, row by row",
            hint="exchange rows and columns, or divide by the last number",
        )


def _file(
    intrinsics: FloatArray,
    terms: FloatArray,
    width: float,
    height: float,
    keys: tuple[str, str, str],
) -> CameraFile:
    if len(terms) > 5 and terms[5:].any():
        raise _foreign(f"{keys[1]} has more terms than k1, k2, p1, p2, k3")
    if not (intrinsics[:2] > 0).all():
        raise CalibrationError(f"{keys[0]}: fx and fy must be positive", hint=_HINT)
    if not all(size > 1 and size == int(size) for size in (width, height)):
        raise CalibrationError(
            f"{keys[2]}: the size must be two whole numbers of pixels", hint=_HINT
        )
    padded = np.concatenate([terms[:5], np.zeros(5 - min(len(terms), 5))])
    camera = PinholeCamera.from_values(np.concatenate([intrinsics, padded]))
    return CameraFile(camera, int(width), int(height), keys=keys)


def _is_map(value: Value) -> TypeGuard[dict[str, Value]]:
    return isinstance(value, dict)


def _key(data: Mapping[str, Value], *keys: str) -> str:
    """The first that says something; else the first."""
    return next((key for key in keys if data.get(key) is not None), keys[0])


def _number(data: Mapping[str, Value], key: str) -> float:
    value = data.get(key)
    if not (isinstance(value, float) and np.isfinite(value)):
        what = "is missing" if value is None else "must be a number"
        raise CalibrationError(f"{key} {what}", hint=_HINT)
    return value


def _vector(
    data: Mapping[str, Value], key: str, *, count: tuple[int, ...]
) -> FloatArray:
    """Numbers, flat; of a matrix its ``data``."""
    value = data.get(key)
    if value is None:
        raise CalibrationError(f"{key} is missing", hint=_HINT)
    rows, columns = 0.0, 0.0
    if isinstance(value, dict):
        rows, columns = (_number(value, name) for name in ("rows", "cols"))
        value = value.get("data")
    try:
        numbers = np.asarray(value, dtype=np.float64).ravel()
    except (TypeError, ValueError):
        numbers = np.array([np.nan])
    wanted = "or ".join(f"{number} " for number in count)
    if not np.isfinite(numbers).all() or numbers.size not in count:
        raise CalibrationError(f"{key} must be {wanted}numbers", hint=_HINT)
    if rows * columns not in (0, numbers.size):
        raise CalibrationError(
            f"{key} has {numbers.size} numbers, not {rows:g} x {columns:g}", hint=_HINT
        )
    return numbers


def _foreign(what: str) -> CalibrationError:
    return CalibrationError(
        f"{what}, which is not a pinhole camera with k1, k2, p1, p2, k3",
        hint="calibrate with this model, or export it from there",
    )


def _numbers(values: Sequence[float] | FloatArray) -> str:
    return "[" + ", ".join(_exact(float(value)) for value in values) + "]"


def _exact(value: float) -> str:
    """To the last digit; YAML 1.1 takes 1e-05 for text, 1.0e-05 for a number."""
    digits, e, power = repr(value).partition("e")
    return f"{digits}{'' if '.' in digits else '.0'}{e}{power}"


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
