"""Factory-calibrated UR arms; the published values of real robots are the oracle."""

import shutil

import numpy as np
import pytest

from mvp.cell.loading import load_cell
from mvp.cell.places import bundled_root
from mvp.errors import ConfigError
from mvp.kinematics import UrCalibration, arm_model

# A UR10e as its maker's ROS driver documents it (m, rad): the upper arm is "placed" 439 m
# away, and yet the flange is where a UR10e has it.
UR10E = {
    "theta_rad": [
        -2.4147806894359e-07,
        1.60233952386695,
        -1.68607190752171,
        0.0837331147700119,
        -1.01260355871158e-07,
        3.91986209186124e-08,
    ],
    "a_m": [
        2.12234865571206e-05,
        0.0193171326277006,
        -0.569251663611088,
        -4.61409023720934e-05,
        -6.39280053471802e-05,
        0,
    ],
    "d_m": [
        0.180539811714259,
        439.140974079901,
        -446.027059806332,
        7.0603368964236,
        0.119811341150314,
        0.115670917257426,
    ],
    "alpha_rad": [
        1.57014608044242,
        0.0013941666682559,
        0.00693818880325995,
        1.56998468543761,
        -1.57038520649543,
        0,
    ],
}
NOMINAL_UR5E_YAML = """
kinematics:
  shoulder:
    x: 0
    y: 0
    z: 0.1625
    roll: -0
    pitch: 0
    yaw: -0
  upper_arm:
    x: 0
    y: 0
    z: 0
    roll: 1.570796327
    pitch: 0
    yaw: -0
  forearm:
    x: -0.425
    y: 0
    z: 0
    roll: -0
    pitch: 0
    yaw: -0
  wrist_1:
    x: -0.3922
    y: 0
    z: 0.1333
    roll: -0
    pitch: 0
    yaw: -0
  wrist_2:
    x: 0
    y: -0.0997
    z: -2.044881182297852e-11
    roll: 1.570796327
    pitch: 0
    yaw: -0
  wrist_3:
    x: 0
    y: 0.0996
    z: -2.042830148012698e-11
    roll: 1.570796326589793
    pitch: 3.141592653589793
    yaw: 3.141592653589793
  hash: calib_12788084448423163542
"""


def toml(values=UR10E, **top) -> str:
    rows = [f"{key} = {value!r}" for key, value in {"schema_version": 1, **top}.items()]
    rows += ["[dh]"]
    for name, row in values.items():
        scale = 1000 if name.endswith("_m") else 1
        rows.append(f"{name.replace('_m', '_mm')} = {[scale * v for v in row]}")
    return "\n".join(rows).replace("'", '"')


@pytest.fixture
def real(tmp_path):
    """The published UR10e."""
    path = tmp_path / "dh.toml"
    path.write_text(toml(model="ur10e", serial="2020"))
    return arm_model("ur10e", dh_calibration=path)


def textbook(q) -> np.ndarray:
    matrix = np.eye(4)
    rows = zip(q, *UR10E.values(), strict=True)
    for joint, theta, a, d, alpha in rows:
        ct, st = np.cos(joint + theta), np.sin(joint + theta)
        ca, sa = np.cos(alpha), np.sin(alpha)
        matrix = matrix @ np.array(
            [
                [ct, -st * ca, st * sa, 1000 * a * ct],
                [st, ct * ca, -ct * sa, 1000 * a * st],
                [0, sa, ca, 1000 * d],
                [0, 0, 0, 1],
            ]
        )
    return matrix


def test_a_calibrated_arm_is_its_own_textbook_chain(real):
    rng = np.random.default_rng(1)
    for q in rng.uniform(-6, 6, (20, 6)):
        np.testing.assert_allclose(real.forward(q).matrix, textbook(q), atol=1e-8)


