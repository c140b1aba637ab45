"""The lens setting at which a cell works, and how far depth of field reaches there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mvp.optics import (
    focus_distance_mm,
    image_distance_mm,
    principal_distance_mm,
    smallest_pupil_mm,
)

if TYPE_CHECKING:
    from calibration.wizard.session_store import SessionStore
    from mvp.optics import LensSetting
    from mvp.wizard import SessionFacts

BLUR_LIMIT_PX = 3.0
_DEPTH_SHARE = 0.3
_LENS_SETTING = "lens_setting"


@dataclass(frozen=True)
class Setting:
    """Motor steps for all pictures of one purpose.

    Attributes:
        zoom: steps.
        focus: steps.
        iris: steps.
        limit_px: largest blur circle in a picture.
    """

    zoom: int
    focus: int
    iris: int
    limit_px: float = BLUR_LIMIT_PX

    @property
    def by_name(self) -> dict[str, int]:
        """As the bench and the table take them."""
        return {"zoom": self.zoom, "focus": self.focus, "iris": self.iris}

    def stand_off_mm(self, facts: SessionFacts) -> float:
        """Where errors are stated: the working distance, else where it is sharp."""
        if facts.working_mm is not None:
            return facts.working_mm
        return sharp_mm(facts.lens_at(self.by_name))


def sharp_mm(lens: LensSetting) -> float:
    """Distance in best focus from the entrance pupil."""
    return float(focus_distance_mm(lens.d_mm, lens.f_mm)) - lens.e_mm


def working_setting(facts: SessionFacts) -> Setting:
    """Where the cell works: the setting of the present hand-eye calibration.

    Focused on the working distance where one is stated; without a reference at the
    middle of the zoom range; always where the lens table holds. The pupil is so small
    that 30 % nearer is still sharp.
    """
    table, known = facts.table_in_use, facts.hand_eye
    f_low, f_high = table.f_range_mm
    f = known.reference_f_mm or float(np.sqrt(f_low * f_high))
    f = float(np.clip(f, f_low, f_high))
    table = table.at_focal_length(f)
    d_low, d_high = table.d_range_mm(f)
    d = known.reference_d_mm or (d_low + d_high) / 2
    if facts.working_mm is not None:
        distance = facts.working_mm + table.pupil_offset_mm
        d = float(image_distance_mm(distance, f))
    d = float(np.clip(d, d_low, d_high))
    return setting_at(facts, f, d)


def setting_of(store: SessionStore) -> Setting:
    """The lens setting of all pictures of a session; chosen once."""
    known = store.recall(_LENS_SETTING)
    if isinstance(known, list):
        zoom, focus, iris = (int(str(step)) for step in known)
        return Setting(zoom, focus, iris)
    setting = working_setting(store.facts)
    store.remember(_LENS_SETTING, [setting.zoom, setting.focus, setting.iris])
    return setting


def setting_at(facts: SessionFacts, f_mm: float, d_mm: float) -> Setting:
    """Steps for f and d, with the pupil that the depth of field asks for."""
    table = facts.table_in_use
    a = pupil_for_depth(facts, f_mm, d_mm)
    found = table.nearest(f_mm, d_mm, a)
    steps = table.steps(found.f_mm, found.d_mm, found.a_mm)
    return Setting(steps.zoom, steps.focus, steps.iris)


def pupil_for_depth(
    facts: SessionFacts,
    f_mm: float,
    d_mm: float,
    *,
    depth_share: float = _DEPTH_SHARE,
    limit_px: float = BLUR_LIMIT_PX,
) -> float:
    """The largest pupil that is sharp from so much nearer than the sharp distance on.

    Never so small that diffraction blurs more than is gained.
    """
    table, pitch = facts.table_in_use.at_focal_length(f_mm), facts.sensor.pitch_y_mm
    m = (d_mm - f_mm) / f_mm
    f_cal = float(principal_distance_mm(d_mm, f_mm, table.pupil_offset_mm))
    slope = m * depth_share / (1 - depth_share)
    wanted = limit_px * pitch / slope
    least = float(smallest_pupil_mm(f_cal, limit_px * pitch, facts.wavelength_mm))
    return float(np.clip(max(wanted, least), *table.a_range_mm))
