"""One virtual frame against one plain Embree pass of the same picture.

    python tools/bench_render.py

The rival turns ready directions into the world, casts one float32 ray per pixel with
raw embreex and looks up a grey per triangle. Ours draws blur, diffraction, distortion and noise.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mvp.geometry import Pose
from mvp.imaging import RenderBody, RenderScene, expose, exposure_for, render
from mvp.optics import Intrinsics, Sensor
from mvp.scene import paper_object

if TYPE_CHECKING:
    from collections.abc import Callable

F_MM, A_MM = 12.5, 12.5 / 16
VIEWS = {
    "V_f": ((107.58, -231.43, 258.68), (-0.389, 0.694, -0.608), 13.07),
    "V_f1": ((197.10, 100.58, 330.45), (-0.513, -0.255, -0.820), 12.84),
    "V_f2": ((112.78, 110.49, 159.77), (-0.444, -0.583, -0.680), 13.25),
}


@dataclass(frozen=True)
class Row:
    """One line of the table; times are medians in seconds."""

    view: str
    setting: str
    plain_s: float
    frame_s: float

    @property
    def ratio(self) -> float:
        return self.frame_s / self.plain_s


def looking(position: tuple[float, ...], direction: tuple[float, ...]) -> Pose:
    z = np.array(direction) / np.linalg.norm(direction)
    x = np.cross([0.0, 0.0, -1.0], z)
    x /= np.linalg.norm(x)
    rotation = np.column_stack([x, np.cross(z, x), z])
    return Pose("world", "camera", rotation, np.array(position))


def run(*, quick: bool = False) -> list[Row]:
    """Rows for the three views of the paper; a known and a fresh lens setting."""
    sensor = Sensor(1280, 1024, 0.005, 0.005)
    if quick:
        sensor = Sensor(320, 256, 0.02, 0.02)
    intrinsics = Intrinsics(sensor, sensor.width_px / 2, sensor.height_px / 2, k1=-0.1)
    scene = RenderScene([RenderBody(paper_object())])
    repeats = 3 if quick else 9
    names = ["V_f2"] if quick else list(VIEWS)
    return [row for name in names for row in _rows(name, scene, intrinsics, repeats)]


def _rows(
    name: str, scene: RenderScene, intrinsics: Intrinsics, repeats: int
) -> list[Row]:
    position, direction, d_mm = VIEWS[name]
    pose = looking(position, direction)
    rng = np.random.default_rng(0)

    def frame(d: float) -> np.ndarray:
        image = render(scene, pose, d_mm=d, f_mm=F_MM, a_mm=A_MM, intrinsics=intrinsics)
        return expose(image, exposure, rng=rng)

    first = render(scene, pose, d_mm=d_mm, f_mm=F_MM, a_mm=A_MM, intrinsics=intrinsics)
    exposure = exposure_for(first)
    directions = first.view.rays.directions.reshape(-1, 3)
    greys = np.abs(first.view.planes.normals[:, 2])
    fresh = iter(d_mm + 1e-4 * np.arange(1, repeats + 1))
    # Interleaved, so that both meet the same load of the machine.
    plain, known, new = [], [], []
    for _ in range(repeats):
        plain.append(_timed(lambda: greys[scene.hit(pose, directions)]))
        known.append(_timed(lambda: frame(d_mm)))
        new.append(_timed(lambda: frame(next(fresh))))
    base = float(np.median(plain))
    return [
        Row(name, "same lens setting", base, float(np.median(known))),
        Row(name, "new lens setting", base, float(np.median(new))),
    ]


def _timed(call: Callable[[], object]) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def table(rows: list[Row]) -> str:
    lines = [f"{'view':6}{'setting':20}{'plain s':>9}{'frame s':>9}{'ratio':>7}"]
    lines += [
        f"{r.view:6}{r.setting:20}{r.plain_s:9.3f}{r.frame_s:9.3f}{r.ratio:7.2f}"
        for r in rows
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    print(table(run()))
