"""The report of a part that was found."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from calibration.report import PartPicture, about_session, part_report, render_report
from calibration.wizard.part_result import Found

if TYPE_CHECKING:
    from calibration.report import Photo
    from calibration.wizard.part_pictured import Pictured
    from calibration.wizard.session_store import SessionStore
    from mvp.wizard import Outcome


def page_of(store: SessionStore, outcome: Outcome) -> str:
    """One page; its pictures show the places that were measured."""
    found = outcome.details["found"]
    if not isinstance(found, Found):
        raise TypeError("not the outcome of a part session")
    sensor = store.facts.sensor
    pictures = [
        PartPicture(
            one.sample.name,
            one.camera,
            (sensor.width_px, sensor.height_px),
            one.sight,
            one.resection,
            one.view,
        )
        for one in found.pictured
    ]
    places = np.concatenate([one.sight.places_part_mm for one in found.pictured])
    middle = places.mean(axis=0)
    distances = [
        np.linalg.norm(one.view.camera_from_part.apply(middle))
        for one in found.pictured
    ]
    about = about_session(
        store,
        outcome.document,
        distance_mm=float(np.mean(distances)),
        point_part_mm=middle.tolist(),
    )
    by_name = {one.sample.name: one for one in found.pictured}
    photos = tuple(_marked(photo, by_name.get(photo.name)) for photo in about.photos)
    data = part_report(
        found.located,
        pictures,
        found.hand_eye,
        replace(about, photos=photos),
        verdict=found.verdict,
    )
    return render_report(replace(data, notes=(*data.notes, *outcome.lines)))


def _marked(photo: Photo, pictured: Pictured | None) -> Photo:
    if pictured is None:
        return photo
    sight = pictured.sight
    pixels = np.concatenate([sight.circles.pixels, sight.edges.pixels])
    return replace(photo, points_px=pixels)
