"""Views, sensor, thick lens, projection, blur budget, lens table."""

from mvp.optics.achievable import achievable_set, achievable_words
from mvp.optics.blur import (
    BlurBudget,
    airy_diameter_mm,
    airy_fwhm_mm,
    smallest_pupil_mm,
    working_f_number,
)
from mvp.optics.intrinsics import Intrinsics
from mvp.optics.lens_table import (
    LensSetting,
    LensSteps,
    LensTable,
    pupil_shift_mm,
)
from mvp.optics.motor_axis import AxisName, MotorAxis
from mvp.optics.sensor import Sensor
from mvp.optics.thick_lens import (
    depth_limits_mm,
    equal_blur_image_distance_mm,
    focus_distance_mm,
    image_distance_mm,
    principal_distance_mm,
    signed_blur_mm,
)
from mvp.optics.views import Views, concatenated, single_view
from mvp.optics.zoom_curves import ZoomCurves, ZoomOptics

__all__ = [
    "AxisName",
    "BlurBudget",
    "Intrinsics",
    "LensSetting",
    "LensSteps",
    "LensTable",
    "MotorAxis",
    "Sensor",
    "Views",
    "ZoomCurves",
    "ZoomOptics",
    "achievable_set",
    "achievable_words",
    "airy_diameter_mm",
    "airy_fwhm_mm",
    "concatenated",
    "depth_limits_mm",
    "equal_blur_image_distance_mm",
    "focus_distance_mm",
    "image_distance_mm",
    "principal_distance_mm",
    "pupil_shift_mm",
    "signed_blur_mm",
    "single_view",
    "smallest_pupil_mm",
    "working_f_number",
]
