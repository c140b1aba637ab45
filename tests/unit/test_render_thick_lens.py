"""The picture against rays traced through two thin elements with a stop between.

The oracle knows nothing of focal lengths, pupils or circles of confusion: it refracts
paraxial rays at two elements and asks what each sensor point sees through the stop.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from mvp.geometry import Pose, TriangleMesh
from mvp.imaging import Illumination, RenderBody, RenderQuality, render
from mvp.optics import Intrinsics, Sensor

PITCH_MM = 0.005
WIDTH, HEIGHT = 80, 12


@dataclass(frozen=True)
class TwoElements:
    """Front element at 0, stop and rear element behind it, mm; light travels to +."""

    front_power: float = 1 / 40.0
    rear_power: float = 1 / 16.0
    stop_mm: float = 4.5
    rear_mm: float = 9.0
    stop_radius_mm: float = 1.1

    def matrix(self) -> np.ndarray:
        """Ray matrix (y, slope) from the front element to the rear one."""
        front = np.array([[1, 0], [-self.front_power, 1]])
        rear = np.array([[1, 0], [-self.rear_power, 1]])
        return rear @ np.array([[1, self.rear_mm], [0, 1]]) @ front

    def cardinal(self) -> tuple[float, float, float]:
        """Focal length, place of the front and of the back principal plane."""
        a, _, c, d = self.matrix().ravel()
        f_mm = -1 / c
        return f_mm, (d - 1) / c, self.rear_mm + (1 - a) / c

    def entrance_pupil(self) -> tuple[float, float]:
        """Place and diameter of the stop as the object sees it."""
        # A point of the stop, traced backwards through the front element.
        t, p = self.stop_mm, self.front_power
        image = t / (1 - t * p)
        return image, 2 * self.stop_radius_mm / (1 - t * p)

    def seen(
        self, sensor_mm: np.ndarray, stop: np.ndarray, sensor_at: float, plane_at: float
    ) -> np.ndarray:
        """Where rays from sensor points (..., 2) by stop points meet a plane in front."""
        # Backwards: sensor to rear element to stop must hit the chosen stop point.
        back = sensor_at - self.rear_mm
        gap = self.rear_mm - self.stop_mm
        # y_rear = s + back * u; u' = u - p y_rear (backwards); stop = y_rear + gap * u'.
        p = self.rear_power
        slope = (stop - sensor_mm * (1 - gap * p)) / (back * (1 - gap * p) + gap)
        y_rear = sensor_mm + back * slope
        slope = slope - p * y_rear
        y_front = y_rear + self.rear_mm * slope
        slope = slope - self.front_power * y_front
        return y_front + slope * -plane_at


def traced(
    lens: TwoElements, sensor_at: float, plane_at: float, edge_mm: float, angle: float
) -> np.ndarray:
    """(HEIGHT, WIDTH) share of light from the side n . p < edge of a plane."""
    rng = np.random.default_rng(3)
    count = 1500
    grid = np.stack(
        np.meshgrid(
            np.arange(WIDTH) - (WIDTH - 1) / 2, np.arange(HEIGHT) - (HEIGHT - 1) / 2
        ),
        axis=-1,
    )
    radius = lens.stop_radius_mm * np.sqrt(rng.random(count))
    turn = rng.uniform(0, 2 * np.pi, count)
    stop = np.stack([radius * np.cos(turn), radius * np.sin(turn)], axis=-1)
    within = rng.uniform(-0.5, 0.5, (count, 2))
    # In opposite pairs, so that chance does not move the edge.
    stop, within = np.concatenate([stop, -stop]), np.concatenate([within, -within])
    # The picture is upside down on the sensor: turn it.
    sensor = -(grid[:, :, None] + within) * PITCH_MM
    there = lens.seen(sensor, stop, sensor_at, plane_at)
    side = there[..., 0] * np.cos(angle) + there[..., 1] * np.sin(angle) < edge_mm
    return side.mean(axis=-1)


def drawn(
    lens: TwoElements, sensor_at: float, plane_at: float, edge_mm: float, angle: float
) -> np.ndarray:
    f_mm, front, back = lens.cardinal()
    pupil, a_mm = lens.entrance_pupil()
    normal = np.array([np.cos(angle), np.sin(angle)])
    along = np.array([-normal[1], normal[0]])
    corners = [
        edge_mm * normal + s * 200 * along + t * normal
        for s, t in ((-1, 0), (1, 0), (1, -200), (-1, -200))
    ]
    z_mm = pupil - plane_at
    vertices = np.column_stack([np.array(corners), np.full(4, z_mm)])
    mesh = TriangleMesh(vertices, np.array([[0, 1, 2], [0, 2, 3]]), np.zeros(2, int))
    sensor = Sensor(WIDTH, HEIGHT, PITCH_MM, PITCH_MM)
    image = render(
        [RenderBody(mesh, 1.0)],
        Pose.identity("world", "camera"),
        d_mm=sensor_at - back,
        f_mm=f_mm,
        a_mm=a_mm,
        e_mm=front - pupil,
        intrinsics=Intrinsics(sensor, (WIDTH - 1) / 2, (HEIGHT - 1) / 2),
        light=Illumination(ambient=1.0, lamps=(), gloss=0.0, background=0.0),
        quality=RenderQuality(diffraction=False),
    )
    return image.grey.astype(np.float64)


def test_the_traced_lens_has_a_pupil_in_front_of_its_nodal_point() -> None:
    lens = TwoElements()
    f_mm, front, back = lens.cardinal()
    pupil, a_mm = lens.entrance_pupil()
    assert front - pupil > 1.0
    # Newton: an object x before the front focus is imaged f^2 / x behind the back one.
    object_at = front - f_mm - 200.0
    image_at = back + f_mm + f_mm**2 / 200.0
    stops = np.array([[0.5, 0.0], [-0.9, 0.3], [0.0, 0.0]])
    there = lens.seen(np.full((3, 2), 0.4), stops, image_at, object_at)
    assert np.ptp(there, axis=0).max() < 1e-9
    assert there[0, 0] == pytest.approx(-0.4 * 200.0 / f_mm, rel=1e-9)
    assert a_mm > 0


@pytest.mark.parametrize("plane_at", [-140.0, -260.0, -700.0])
@pytest.mark.parametrize("angle", [0.0, 0.6])
def test_blur_and_perspective_agree_with_traced_rays(
    plane_at: float, angle: float
) -> None:
    lens = TwoElements()
    f_mm, front, back = lens.cardinal()
    distance = front + 240.0
    sensor_at = back + f_mm * distance / (distance - f_mm)
    # About 14 px off the axis, so that perspective counts as well as blur.
    edge_mm = 14 * PITCH_MM * (-plane_at) / 14.0
    truth = traced(lens, sensor_at, plane_at, edge_mm, angle)
    picture = drawn(lens, sensor_at, plane_at, edge_mm, angle)
    assert np.abs(truth - picture).mean() < 0.002
    assert np.abs(truth - picture).max() < 0.05
    # Light that passes gives the place: three thousand rays per pixel.
    shift = (truth - picture).sum(axis=1).mean() * max(np.cos(angle), 0.5)
    assert abs(shift) < 0.02
