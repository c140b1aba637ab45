"""Arm models that other distributions bring."""

from pathlib import Path

import numpy as np
import pytest

from mvp.cell.init_job import copy_cell
from mvp.cell.loading import load_cell
from mvp.errors import ConfigError, PluginError
from mvp.kinematics import ARM_MODELS, arm_model, arm_model_names
from tests.distributions import install

PLUGIN = """
from mvp.kinematics import arm_model

def taller():
    return arm_model("gantry_xyz_pan_tilt", joint_high=[900, 600, 900, 3, 2])

def half():
    return object()

def crash():
    return 1 / 0
"""


@pytest.fixture
def plugin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another distribution with a good, an incomplete and a broken arm model."""
    (tmp_path / "acme_arms.py").write_text(PLUGIN)
    install(
        tmp_path,
        "acme-arms",
        "1.0",
        "[mvp_cell.arm_models]\n"
        "acme_taller = acme_arms:taller\n"
        "acme_half = acme_arms:half\n"
        "acme_crash = acme_arms:crash\n"
        "acme_missing = acme_legs:model\n",
    )
    monkeypatch.syspath_prepend(str(tmp_path))


def test_without_plugins_there_are_our_own_models() -> None:
    assert arm_model_names() == ARM_MODELS


@pytest.mark.usefixtures("plugin")
def test_a_model_of_another_distribution_is_found_by_its_name() -> None:
    assert arm_model("acme_taller").joint_high[2] == 900
    assert set(arm_model_names()) > set(ARM_MODELS)


@pytest.mark.usefixtures("plugin")
def test_its_limits_can_be_replaced() -> None:
    low = np.array([10.0, 10.0, 10.0, -1.0, -1.0])
    assert (arm_model("acme_taller", joint_low=low).joint_low == low).all()


@pytest.mark.usefixtures("plugin")
@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("acme_half", "has no .*forward_batch"),
        ("acme_crash", "ZeroDivisionError"),
        ("acme_missing", "acme_legs"),
    ],
)
def test_a_model_that_does_not_load_is_told_by_name(name: str, reason: str) -> None:
    with pytest.raises(PluginError, match=f"{name}.*{reason}"):
        arm_model(name)


@pytest.mark.usefixtures("plugin")
def test_a_misspelt_model_is_refused_with_a_suggestion() -> None:
    with pytest.raises(ConfigError) as error:
        arm_model("acme_tallest")
    assert "acme_taller" in error.value.hint


@pytest.mark.usefixtures("plugin")
def test_a_factory_calibration_fits_no_foreign_model(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no factory calibration"):
        arm_model("acme_taller", dh_calibration=tmp_path / "x.conf")


@pytest.mark.usefixtures("plugin")
def test_a_cell_says_where_it_asks_for_a_model_that_does_not_load(
    tmp_path: Path,
) -> None:
    folder = tmp_path / "cell"
    copy_cell("virtual", folder)
    file = folder / "cell.toml"
    file.write_text(file.read_text().replace('"ur5e"', '"acme_crash"', 1))
    with pytest.raises(
        PluginError, match=r"cell\.toml:\d+: kinematics\.model: .*crash"
    ):
        load_cell(str(folder))
