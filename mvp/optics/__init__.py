"""Views, sensor, thick lens, projection, blur budget, lens table."""

from mvp.optics.intrinsics import Intrinsics
from mvp.optics.sensor import Sensor
from mvp.optics.views import Views, single_view

__all__ = ["Intrinsics", "Sensor", "Views", "single_view"]
