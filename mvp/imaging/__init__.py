"""The virtual camera's picture, and what is measured and verified in a picture."""

from mvp.imaging.light import Illumination, Lamp
from mvp.imaging.render import RenderedImage, RenderQuality, render
from mvp.imaging.render_body import PlanarTexture, RenderBody, textured_plane
from mvp.imaging.render_scene import RenderScene
from mvp.imaging.sensor_noise import SensorNoise, expose, exposure_for

__all__ = [
    "Illumination",
    "Lamp",
    "PlanarTexture",
    "RenderBody",
    "RenderQuality",
    "RenderScene",
    "RenderedImage",
    "SensorNoise",
    "expose",
    "exposure_for",
    "render",
    "textured_plane",
]
