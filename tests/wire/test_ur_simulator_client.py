"""The simulated controller, driven by the real client library in other processes."""

from __future__ import annotations

import contextlib
import json
import math
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.simulators.control import ControlClient
from drivers.simulators.ur import UrSimulator, UrSimulatorConfig

HERE = Path(__file__).parent
IN_TROUBLE = (
    "protective_stop",
    "blocking_move_stopped",
    "emergency_stop",
    "safeguard_stop",
    "refused",
    "refused_late",
    "foreign_program",
    "lost_receive",
    "mute_receive",
    "malformed",
    "lost_control",
    "upper_range",
    "watchdog",
)
HOME = [0.0, -1.57, 1.57, -1.57, -1.57, 0.0]
THERE = [0.2, -1.4, 1.5, -1.57, -1.57, 0.1]
# Published check of the UR5e's kinematics, five digits.
POSE_THERE = [-0.51415, -0.24032, 0.43303, 2.06545, 2.28297, 0.12426]
DEADLINE_S = 60.0

Play = Callable[..., dict[str, Any]]


def _play(simulator: UrSimulator, scenario: str, seconds: float) -> str:
    client = "ur_client_faults.py" if scenario in IN_TROUBLE else "ur_client.py"
    done = subprocess.run(
        [
            sys.executable,
            str(HERE / client),
            scenario,
            simulator.host,
            str(simulator.control_port),
        ],
        capture_output=True,
        text=True,
        timeout=seconds,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def _last(output: str) -> dict[str, Any]:
    return dict(json.loads(output.splitlines()[-1]))


@pytest.fixture(scope="module")
def simulator() -> Iterator[UrSimulator]:
    with UrSimulator(UrSimulatorConfig(speed_scale=2.0), "arm") as one:
        yield one


@pytest.fixture
def play(simulator: UrSimulator) -> Iterator[Play]:
    with ControlClient(simulator.control_port) as faults:
        faults.do("clear")
        faults.do("robot_mode", mode="RUNNING")
        yield lambda scenario: _last(_play(simulator, scenario, DEADLINE_S))
        faults.do("program_stop")


def test_joints_and_time_are_received_at_both_rates(play: Play) -> None:
    said = play("receiving")
    assert said["joints"] == HOME
    assert said["modes"] == [7, 1, 1, 1, 1]
    for rate, period in (("125", 0.008), ("500", 0.002)):
        periods = np.array(said[rate]) / period
        assert len(periods) > 10
        assert (periods > 0.99).all()
        assert np.abs(periods - periods.round()).max() < 1e-3


def test_blocking_moves_reach_joints_and_poses(play: Play) -> None:
    said = play("blocking_moves")
    assert [said[k] for k in ("home", "moved", "line", "ik", "fk")] == [True] * 5
    np.testing.assert_allclose(said["joints"], THERE, atol=1e-3)
    np.testing.assert_allclose(said["pose"], POSE_THERE, atol=1e-3)
    assert said["line_error"] < 1e-3
    assert said["ik_error"] < 1e-3
    np.testing.assert_allclose(said["fk_joints"], HOME, atol=1e-3)


def test_an_asynchronous_move_is_watched_stopped_and_replaced(play: Play) -> None:
    said = play("asynchronous_moves")
    assert said["started"] is True
    assert said["running"] == [True, 0]
    assert said["operations"][1] == (said["operations"][0] + 1) % 128
    assert said["query"] is False
    assert said["finished"] in (-1, -2)
    assert said["arrived"][0] == pytest.approx(1.0, abs=1e-3)
    assert 0.05 < said["between"][0] < 0.99
    assert said["replaced"] == [True, True]
    np.testing.assert_allclose(said["home"], HOME, atol=1e-3)


def test_a_path_tells_which_point_it_is_at(play: Play) -> None:
    said = play("paths")
    assert said["started"] is True
    assert said["seen"] in ([0, 1, 2, -1], [0, 1, 2, -2])
    np.testing.assert_allclose(said["joints"], [0.3, *HOME[1:]], atol=1e-3)
    assert said["again"] is True


def test_tool_payload_and_kinematics_are_answered(play: Play) -> None:
    said = play("questions")
    assert said["tcp"] == [0.0, 0.01, 0.1, 0.0, 0.2, 0.0]
    np.testing.assert_allclose(said["forward"], said["pose"], atol=1e-9)
    np.testing.assert_allclose(said["forward_of"], said["pose"], atol=1e-9)
    np.testing.assert_allclose(said["inverse"], THERE, atol=1e-9)
    np.testing.assert_allclose(said["inverse_here"], THERE, atol=1e-9)
    assert said["payload_read"] == [1.5, 0.0, 0.0, 0.05]
    assert said["solvable"] == [True, False]
    assert said["limits"] == [True, False]
    turned = [1 + math.cos(1.5), 2 + math.sin(1.5), 3, 0, 0, 1.5]
    np.testing.assert_allclose(said["trans"], turned, atol=1e-12)


def test_the_traps_of_the_library_are_there(play: Play) -> None:
    said = play("questions")
    # Without a TCP it takes what the last move left in the registers.
    assert np.abs(np.array(said["wrong_forward"]) - POSE_THERE)[:3].max() > 1.0
    # An unreachable pose gives nothing, and kills the program.
    assert said["impossible"] == []
    assert said["alive"] is False


def test_streamed_targets_and_speeds_are_followed(play: Play) -> None:
    said = play("streaming")
    assert said["servo"] == pytest.approx(0.05, abs=0.01)
    np.testing.assert_allclose(said["joint_rate"], [0.2, 0, 0, 0, 0, 0], atol=1e-9)
    np.testing.assert_allclose(said["tool_rate"], [0, 0, 0.05, 0, 0, 0], atol=1e-4)
    assert said["steady"] is True


def test_outputs_inputs_and_slider_cross_the_wire(play: Play) -> None:
    said = play("inputs_and_outputs")
    assert said["outputs"] == 1 << 3 | 1 << 9 | 1 << 16
    assert said["analog"] == 0.5
    assert said["fraction"] == 0.4


def test_a_protective_stop_needs_unlocking_and_a_new_upload(play: Play) -> None:
    for program, said in play("protective_stop").items():
        assert said["modes"] == [7, 3]
        assert said["bits"] == 0x404
        assert said["state"] == {"pause": 4, "stop": 1}[program]
        assert said["move"] is False
        assert said["steady"] is False
        assert "did not succeed" in said["raised"]
        assert "until 5s after" in said["early"]
        assert said["crept"] < 1e-9
        assert said["after"] is False
        assert said["uploaded"] is True
        assert said["again"] is True


def test_an_emergency_stop_takes_the_power(play: Play) -> None:
    said = play("emergency_stop")
    assert said["safety"] == 7
    assert said["bits"] == 0x4C0
    assert said["state"] == 1
    assert said["move"] is False
    assert not any(said["rates"])
    assert said["power"] == ["Robotmode: POWER_OFF", "Robotmode: IDLE"]
    assert said["again"] is True


def test_a_stop_ends_a_call_that_waits(play: Play) -> None:
    said = play("blocking_move_stopped")
    assert said["protective_stop"] == [False, 0x404, False]
    assert said["emergency_stop"] == [False, 0x4C0, True]


def test_a_safeguard_stop_waits_and_goes_on(play: Play) -> None:
    said = play("safeguard_stop")
    assert said["bits"] == 0x410
    assert 0 < said["between"] < 0.5
    assert said["state"] == 2


def test_the_watchdog_kills_a_program_that_nobody_writes_to(play: Play) -> None:
    said = play("watchdog")
    assert said["move"] is False
    assert "watchdog" in said["endings"][-1]


def test_a_program_of_the_client_runs_and_the_control_script_returns(
    play: Play,
) -> None:
    said = play("custom_script")
    assert said["ran"] is True
    np.testing.assert_allclose(said["joints"], [0.1, *HOME[1:]], atol=1e-3)
    assert said["after"] is True


def test_the_dashboard_answers_every_command(play: Play) -> None:
    said = play("dashboard")
    assert said == {
        "mode": "Robotmode: RUNNING",
        "safety": "Safetymode: NORMAL",
        "status": "Safetystatus: NORMAL",
        "running": False,
        "none": "No program loaded",
        "bad": "File not found: x.txt",
        "unplayable": "Failed to execute: play",
        "loaded": "Loaded program: /programs/job.urp",
        "playing": "PLAYING job.urp",
        "paused": "PAUSED job.urp",
        "stopped": "STOPPED job.urp",
        "version": "5.12.0.1101319",
        "serial": "20225500123",
        "model": "UR5",
        "remote": True,
        "off": "Robotmode: POWER_OFF",
        "restarted": "Robotmode: POWER_OFF",
    }


REASONS = {
    "remote off": "enable remote control",
    "in use": "already in use",
    "rtde refused": "Could not connect",
    "script port refused": "Connection refused",
    "dashboard refused": "Timeout connecting to UR dashboard",
}
SLOW_REASONS = {
    "script rejected": "Failed to start control script",
    "power off": "Failed to start control script",
    "dashboard mute": "Operation canceled",
}


def test_the_constructor_gives_up_with_its_reason(play: Play) -> None:
    said = play("refused")
    for name, text in REASONS.items():
        assert text in said[name]
    assert said["afterwards"] is True
    assert "already in use" in said["second"]
    assert said["first_lives"] is True


@pytest.mark.full
def test_the_constructor_gives_up_after_seconds(play: Play) -> None:
    said = play("refused_late")
    for name, text in SLOW_REASONS.items():
        assert text in said[name]
    assert said["afterwards"] is True


@pytest.mark.full
def test_a_foreign_program_is_stopped_and_may_come_back(play: Play) -> None:
    said = play("foreign_program")
    assert said["moved"] is True
    assert said["state"] == 2
    assert said["program"] == "pendant.urp"


def test_a_receiver_sees_losses_silence_and_a_frozen_clock(play: Play) -> None:
    said = play("lost_receive")
    assert said["fin back"] is True
    assert said["rst back"] is True
    assert said["silent"] == 1
    assert said["frozen"] == 1
    assert said["thawed"] is True
    assert said["late_s"] >= 0.28
    assert "Could not connect" in said["down"]
    assert said["up"] is True
    assert said["power"] == 3


def test_a_mute_handshake_hangs_the_library(play: Play, simulator: UrSimulator) -> None:
    with pytest.raises(subprocess.TimeoutExpired):
        _play(simulator, "mute_receive", 4.0)


@pytest.mark.full
def test_a_lost_link_makes_the_library_upload_again_and_again(
    play: Play, simulator: UrSimulator
) -> None:
    with ControlClient(simulator.control_port) as faults:
        before = int(str(faults.do("state")["scripts"]))
        # It may die of a segmentation fault, or hang.
        with contextlib.suppress(AssertionError, subprocess.TimeoutExpired):
            _play(simulator, "lost_control", 10.0)
        assert int(str(faults.do("state")["scripts"])) > before + 1


def test_a_package_without_length_aborts_the_library(
    play: Play, simulator: UrSimulator
) -> None:
    with pytest.raises(AssertionError):
        _play(simulator, "malformed", DEADLINE_S)
    # The controller itself does not mind.
    assert play("dashboard")["mode"] == "Robotmode: RUNNING"


@pytest.mark.full
def test_upper_registers_fail_where_script_and_client_disagree() -> None:
    config = UrSimulatorConfig(profile="e5.23")
    with UrSimulator(config, "arm") as simulator:
        said = _last(_play(simulator, "upper_range", DEADLINE_S))
    assert said["moved"] is False


@pytest.mark.parametrize(
    "profile",
    [
        "3.15",
        pytest.param("e5.21", marks=pytest.mark.full),
        "e5.23",
        "x10.11",
    ],
)
def test_every_generation_moves_and_answers(profile: str) -> None:
    config = UrSimulatorConfig(profile=profile, speed_scale=2.0)
    with UrSimulator(config, "arm") as simulator:
        said = _last(_play(simulator, "version_smoke", DEADLINE_S))
    assert said["moved"] is True
    np.testing.assert_allclose(said["joints"], THERE, atol=1e-3)
    assert said["tcp"] == [0.0] * 6
