"""How fast a stop is: by the simulated controller's own clock."""

import threading
import time

import numpy as np
import pytest

from drivers._ur.motion import Motions
from mvp.errors import DeviceError, MotionStopped

HOME = [0.0, -1.57, 1.57, -1.57, -1.57, 0.0]
STOPS = (33, 34)  # stopL, stopJ
SENT_S = 0.05
SPARE_S = 0.3


def stop_once(bench, arm, speed_rad_s: float) -> tuple[float, float]:
    """Seconds from ``stop()`` until it was received, and until the arm stood."""
    arm.move_joints(HOME, timeout_s=60)
    ended: list[Exception] = []

    def go() -> None:
        try:
            arm.move_joints([2.5, *HOME[1:]], timeout_s=60)
        except DeviceError as error:
            ended.append(error)

    mover = threading.Thread(target=go)
    mover.start()
    while abs(bench.do("state")["rates"][0]) < 0.99 * speed_rad_s:
        time.sleep(0.01)
    began = bench.now_s()
    stopper = threading.Thread(target=arm.stop)
    stopper.start()
    while not (truth := bench.do("state"))["standing"]:
        time.sleep(0.002)
    stopper.join()
    mover.join()
    assert len(ended) == 1
    sent = [c["t_s"] for c in truth["commands"] if c["command"] in STOPS]
    received_s = min(t for t in sent if t >= began) - began
    return received_s, truth["time_s"] - began


@pytest.mark.full
@pytest.mark.parametrize("speed_deg_s", [20, 60, 120])
def test_a_stop_is_sent_at_once_and_ends_with_the_ramp(ur_bench, speed_deg_s):
    bench = ur_bench(speed_scale=1.0)
    speed = np.radians(speed_deg_s)
    settings = {"joint_speed_deg_s": speed_deg_s, "stop_deceleration_deg_s2": 170}
    with bench.arm(joint_acceleration_deg_s2=300, **settings) as arm:
        times = np.array([stop_once(bench, arm, speed) for _ in range(5)])
    ramp_s = speed / np.radians(170)
    assert np.median(times[:, 0]) <= SENT_S
    assert np.median(times[:, 1]) <= ramp_s + SPARE_S


def test_a_stop_while_a_motion_is_only_being_prepared_is_not_forgotten(
    ur_bench, monkeypatch
):
    """The state is still being looked at; nothing has been sent yet."""
    bench = ur_bench()
    ready = Motions.ready
    with bench.arm() as arm:
        assert not arm.info().simulated  # a tunnel to a real one ends on loopback, too
        begun_s = bench.now_s()

        def ready_and_stopped(motions):
            status = ready(motions)
            arm.stop()
            return status

        monkeypatch.setattr(Motions, "ready", ready_and_stopped)
        with pytest.raises(MotionStopped, match="before it moved"):
            arm.move_joints([0.5, *HOME[1:]], timeout_s=60)
        assert bench.moves_since(begun_s) == []
        monkeypatch.undo()
        arm.move_joints(HOME, timeout_s=60)