def test_a_real_robot_is_some_millimetres_from_the_nominal_one(real):
    q = np.random.default_rng(2).uniform(-3, 3, (500, 6))
    _, here = real.forward_batch(q)
    _, nominal = arm_model("ur10e").forward_batch(q)
    off = np.linalg.norm(here - nominal, axis=1)
    assert 1 < off.mean() < 5
    assert off.max() < 10


def test_every_solution_of_a_calibrated_arm_leads_back_to_the_pose(real):
    q = np.random.default_rng(3).uniform(-3, 3, (400, 6))
    rotation, point = real.forward_batch(q)
    found, exists = real.inverse_batch(rotation, point)
    pose, branch = np.nonzero(exists)
    again, where = real.forward_batch(found[pose, branch])
    np.testing.assert_allclose(where, point[pose], atol=2e-6)
    np.testing.assert_allclose(again, rotation[pose], atol=3e-9)
    away = np.abs(np.angle(np.exp(1j * (found - q[:, None])))).max(axis=2)
    recovered = np.where(exists, away, 9).min(axis=1) < 1e-5
    # What is missing stands within a hair of a singular configuration.
    assert recovered.mean() > 0.99
    assert (exists.sum(axis=1) == 8).mean() > 0.5


def test_without_differences_a_calibrated_arm_is_the_nominal_one(tmp_path):
    path = tmp_path / "calibration.conf"
    zeros = "[0, 0, 0, 0, 0, 0]"
    names = ("theta", "a", "d", "alpha")
    path.write_text(
        "[mounting]\n"
        + "".join(f"delta_{name} = {zeros}\n" for name in names)
        + "joint_checksum = [ 0x6e0f7bf, 0xa32a713f ]\n"
        + "calibration_status = 2 # 0 == notInitialized / 2 == Linearised\n"
    )
    q = np.random.default_rng(4).uniform(-3, 3, (100, 6))
    for name in ("ur3e", "ur5e", "ur10e", "ur16e", "ur20"):
        calibrated = arm_model(name, dh_calibration=path)
        nominal = arm_model(name)
        for one, other in zip(
            calibrated.forward_batch(q), nominal.forward_batch(q), strict=True
        ):
            np.testing.assert_allclose(one, other, atol=1e-9)
        rotation, point = nominal.forward_batch(q)
        joints, exists = nominal.inverse_batch(rotation, point)
        again, also = calibrated.inverse_batch(rotation, point)
        both = exists & also
        np.testing.assert_allclose(again[both], joints[both], atol=1e-4)
        assert (also >= exists).mean() > 0.99


def test_the_controllers_own_file_holds_differences_in_metres(tmp_path):
    nominal = arm_model("ur10e").geometry
    nominal_a = np.array([0, nominal.a2, nominal.a3, 0, 0, 0]) / 1000
    nominal_d = np.array([nominal.d1, 0, 0, nominal.d4, nominal.d5, nominal.d6]) / 1000
    half = np.pi / 2
    delta = {
        "theta": UR10E["theta_rad"],
        "a": (np.array(UR10E["a_m"]) - nominal_a).tolist(),
        "d": (np.array(UR10E["d_m"]) - nominal_d).tolist(),
        "alpha": (np.array(UR10E["alpha_rad"]) - [half, 0, 0, half, -half, 0]).tolist(),
    }
    path = tmp_path / "calibration.conf"
    lines = [f"delta_{name} = {values}" for name, values in delta.items()]
    path.write_text("[mounting]\n" + "\n".join(lines))
    arm = arm_model("ur10e", dh_calibration=path)
    q = np.array([0.3, -1.2, 1.4, -0.7, 1.0, 0.9])
    np.testing.assert_allclose(arm.forward(q).matrix, textbook(q), atol=1e-6)


def test_the_ros_drivers_file_describes_the_same_arm(tmp_path):
    path = tmp_path / "ur5e_calibration.yaml"
    path.write_text(NOMINAL_UR5E_YAML)
    q = np.random.default_rng(5).uniform(-3, 3, (50, 6))
    rotation, point = arm_model("ur5e", dh_calibration=path).forward_batch(q)
    expected = arm_model("ur5e").forward_batch(q)
    np.testing.assert_allclose(rotation, expected[0], atol=1e-8)
    np.testing.assert_allclose(point, expected[1], atol=1e-5)


