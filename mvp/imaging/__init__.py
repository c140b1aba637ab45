"""The virtual camera's picture, and what is measured and verified in a picture."""

from mvp.imaging.expectation import (
    ExpectedEdge,
    Requirement,
    ViewExpectation,
    ViewTolerance,
)
from mvp.imaging.foretell import foretold
from mvp.imaging.light import Illumination, Lamp
from mvp.imaging.measure_exposure import meter_exposure
from mvp.imaging.measure_part import PartLines, measure_part
from mvp.imaging.picture_shift import PictureShift, picture_shift
from mvp.imaging.predict import expect_view
from mvp.imaging.predict_contrast import BothSides, both_sides
from mvp.imaging.predict_rims import outward_normals
from mvp.imaging.printed_target import printed_target
from mvp.imaging.render import RenderedImage, RenderQuality, render
from mvp.imaging.render_body import PlanarTexture, RenderBody, textured_plane
from mvp.imaging.render_moving import LensState, render_moving
from mvp.imaging.render_scene import RenderScene
from mvp.imaging.sensor_noise import SensorNoise, expose, exposure_for
from mvp.imaging.verify import verify_view
from mvp.imaging.verify_data import EdgeReport, HoleReport, ViewVerification

__all__ = [
    "BothSides",
    "EdgeReport",
    "ExpectedEdge",
    "HoleReport",
    "Illumination",
    "Lamp",
    "LensState",
    "PartLines",
    "PictureShift",
    "PlanarTexture",
    "RenderBody",
    "RenderQuality",
    "RenderScene",
    "RenderedImage",
    "Requirement",
    "SensorNoise",
    "ViewExpectation",
    "ViewTolerance",
    "ViewVerification",
    "both_sides",
    "expect_view",
    "expose",
    "exposure_for",
    "foretold",
    "measure_part",
    "meter_exposure",
    "outward_normals",
    "picture_shift",
    "printed_target",
    "render",
    "render_moving",
    "textured_plane",
    "verify_view",
]
