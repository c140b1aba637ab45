"""Which result it is, whatever its file looks like, and which ones it was made with."""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from mvp.calibrated.models import (
        CameraCalibration,
        LensTableCalibration,
        RigidCalibration,
    )
    from mvp.fileedge import FileModel

# A lens table has centres and distances of its own; only the pixels are the camera's.
BUILDS_ON: Final = {
    "camera": (),
    "lens_table": ("sensor",),
    "hand_eye": ("camera", "lens_table"),
    "part_pose": ("camera", "lens_table", "hand_eye"),
}
_ABOUT_IT: Final = {"provenance", "quality", "validity"}
_AXES: Final = ("zoom_f_mm", "focus_extension_mm", "iris_a_mm")


def content_sha256(model: FileModel) -> str:
    """SHA-256 of everything that a result says; of one written as a new file too."""
    return hashlib.sha256(model.model_dump_json(by_alias=True).encode()).hexdigest()


def numbers_sha256(model: FileModel) -> str:
    """SHA-256 of what others compute with: not where it comes from, nor how good it is.

    What is as by default does not count, so that a later version, which may say more,
    finds the same; nor do the sides of approach, which the lens itself tells.
    """
    about = dict.fromkeys(_ABOUT_IT, True) | {
        axis: {"approach": True} for axis in _AXES
    }
    own = {
        name: what for name, what in about.items() if name in type(model).model_fields
    }
    text = model.model_dump_json(by_alias=True, exclude_defaults=True, exclude=own)
    return hashlib.sha256(text.encode()).hexdigest()


def sensor_sha256(camera: CameraCalibration) -> str:
    """SHA-256 of the camera's mode: how many pixels, how large."""
    size = (camera.width_px, camera.height_px)
    pitch = (camera.pitch_x_um, camera.pitch_y_um)
    return hashlib.sha256(repr((size, pitch)).encode()).hexdigest()


def inputs_sha256(
    name: str,
    camera: CameraCalibration,
    lens_table: LensTableCalibration,
    hand_eye: RigidCalibration,
) -> dict[str, str]:
    """What a calibration builds on, by name, if it is made with these.

    Args:
        name: as in ``[calibration]`` of a cell.
        camera: in use.
        lens_table: in use.
        hand_eye: in use.
    """
    hashes = {
        "sensor": sensor_sha256(camera),
        "camera": numbers_sha256(camera),
        "lens_table": numbers_sha256(lens_table),
        "hand_eye": numbers_sha256(hand_eye),
    }
    return {used: hashes[used] for used in BUILDS_ON[name]}