@pytest.mark.parametrize(
    ("name", "text", "told"),
    [
        ("dh.toml", toml(), "439|mm away"),
        ("dh.toml", toml(model="ur10e"), "of a ur10e, not of a ur5e"),
        ("dh.toml", "schema_version = 1\n[dh]\na_mm = [1]", "dh"),
        ("dh.toml", "not toml at all", "factory calibration"),
        ("dh.csv", "1,2,3", "ending"),
        ("calibration.conf", "[mounting]\ndelta_a = [1, 2", "factory calibration"),
        ("calibration.conf", "[other]\n", "factory calibration"),
        ("k.yaml", "kinematics:\n  shoulder:\n    x: 0\n", "factory calibration"),
    ],
)
def test_a_file_that_is_not_of_such_an_arm_is_refused(tmp_path, name, text, told):
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(ConfigError, match=told) as error:
        arm_model("ur5e", dh_calibration=path)
    assert str(path) in str(error.value)


def test_a_gantry_has_no_factory_calibration(tmp_path):
    path = tmp_path / "dh.toml"
    path.write_text(toml())
    with pytest.raises(ConfigError, match="gantry"):
        arm_model("gantry_xyz_pan_tilt", dh_calibration=path)


def test_the_flange_of_a_calibrated_arm_obeys_its_levers(real):
    q = np.random.default_rng(6).uniform(-3, 3, (60, 6))
    _, here = real.forward_batch(q)
    for axis in range(6):
        moved = q.copy()
        moved[:, axis] += 1e-5
        _, there = real.forward_batch(moved)
        way = np.linalg.norm(there - here, axis=1) / 1e-5
        assert (way <= real.levers_mm[-1, axis] + 0.01).all()


def test_a_cell_plans_with_the_calibration_it_names(tmp_path):
    folder = tmp_path / "cell"
    shutil.copytree(bundled_root() / "virtual", folder)
    before = load_cell(str(folder))
    assert before.arm.calibration is None
    g = before.arm.geometry
    half = np.pi / 2
    values = {
        "theta_rad": [0, 1e-4, -2e-4, 1e-4, 0, 0],
        "a_m": [0, g.a2 / 1000 + 1e-4, g.a3 / 1000 - 2e-4, 0, 0, 0],
        "d_m": [g.d1 / 1000, 0, 0, g.d4 / 1000, g.d5 / 1000, g.d6 / 1000 + 1e-4],
        "alpha_rad": [half, 0, 1e-4, half, -half, 0],
    }
    (folder / "dh.toml").write_text(toml(values, model="ur5e"))
    cell = folder / "cell.toml"
    text = cell.read_text().replace(
        "[kinematics]\n", '[kinematics]\ndh_calibration = "dh.toml"\n'
    )
    cell.write_text(text)
    after = load_cell(str(folder))
    assert isinstance(after.arm.calibration, UrCalibration)
    q = after.home_joints
    off = after.arm.forward(q).translation_mm - before.arm.forward(q).translation_mm
    assert 0.01 < np.linalg.norm(off) < 2
    (folder / "dh.toml").write_text(toml(values, model="ur5e", serial="other"))
    assert load_cell(str(folder)).sha256 != after.sha256
    (folder / "dh.toml").write_text("broken")
    with pytest.raises(ConfigError, match=r"cell.toml:\d+") as error:
        load_cell(str(folder))
    assert "dh_calibration" in str(error.value)


def test_a_pose_out_of_reach_has_no_solution_for_a_calibrated_arm(real):
    _, exists = real.inverse_batch(np.eye(3)[None], np.array([[3000.0, 0, 0]]))
    assert not exists.any()
