"""``[light]`` of a cell: what is believed about the light that travels with the camera."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pydantic import Field

from mvp.cell.values import NotNegative, Point, Positive
from mvp.devices import LampBelief, LightBelief
from mvp.fileedge import FileModel

if TYPE_CHECKING:
    from mvp.imaging import Illumination


class LampConfig(FileModel):
    """A lamp fixed to the camera."""

    position_mm: Point = Field(
        description="camera frame: x right, y down, z forward; the origin stands for a "
        "ring round the lens"
    )
    strength: NotNegative = Field(
        description="grey of a white face lit squarely at reference_mm"
    )


def _lamps() -> list[LampConfig]:
    return [
        LampConfig(position_mm=(0.0, 0.0, 0.0), strength=0.3),
        LampConfig(position_mm=(-150.0, -110.0, 20.0), strength=0.6),
    ]


class LightConfig(FileModel):
    """Lamps and ambient light; only ratios of brightness count.

    A view's roll and place are chosen so that every line that will be measured shows at
    least ``min_contrast``, twice that if possible.
    """

    ambient: NotNegative = 0.05
    lamps: list[LampConfig] = Field(default_factory=_lamps)
    reference_mm: Positive = 300.0
    gloss: NotNegative = 0.1
    gloss_exponent: Positive = 30.0
    background: NotNegative = 0.01
    min_contrast: float = Field(
        default=0.05,
        ge=0,
        le=0.5,
        description="step over the brighter grey that a line must show to be measured",
    )

    @property
    def belief(self) -> LightBelief:
        """Plain data for a simulated world."""
        lamps = tuple(
            LampBelief(lamp.position_mm, lamp.strength) for lamp in self.lamps
        )
        return LightBelief(
            self.ambient,
            lamps,
            self.reference_mm,
            self.gloss,
            self.gloss_exponent,
            self.background,
        )


def illumination(light: LightConfig | None) -> Illumination | None:
    """The light model that pictures are predicted with; None when nothing is known."""
    from mvp.imaging import Illumination, Lamp

    if light is None:
        return None
    return Illumination(
        light.ambient,
        tuple(Lamp(lamp.position_mm, lamp.strength) for lamp in light.lamps),
        light.reference_mm,
        light.gloss,
        light.gloss_exponent,
        light.background,
    )
