"""What the UR driver does when nothing goes wrong."""

import threading
import time

import numpy as np
import pytest

from mvp.errors import LimitError, MotionStopped
from mvp.geometry import Pose
from mvp.kinematics import arm_model

HOME = [0.0, -1.57, 1.57, -1.57, -1.57, 0.0]
FAR = [1.2, -1.3, 1.4, -1.57, -1.4, 0.5]


def test_twenty_poses_are_reached_and_read_back(ur_shared):
    bench, since = ur_shared, ur_shared.now_s()
    rng = np.random.default_rng(20)
    model = arm_model("ur5e")
    with bench.arm() as arm:
        for _ in range(20):
            target = np.array(HOME) + rng.uniform(-0.3, 0.3, 6)
            reached = arm.move_joints(target.tolist(), timeout_s=30)
            truth = bench.do("state")
            assert truth["standing"]
            np.testing.assert_allclose(truth["joints"], target, atol=1e-4)
            np.testing.assert_allclose(reached.joints, truth["joints"], atol=1e-6)
            flange = model.forward(np.array(truth["joints"]))
            np.testing.assert_allclose(reached.base_from_tool, flange.matrix, atol=1e-3)
    assert len(bench.moves_since(since)) == 20


def test_state_shows_the_progress_of_a_motion(ur_shared):
    seen: list[float] = []
    with ur_shared.arm(joint_speed_deg_s=20) as arm:
        arm.move_joints(HOME, timeout_s=30)
        mover = threading.Thread(
            target=lambda: arm.move_joints([0.6, *HOME[1:]], timeout_s=30)
        )
        mover.start()
        while mover.is_alive():
            seen.append(arm.state().joints[0])
            time.sleep(0.01)
        mover.join()
    assert np.all(np.diff(seen) >= 0)
    between = [q for q in seen if 0.05 < q < 0.55]
    assert len(between) > 5


def test_stop_from_another_thread_brakes_on_the_way(ur_shared):
    bench, since = ur_shared, ur_shared.now_s()
    outcome: list[BaseException] = []

    def go(arm) -> None:
        try:
            arm.move_joints(FAR, speed_fraction=0.5, timeout_s=30)
        except MotionStopped as error:
            outcome.append(error)

    with bench.arm(joint_speed_deg_s=40) as arm:
        arm.move_joints(HOME, timeout_s=30)
        mover = threading.Thread(target=go, args=(arm,))
        mover.start()
        while arm.state().joints[0] < 0.3:
            time.sleep(0.005)
        arm.stop()
        mover.join()
        assert len(outcome) == 1
        truth = bench.do("state")
        assert truth["standing"]
        assert truth["joints"][0] < 1.0
        assert arm.state().standing
        back = arm.move_joints(HOME, timeout_s=30)
        np.testing.assert_allclose(back.joints, HOME, atol=1e-3)
    assert len(bench.moves_since(since)) == 3


def test_no_caller_is_faster_than_the_ceilings(ur_shared):
    bench, since = ur_shared, ur_shared.now_s()
    with bench.arm(joint_speed_deg_s=40, joint_acceleration_deg_s2=70) as arm:
        arm.move_joints(HOME, timeout_s=30)
        arm.move_joints([0.2, *HOME[1:]], timeout_s=30)
        arm.move_joints(HOME, speed_fraction=0.5, timeout_s=30)
        with pytest.raises(ValueError, match="speed_fraction"):
            arm.move_joints(HOME, speed_fraction=1.5, timeout_s=30)
    speeds = [np.degrees(c["values"][6:8]) for c in bench.moves_since(since)[1:]]
    np.testing.assert_allclose(speeds, [[40, 70], [20, 70]], atol=1e-6)


@pytest.mark.full
def test_a_heavy_arm_is_held_to_its_own_slowest_joint(ur_bench):
    bench = ur_bench(model="ur10e")
    with bench.arm(model="ur10e", joint_speed_deg_s=180) as arm:
        arm.move_joints([0.2, *HOME[1:]], timeout_s=30)
    assert np.degrees(bench.moves_since(0)[0]["values"][6]) <= 120 + 1e-9


