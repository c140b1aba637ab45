"""The true light of the virtual cell: what the cell states, with configured errors."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mvp.imaging import Illumination, Lamp

if TYPE_CHECKING:
    from drivers.virtual_settings import LightSettings, WorldErrors
    from mvp.devices import LightBelief
    from mvp.geometry import FloatArray


def true_light(
    stated: LightBelief | None,
    settings: LightSettings | None,
    errors: WorldErrors,
    moved_mm: FloatArray,
) -> Illumination:
    """Lamps that travel with the camera, and the ambient part.

    Args:
        stated: what the cell says.
        settings: the world's own light, instead of the cell's.
        errors: brightness and ambient light off by so much.
        moved_mm: (3,) shift of every lamp that is not a ring on the lens.
    """
    light = _without_errors(stated, settings)
    lamps = tuple(
        lamp if not any(lamp.position_mm) else _moved(lamp, moved_mm)
        for lamp in light.lamps
    )
    wrong = Illumination(
        max(light.ambient + errors.ambient, 0.0),
        lamps,
        light.reference_mm,
        light.gloss,
        light.gloss_exponent,
        light.background,
    )
    return wrong.scaled(1 + errors.light_fraction) if errors.light_fraction else wrong


def _without_errors(
    stated: LightBelief | None, settings: LightSettings | None
) -> Illumination:
    if settings is not None:
        lamps = tuple(Lamp(lamp.position_mm, lamp.strength) for lamp in settings.lamps)
        return Illumination(ambient=settings.ambient, lamps=lamps, gloss=settings.gloss)
    if stated is None:
        return Illumination()
    return Illumination(
        stated.ambient,
        tuple(Lamp(lamp.position_mm, lamp.strength) for lamp in stated.lamps),
        stated.reference_mm,
        stated.gloss,
        stated.gloss_exponent,
        stated.background,
    )


def _moved(lamp: Lamp, by_mm: FloatArray) -> Lamp:
    x, y, z = (float(p + m) for p, m in zip(lamp.position_mm, by_mm, strict=True))
    return Lamp((x, y, z), lamp.strength)
