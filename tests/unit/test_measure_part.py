"""The lines of a part measured in rendered pictures, against where they truly lie."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from mvp.imaging import ViewTolerance, expose, measure_part
from mvp.optics import Sensor
from mvp.scene import paper_object
from tools.picture_trials import (
    Setting,
    Stage,
    look_along,
    metered_s,
    paper_setting,
)

if TYPE_CHECKING:
    from mvp.geometry import FloatArray
    from mvp.imaging import ViewExpectation

# Of a part that was put down by hand.
LOOSE = ViewTolerance(position_mm=5.0, angle_deg=2.0, d_mm=0.05)


@dataclass(frozen=True)
class Look:
    """Where from, where to (part frame), through which pupil, how long exposed."""

    view: str
    from_mm: tuple[float, float, float]
    to_mm: tuple[float, float, float]
    pupil_mm: float
    exposed: float

    @property
    def setting(self) -> Setting:
        """With the lens of a published view."""
        place = np.array(self.from_mm)
        pose = look_along(place, np.array(self.to_mm) - place)
        return replace(paper_setting(self.view), pose=pose, a_mm=self.pupil_mm)


FAINT = Look("V_f", (82, -237, 255), (6, 3, 4), 0.78, 0.5)
HALF_SATURATED = Look("V_f1", (166, 71, 286), (-12, -37, -14), 1.6, 1.8)


@pytest.fixture(scope="module")
def stage() -> Stage:
    sensor = Sensor(640, 512, 0.0096, 0.0096)
    return Stage(paper_object(), sensor, tolerance=LOOSE)


def pulls(image: FloatArray, expectation: ViewExpectation) -> dict[str, FloatArray]:
    """How far the places on each line lie off it, by what is stated, (2,)."""
    found = measure_part(image, 255.0, expectation)
    assert not found.reason
    true = {edge.name: edge for edge in expectation.edges}
    places = expectation.plane.ideal(found.places_px)
    out = {}
    for number, name in enumerate(found.names):
        if found.agrees[number]:
            along = true[name].end_px - true[name].start_px
            across = np.array([-along[1], along[0]]) / np.linalg.norm(along)
            own = found.edge == number
            off = (places[own] - true[name].start_px) @ across
            out[name] = off / found.sigma_px[own]
    return out


@pytest.mark.parametrize("look", [FAINT, HALF_SATURATED], ids=["faint", "saturated"])
def test_lines_lie_where_they_are_stated_to_lie(stage: Stage, look: Look) -> None:
    """Neither faint steps on shaded faces nor saturated pixels move a line unsaid."""
    expectation = stage.expectation(look.setting, auxiliary=24)
    picture = stage.picture(look.setting)
    exposure_s = look.exposed * metered_s(picture, expectation)
    image = expose(picture, exposure_s, rng=np.random.default_rng(5))
    found = pulls(np.asarray(image), expectation)
    assert len(found) >= 4
    assert not {name: off for name, off in found.items() if np.abs(off).max() > 3}
