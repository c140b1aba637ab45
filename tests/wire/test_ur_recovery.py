"""The way back from a stop, walked on a simulated controller."""

import threading
import time

import pytest

from mvp.cell.recover_job import Guide, recover_device
from mvp.errors import DeviceFault

HOME = [0.0, -1.57, 1.57, -1.57, -1.57, 0.0]
FAR = [1.2, -1.3, 1.4, -1.57, -1.4, 0.5]


def walk(arm) -> list[str]:
    """Agree to every step; the texts of the steps."""
    told: list[str] = []
    guide = Guide(
        agree=lambda _, step: True, tell=lambda _, reached: told.append(reached)
    )
    found = recover_device(arm, guide)
    assert [step.reached for step in found.steps] == told
    return [step.text for step in found.steps]


def stopped_on_its_way(bench, verb: str, **arguments: object) -> DeviceFault:
    """Start a motion, cause a stop, and return what the driver made of it."""
    outcome: list[Exception] = []

    def go() -> None:
        try:
            arm.move_joints(FAR, timeout_s=60)
        except DeviceFault as error:
            outcome.append(error)

    with bench.arm(joint_speed_deg_s=15) as arm:
        mover = threading.Thread(target=go)
        mover.start()
        while arm.state().standing:
            time.sleep(0.005)
        bench.do(verb, **arguments)
        mover.join(30)
    return outcome[0]


def test_an_interrupted_motion_does_not_go_on_after_the_way_back(ur_bench):
    bench = ur_bench()
    error = stopped_on_its_way(bench, "protective_stop", program="pause")
    assert "recover" in error.hint
    while not (truth := bench.do("state"))["standing"]:
        time.sleep(0.01)
    stands = truth["joints"]
    since = bench.now_s()
    arm = bench.arm()
    steps = walk(arm)
    assert "Protective stop" in steps[0]
    assert "Connect" in steps[-1]
    time.sleep(0.3)
    assert bench.do("state")["joints"] == pytest.approx(stands, abs=1e-9)
    assert 0 < stands[0] < FAR[0], "it stands on its way"
    assert not bench.moves_since(since)
    assert arm.move_joints(HOME, timeout_s=30).standing
    arm.close()


def test_an_emergency_stop_leads_through_power_and_brakes(ur_bench):
    bench = ur_bench()
    stopped_on_its_way(bench, "emergency_stop")
    arm = bench.arm()
    steps = arm.recovery()
    first = next(steps)
    assert first.acknowledge
    assert "Emergency stop" in first.text
    bench.do("release")
    first.act()
    rest = []
    for step in steps:
        rest.append(step.text.split()[0])
        step.act()
    assert rest == ["Power", "Release", "Connect,"]
    assert arm.state().standing
    arm.close()


def test_a_button_that_is_still_pressed_ends_the_walk(ur_bench):
    bench = ur_bench()
    bench.do("emergency_stop")
    step = next(bench.arm().recovery())
    with pytest.raises(DeviceFault) as error:
        step.act()
    assert error.value.code == "still-there"


def test_a_program_of_somebody_else_is_only_ended_when_a_person_agrees(ur_bench):
    bench = ur_bench()
    bench.do("foreign_program", name="welding.urp")
    steps = bench.arm().recovery()
    step = next(steps)
    assert step.acknowledge
    assert "PLAYING" in step.text
    steps.close()
    assert bench.do("state")["program"] == "welding.urp"


@pytest.mark.full
def test_a_controller_without_dashboard_is_brought_back_at_its_pendant(ur_bench):
    bench = ur_bench(profile="x10.11")
    arm = bench.arm()
    steps = walk(arm)
    assert "pendant" in steps[0]
    assert arm.state().standing
    arm.close()
