"""Every camera driver, held to what the cell relies on."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest

from drivers._genicam import installed_backends
from drivers.camera_genicam import GenicamCamera
from drivers.camera_opencv import OpencvCamera
from drivers.simulators.control import ControlClient
from drivers.simulators.mjpeg import MjpegSimulator, MjpegSimulatorConfig
from mvp.devices import Camera, DeviceContext
from mvp.testing import CameraConformance

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


def _pictures(folder: Path, count: int) -> None:
    rng = np.random.default_rng(1)
    for index in range(count):
        picture = rng.integers(0, 255, (48, 64), dtype=np.uint8)
        cv2.imwrite(str(folder / f"picture_{index:03}.png"), picture)


class _OnTheWall(CameraConformance):
    settings: dict[str, object]

    def now_s(self) -> float:
        return time.monotonic()


class _Genicam(_OnTheWall):
    backend: str

    @pytest.fixture(autouse=True)
    def _camera(self, request: pytest.FixtureRequest) -> None:
        problem = installed_backends()[self.backend]
        if problem:
            pytest.skip(problem)
        self.fake = request.getfixturevalue("gv_camera")
        self.settings = {"address": self.fake.host, "serial": self.fake.serial}

    def lose(self) -> None:
        self.fake.kill()

    def bring_back(self) -> None:
        self.fake.start()

    def device(self) -> Camera:
        config = GenicamCamera.Config.model_validate(
            {
                **self.settings,
                "backend": self.backend,
                "width_px": 320,
                "height_px": 240,
            }
        )
        return GenicamCamera.from_config(config, DeviceContext(), name="camera")


class TestGenicamThroughTelegenicam(_Genicam):
    backend = "telegenicam"


class TestGenicamThroughAravis(_Genicam):
    backend = "aravis"


class _Opencv(_OnTheWall):
    def device(self) -> Camera:
        config = OpencvCamera.Config.model_validate(self.settings)
        return OpencvCamera.from_config(config, DeviceContext(), name="camera")


class TestPictureFolder(_Opencv):
    asleep_s = 0.2

    @pytest.fixture(autouse=True)
    def _folder(self, tmp_path: Path) -> None:
        self.place = tmp_path / "pictures"
        self.place.mkdir()
        _pictures(self.place, 3)
        self.settings = {"source": str(self.place), "loop": True}

    def lose(self) -> None:
        self.place.rename(self.place.with_name("elsewhere"))

    def bring_back(self) -> None:
        self.place.with_name("elsewhere").rename(self.place)


class TestFilm(_Opencv):
    asleep_s = 0.2

    @pytest.fixture(autouse=True)
    def _film(self, tmp_path: Path) -> None:
        self.place = tmp_path / "film.avi"
        path = str(self.place)
        film = cv2.VideoWriter(path, cv2.VideoWriter.fourcc(*"MJPG"), 10, (64, 48))
        for level in (10, 100, 200):
            film.write(np.full((48, 64, 3), level, np.uint8))
        film.release()
        self.settings = {"source": path, "loop": True}

    def lose(self) -> None:
        self.place.rename(self.place.with_name("elsewhere.avi"))

    def bring_back(self) -> None:
        self.place.with_name("elsewhere.avi").rename(self.place)


class TestMotionJpegOverHttp(_Opencv):
    @pytest.fixture(autouse=True)
    def _stream(self) -> Iterator[None]:
        config = MjpegSimulatorConfig(fps=25, latency_s=0.1, columns=64, rows=48)
        simulator = MjpegSimulator.from_config(config, DeviceContext(), name="camera")
        with simulator:
            self.settings = simulator.start()
            with ControlClient(simulator.control_port) as self.faults:
                yield

    def lose(self) -> None:
        self.faults.do("kill")

    def bring_back(self) -> None:
        self.faults.do("restart")
