"""Framing, scripts, registers and kinematics of the simulated controller."""

from __future__ import annotations

import contextlib
import subprocess
import sys

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.simulators.ur.kinematics import Kinematics, NoSolutionError
from drivers.simulators.ur.motion import ScriptError
from drivers.simulators.ur.poses import matrix_of, pose_of, rotation_of, rotation_vector
from drivers.simulators.ur.profiles import PROFILES
from drivers.simulators.ur.registers import Ownership, Registers
from drivers.simulators.ur.robot import Robot, RobotSettings
from drivers.simulators.ur.script import ScriptReader, path_entry
from drivers.simulators.ur.telemetry import Telemetry
from drivers.simulators.ur.variables import NOT_FOUND, OUTPUTS, type_of
from drivers.simulators.ur.wire import Framer, Recipe, names_of, package

ANGLES = st.floats(-3.0, 3.0)


@given(st.lists(st.tuples(st.integers(0, 255), st.binary(max_size=40)), max_size=5))
def test_packages_come_out_as_they_went_in_however_they_are_cut(
    packages: list[tuple[int, bytes]],
) -> None:
    stream = b"".join(package(kind, payload) for kind, payload in packages)
    framer = Framer()
    out = [p for k in range(len(stream)) for p in framer.feed(stream[k : k + 1])]
    assert out == packages


@given(st.lists(st.binary(max_size=50), max_size=10))
def test_garbage_is_refused_or_waited_for(chunks: list[bytes]) -> None:
    framer = Framer()
    with contextlib.suppress(ValueError):
        for chunk in chunks:
            for kind, payload in framer.feed(chunk):
                assert 0 <= kind <= 255
                assert len(payload) < 65536


def test_a_recipe_packs_big_endian_and_takes_its_own_length_only() -> None:
    recipe = Recipe(3, ["a", "b"], ["INT32", "VECTOR3D"])
    packed = recipe.pack([-2, (1.0, 2.0, 3.0)], protocol=2)
    assert packed[:8] == b"\x00\x20U\x03\xff\xff\xff\xfe"
    assert recipe.unpack(packed[4:]) == {"a": -2, "b": [1.0, 2.0, 3.0]}
    assert recipe.unpack(packed[4:-1]) is None


def test_a_trailing_comma_names_nothing_and_long_lists_are_refused() -> None:
    assert names_of(b"timestamp,actual_q,") == ["timestamp", "actual_q"]
    with pytest.raises(ValueError, match="2048"):
        names_of(b"x" * 2049)


@given(st.lists(st.integers(1, 400), max_size=8))
def test_a_program_is_found_however_it_is_cut(cuts: list[int]) -> None:
    text = (
        b"def a():\n  if x:\n  end\nend\nstopj(2.0)\ndef rtde_control():\n end\nend\n"
    )
    reader, programs, rest = ScriptReader(), [], text
    for cut in cuts:
        programs += reader.feed(rest[:cut])
        rest = rest[cut:]
    programs += reader.feed(rest)
    assert [p.name for p in programs] == ["a", "", "rtde_control"]
    assert [len(p.lines) for p in programs] == [4, 1, 3]
    assert programs[2].is_control


@pytest.mark.parametrize("line", ["jump()", "movej([1,2],a=1,v=1)", "movec(p[1],p[2])"])
def test_a_path_takes_moves_only(line: str) -> None:
    with pytest.raises(ScriptError):
        path_entry(line)


def test_a_path_line_is_read_with_its_speeds() -> None:
    entry = path_entry("movel(p[1,2,3,4,5,6],a=1.5,v=0.25,r=0.02)", 7)
    assert entry.kind == "movel"
    assert entry.target == (1, 2, 3, 4, 5, 6)
    assert (entry.acceleration, entry.speed, entry.blend_m) == (1.5, 0.25, 0.02)
    assert entry.progress == 7


@given(st.tuples(ANGLES, ANGLES, ANGLES))
def test_rotation_vectors_agree_with_opencv(vector: tuple[float, ...]) -> None:
    turn = np.array(vector)
    expected, _ = cv2.Rodrigues(turn)
    np.testing.assert_allclose(rotation_of(turn), expected, atol=1e-12)
    again = rotation_vector(expected)
    np.testing.assert_allclose(rotation_of(again), expected, atol=1e-9)
    assert np.linalg.norm(again) <= np.pi + 1e-12