def test_a_target_beyond_a_limit_never_reaches_the_wire(ur_shared):
    bench, since = ur_shared, ur_shared.now_s()
    with bench.arm() as arm, pytest.raises(LimitError, match="elbow"):
        arm.move_joints([0, -1.5, 3.3, 0, 0, 0], timeout_s=30)
    assert not bench.moves_since(since)


def test_tool_and_payload_are_those_of_the_cell_file(ur_shared):
    bench = ur_shared
    with bench.arm(tcp_mm=[1, 2, 150], tcp_rotation_deg=[0, 180, 0]) as arm:
        truth = bench.do("state")
        pose = Pose.from_matrix("base", "tool", arm.state().base_from_tool)
        model = arm_model("ur5e").forward(np.array(truth["joints"]))
        np.testing.assert_allclose(pose.translation_mm, model.translation_mm, atol=1e-3)
    np.testing.assert_allclose(truth["tcp"][:3], [0.001, 0.002, 0.150])
    np.testing.assert_allclose(truth["payload_kg"], 1.5)
    np.testing.assert_allclose(truth["payload_centre_m"], [0, 0.005, 0.04])


def test_a_centre_of_gravity_at_the_flange_replaces_the_one_before(ur_shared):
    with ur_shared.arm(payload_cog_mm=[0, 30, 60]):
        pass
    with ur_shared.arm(payload_cog_mm=[0, 0, 0]):
        centre_m = ur_shared.do("state")["payload_centre_m"]
    np.testing.assert_allclose(centre_m, 0, atol=1e-5)


def test_closing_ends_the_program_and_opening_again_works(ur_shared):
    bench, arm, before = ur_shared, ur_shared.arm(), ur_shared.do("state")
    for _ in range(3):
        with arm:
            assert bench.do("state")["runtime_state"] == "PLAYING"
        assert bench.do("state")["runtime_state"] == "STOPPED"
    after = bench.do("state")
    assert after["scripts"] - before["scripts"] == 3
    assert after["moves_begun"] == before["moves_begun"]


def test_closing_stops_a_motion(ur_shared):
    bench, arm = ur_shared, ur_shared.arm(joint_speed_deg_s=40)
    arm.open()
    arm.move_joints(HOME, timeout_s=30)
    errors: list[Exception] = []

    def go() -> None:
        try:
            arm.move_joints(FAR, speed_fraction=0.2, timeout_s=30)
        except Exception as error:
            errors.append(error)

    mover = threading.Thread(target=go)
    mover.start()
    while arm.state().standing:
        time.sleep(0.005)
    arm.close()
    mover.join()
    assert len(errors) == 1
    while not (truth := bench.do("state"))["standing"]:
        time.sleep(0.002)  # the last cycle of its brake
    assert truth["runtime_state"] == "STOPPED"
    assert truth["joints"] != pytest.approx(FAR, abs=0.05), "it stopped on its way"


def test_two_robots_move_at_the_same_time(ur_bench):
    # The older generation's clock is a quarter as fast: less work for this machine.
    benches = [ur_bench(speed_scale=1.0, profile="3.15") for _ in range(2)]
    arms = [bench.arm() for bench in benches]
    together: list[bool] = []
    with arms[0], arms[1]:
        movers = [
            threading.Thread(
                target=lambda a=arm, q=q: a.move_joints([q, *HOME[1:]], timeout_s=30)
            )
            for arm, q in zip(arms, (0.5, -0.5), strict=True)
        ]
        for mover in movers:
            mover.start()
        while any(mover.is_alive() for mover in movers):
            together.append(not any(arm.state().standing for arm in arms))
            time.sleep(0.01)
        assert [round(arm.state().joints[0], 3) for arm in arms] == [0.5, -0.5]
    assert any(together)
    assert benches[0].simulator.host != benches[1].simulator.host


@pytest.mark.parametrize(
    "profile",
    [
        pytest.param("3.15"),
        pytest.param("e5.21", marks=pytest.mark.full),
        pytest.param("e5.23", marks=pytest.mark.full),
        pytest.param("x10.11", marks=pytest.mark.full),
    ],
)
def test_every_generation_of_controllers_is_driven(ur_bench, profile):
    bench = ur_bench(profile=profile)
    with bench.arm() as arm:
        target = [0.2, *HOME[1:]]
        assert arm.move_joints(target, timeout_s=30).joints[0] == pytest.approx(0.2)
        assert arm.info().firmware.startswith(profile.lstrip("ex"))
