"""Whether the picture stands still once the arm says that it does: two frames compared.

An arm reports standstill by its encoders; flange, camera and part may go on ringing.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

from mvp.cell.records import Stillness
from mvp.errors import DeviceFault
from mvp.imaging import picture_shift

if TYPE_CHECKING:
    from mvp.cell.plan_job import Setting
    from mvp.devices import Frame

_LOG = logging.getLogger(__name__)
_SIGMAS = 3.0
_SAME_THING = 0.5  # correlation; frames of one scene have 0.9 and more
_ALIKE = 2.0  # exposures within this factor show the same places


@dataclass(frozen=True)
class StillCheck:
    """Compares two frames of a view.

    Attributes:
        within_px: largest displacement that is as good as none.
        settle_s: what was waited after the arm's standstill, for the message.
    """

    within_px: float
    settle_s: float

    @classmethod
    def of_cell(cls, setting: Setting) -> Self | None:
        """Half of the blur that views are planned for; None where it is switched off.

        In squares, a smear of half its width adds a quarter to a blur at that limit.
        """
        settle, factory = setting.cell.config.settle, setting.factory
        if not settle.compare_frames:
            return None
        sensor = factory.intrinsics.sensor
        pitch_mm = min(sensor.pitch_x_mm, sensor.pitch_y_mm)
        return cls(factory.c_mm / pitch_mm / 2, settle.arm_s)

    def comparable(self, before: Frame, frame: Frame) -> bool:
        """Whether an earlier frame of the same stand will do as the other one."""
        if before.gain != frame.gain:
            return False
        return 1 / _ALIKE <= before.exposure_s / frame.exposure_s <= _ALIKE

    def of(self, one: Frame, other: Frame, *, standing_s: float) -> Stillness:
        """What two frames of the same stand show; raises for none."""
        first, second = sorted((one, other), key=lambda f: f.exposure_start_s)
        found = picture_shift(first.pixels, second.pixels, first.full_scale)
        seen = found.visible_px(self.within_px)
        shift_px, sigma_px = (None, None) if seen is None else seen
        return Stillness(
            shift_px=shift_px,
            sigma_px=sigma_px,
            within_px=self.within_px,
            likeness=found.likeness,
            apart_s=second.exposure_start_s - first.exposure_start_s,
            waited_s=first.exposure_start_s - standing_s,
        )

    def require(self, found: Stillness, *, view: str, arm: str) -> None:
        """Say what was found.

        Raises:
            DeviceFault: the picture moved by more than is allowed, or changed.
        """
        hint = (
            f"raise [settle] arm_s (now {self.settle_s:g} s), or lens_s where a lens "
            "settles last, in the cell file, or look for a loose camera, a shaking table "
            "or something that moves in the picture; then run again"
        )
        if found.likeness < _SAME_THING:
            what = f"the picture changed altogether in {found.apart_s:.2f} s"
            hint = f"look whether a lamp went out or something came before it; {hint}"
        elif found.shift_px is None or found.sigma_px is None:
            _LOG.warning(
                "%s: nothing in the picture of %s would show that it moves", arm, view
            )
            return
        else:
            what = (
                f"the picture moved by {found.shift_px:.2f} px in {found.apart_s:.2f} s, "
                f"allowed {found.within_px:.2f} px"
            )
            if found.shift_px - _SIGMAS * found.sigma_px <= found.within_px:
                _LOG.info("%s: still at %s: %s", arm, view, what)
                return
        raise DeviceFault(
            f"is not still at {view}: {what}, {found.waited_s:.2f} s after it reported "
            "standstill",
            device=arm,
            hint=hint,
        )
