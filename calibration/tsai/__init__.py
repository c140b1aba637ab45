"""Tsai's camera model and his two-stage calibration from one view (1987)."""

from calibration.tsai.calibrate import TsaiEstimate, TsaiOptions, tsai_calibrate
from calibration.tsai.convert import FitOfModels, pinhole_from_tsai, tsai_from_pinhole
from calibration.tsai.model import TsaiCamera
from calibration.tsai.sampling import Sampling
from calibration.tsai.stages import TwoStage, two_stage

__all__ = [
    "FitOfModels",
    "Sampling",
    "TsaiCamera",
    "TsaiEstimate",
    "TsaiOptions",
    "TwoStage",
    "pinhole_from_tsai",
    "tsai_calibrate",
    "tsai_from_pinhole",
    "two_stage",
]
