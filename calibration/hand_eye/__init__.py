"""Where the camera sits on the hand, or beside the robot."""

from calibration.hand_eye.closed_form import Method, closed_form, target_in_fixed
from calibration.hand_eye.data import HandEyeData, RobotNoise
from calibration.hand_eye.judge import HandEyeLimits
from calibration.hand_eye.motions import Mount, fixed_from_moving
from calibration.hand_eye.observability import Observability, observability
from calibration.hand_eye.readings import (
    Reading,
    ReadingCheck,
    check_readings,
    layouts_that_fit,
    poses_from_numbers,
)
from calibration.hand_eye.record import hand_eye_calibration
from calibration.hand_eye.refine import CameraPrior
from calibration.hand_eye.rehearsal import Rehearsal, Rehearsed, rehearse
from calibration.hand_eye.result import HandEyeResult, HandEyeSolution
from calibration.hand_eye.solve import calibrate_hand_eye

__all__ = [
    "CameraPrior",
    "HandEyeData",
    "HandEyeLimits",
    "HandEyeResult",
    "HandEyeSolution",
    "Method",
    "Mount",
    "Observability",
    "Reading",
    "ReadingCheck",
    "Rehearsal",
    "Rehearsed",
    "RobotNoise",
    "calibrate_hand_eye",
    "check_readings",
    "closed_form",
    "fixed_from_moving",
    "hand_eye_calibration",
    "layouts_that_fit",
    "observability",
    "poses_from_numbers",
    "rehearse",
    "target_in_fixed",
]
