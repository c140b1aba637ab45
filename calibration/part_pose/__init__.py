"""Pose of a part from its own corners, holes and edges."""

from calibration.part_pose.judge import judge_located, judge_resection
from calibration.part_pose.locate import (
    HandEye,
    LocatedPart,
    PartView,
    locate,
    own_shares,
    viewpoint_covariance,
)
from calibration.part_pose.resection import (
    AMBIGUOUS_BELOW,
    Branch,
    Resection,
    by_camera,
    resect,
)
from calibration.part_pose.sightings import (
    PartSight,
    SeenCircles,
    SeenEdges,
    SeenPoints,
)

__all__ = [
    "AMBIGUOUS_BELOW",
    "Branch",
    "HandEye",
    "LocatedPart",
    "PartSight",
    "PartView",
    "Resection",
    "SeenCircles",
    "SeenEdges",
    "SeenPoints",
    "by_camera",
    "judge_located",
    "judge_resection",
    "locate",
    "own_shares",
    "resect",
    "viewpoint_covariance",
]