def test_half_a_turn_is_not_lost() -> None:
    for axis in np.eye(3):
        turned = pose_of(matrix_of([0, 0, 0, *(np.pi * axis)]))
        assert np.linalg.norm(turned[3:]) == pytest.approx(np.pi)


@pytest.mark.parametrize(
    "model", ["ur3e", "ur5e", "ur7e", "ur10e", "ur12e", "ur16e", "ur20", "ur30"]
)
def test_inverse_undoes_forward_with_a_tool(model: str) -> None:
    kin, rng = Kinematics(model), np.random.default_rng(1)
    tcp = (0.01, -0.02, 0.15, 0.1, 0.2, -0.3)
    for joints in rng.uniform(-1.5, 1.5, (20, 6)):
        pose = kin.tool_pose(joints, tcp)
        np.testing.assert_allclose(kin.joints(pose, tcp, joints), joints, atol=1e-7)
    with pytest.raises(NoSolutionError):
        kin.joints(np.array([9.0, 0, 0, 0, 0, 0]), tcp, np.zeros(6))


def test_published_poses_of_the_ur5e() -> None:
    kin = Kinematics("ur5e")
    pose = kin.tool_pose(np.array([0.0, -1.57, 1.57, -1.57, -1.57, 0.0]), (0.0,) * 6)
    expected = [-0.492159, -0.133379, 0.487821, 2.220645, 2.220645, 0.0]
    np.testing.assert_allclose(pose, expected, atol=1e-6)


def test_the_jacobian_is_the_slope_of_the_tool_pose() -> None:
    kin, tcp = Kinematics("ur5e"), (0.05, 0.0, 0.1, 0.0, 0.3, 0.0)
    joints = np.array([0.3, -1.2, 1.4, -1.0, -1.3, 0.4])
    step = 1e-6
    slopes = [
        (kin.tool_pose(joints + d, tcp) - kin.tool_pose(joints - d, tcp))[:3] / 2 / step
        for d in step * np.eye(6)
    ]
    np.testing.assert_allclose(
        kin.jacobian(joints, tcp)[:3], np.transpose(slopes), atol=1e-6
    )


def test_registers_take_words_bits_and_masks() -> None:
    registers = Registers()
    registers.apply(
        {
            "input_int_register_47": -5,
            "input_double_register_24": 1.5,
            "input_bit_registers0_to_31": 0b101,
            "input_bit_registers32_to_63": 1,
            "input_bit_register_64": True,
            "standard_digital_output_mask": 0b11,
            "standard_digital_output": 0b10,
            "standard_analog_output_mask": 2,
            "standard_analog_output_1": 0.25,
            "speed_slider_mask": 1,
            "speed_slider_fraction": 7.0,
        }
    )
    assert registers.in_int[47] == -5
    assert registers.in_double[24] == 1.5
    assert registers.in_bits == 0b101 | 1 << 32 | 1 << 64
    assert registers.digital_outputs == 0b10
    assert registers.analog_outputs == [0.0, 0.25]
    assert registers.slider == 1.0


def test_an_input_has_one_owner_until_it_hangs_up() -> None:
    owners, first, second = Ownership(), object(), object()
    owners.take(["a"], first)
    assert not owners.taken("a", first)
    assert owners.taken("a", second)
    owners.release(first)
    assert not owners.taken("a", second)
    owners.reserved = {"a"}
    assert owners.taken("a", first)


@pytest.mark.parametrize("profile", list(PROFILES))
def test_every_variable_that_is_announced_can_be_sent(profile: str) -> None:
    robot = Robot(RobotSettings(profile=profile))
    telemetry = Telemetry(robot)
    names = [n for n in OUTPUTS if type_of(OUTPUTS, n, robot.profile) != NOT_FOUND]
    types = [type_of(OUTPUTS, n, robot.profile) for n in names]
    recipe = Recipe(1, names, types)
    packed = recipe.pack([telemetry.reader(n)() for n in names], protocol=2)
    said = recipe.unpack(packed[4:])
    assert said is not None
    assert said["actual_q"] == robot.arm.joints.tolist()
    assert "payload_inertia" in said
    assert ("actual_qdd" in said) == (profile in ("e5.23", "x10.11"))


def test_a_simulated_arm_starts_without_heavy_libraries() -> None:
    code = (
        "import sys; import drivers.simulators.ur.__main__;"
        "heavy = {'scipy', 'igl', 'cv2', 'trimesh'}.intersection(sys.modules);"
        "sys.exit(f'imported {heavy}' if heavy else 0)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
