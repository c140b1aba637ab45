"""Arm models, camera placement by (19)-(25), clearance, paths."""

from mvp.kinematics.camera_pose import (
    base_from_part,
    base_from_tool,
    camera_rotation,
    part_from_camera,
    roll_of,
    tool_from_camera_at,
)
from mvp.kinematics.capsule import Capsule, Capsules, carried
from mvp.kinematics.clearance import (
    CellBodies,
    Nearest,
    Obstacle,
    blocked_sight,
    obstacles,
)
from mvp.kinematics.clearance_index import ClearanceIndex, clearance_index
from mvp.kinematics.gantry import Gantry
from mvp.kinematics.model import ArmModel, inverse, jacobian, singularity_margin
from mvp.kinematics.models import (
    ARM_MODELS,
    NEEDS_HEAD,
    arm_model,
    arm_model_names,
)
from mvp.kinematics.mounted_camera import MountedCamera, intrinsics_of, sensor_of
from mvp.kinematics.path import (
    JointPath,
    NoPath,
    PathClearance,
    find_path,
    segment_clearance,
)
from mvp.kinematics.realise import (
    Placement,
    ReachMargin,
    Realisation,
    Unreachable,
    realisations,
)
from mvp.kinematics.ur import UrArm
from mvp.kinematics.ur_calibration import UrCalibration

__all__ = [
    "ARM_MODELS",
    "NEEDS_HEAD",
    "ArmModel",
    "Capsule",
    "Capsules",
    "CellBodies",
    "ClearanceIndex",
    "Gantry",
    "JointPath",
    "MountedCamera",
    "Nearest",
    "NoPath",
    "Obstacle",
    "PathClearance",
    "Placement",
    "ReachMargin",
    "Realisation",
    "Unreachable",
    "UrArm",
    "UrCalibration",
    "arm_model",
    "arm_model_names",
    "base_from_part",
    "base_from_tool",
    "blocked_sight",
    "camera_rotation",
    "carried",
    "clearance_index",
    "find_path",
    "intrinsics_of",
    "inverse",
    "jacobian",
    "obstacles",
    "part_from_camera",
    "realisations",
    "roll_of",
    "segment_clearance",
    "sensor_of",
    "singularity_margin",
    "tool_from_camera_at",
]
