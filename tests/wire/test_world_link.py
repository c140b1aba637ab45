"""A world that simulators in other processes report to and take pictures of."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING

import numpy as np
import pytest

from drivers.simulators.world_link import WorldClient, WorldServer

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence


class Notebook:
    """A world that writes down what it is told."""

    def __init__(self) -> None:
        self.arm: list[tuple[float, list[float]]] = []
        self.lens: list[tuple[float, dict[str, float]]] = []
        self.told = threading.Event()

    def report_arm(self, t_s: float, joints: Sequence[float]) -> None:
        self.arm.append((t_s, list(joints)))
        self.told.set()

    def report_lens(self, t_s: float, steps: Mapping[str, float]) -> None:
        self.lens.append((t_s, dict(steps)))
        self.told.set()

    def frame(
        self, start_s: float, exposure_s: float, *, gain: float = 1.0, index: int = 0
    ) -> np.ndarray:
        grey = np.arange(12, dtype=np.uint16).reshape(3, 4)
        return grey + np.uint16(1000 * gain + index)

    def frame_size(self) -> tuple[int, int]:
        return 4, 3


@pytest.fixture
def world() -> Notebook:
    return Notebook()


@pytest.fixture
def client(world: Notebook) -> Iterator[WorldClient]:
    server = WorldServer(world)
    server.start()
    client = WorldClient(server.address)
    yield client
    client.close()
    server.stop()


def test_reports_arrive_with_their_times(client: WorldClient, world: Notebook) -> None:
    now = time.monotonic()
    client.report_arm(now, [0.1, -0.2])
    assert world.told.wait(5)
    assert world.arm == [(now, [0.1, -0.2])]
    world.told.clear()
    client.report_lens(now, {"zoom": 1, "focus": 2.5})
    assert world.told.wait(5)
    assert world.lens == [(now, {"zoom": 1.0, "focus": 2.5})]


def test_pictures_come_back_bit_by_bit(client: WorldClient, world: Notebook) -> None:
    assert client.frame_size() == (4, 3)
    picture = client.frame(1.0, 0.01, gain=2.0, index=7)
    np.testing.assert_array_equal(picture, world.frame(1.0, 0.01, gain=2.0, index=7))
    assert picture.dtype == np.uint16


def test_it_listens_on_loopback_only(world: Notebook) -> None:
    server = WorldServer(world)
    server.start()
    assert server.address.startswith("127.0.0.1:")
    server.stop()
    with pytest.raises(OSError, match="refused"):
        WorldClient(server.address)
