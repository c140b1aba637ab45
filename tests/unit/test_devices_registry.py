import subprocess
import sys
from pathlib import Path

import pytest

from mvp.devices import DeviceContext, list_drivers, load_driver, load_world
from mvp.errors import ConfigError, PluginError
from tests.distributions import install

PLUGIN = """
from mvp.fileedge import FileModel

class Config(FileModel):
    port: str = "/dev/null"

class OtherLens:
    role = "lens"
    Config = Config

    @classmethod
    def from_config(cls, config, context, *, name):
        return cls()

class Incomplete:
    role = "lens"
"""


@pytest.fixture
def plugin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Another distribution with a good, an incomplete and two broken drivers."""
    (tmp_path / "other_plugin.py").write_text(PLUGIN)
    (tmp_path / "broken_plugin.py").write_text("import no_such_sdk\n")
    (tmp_path / "crashing_plugin.py").write_text("1 / 0\n")
    install(
        tmp_path,
        "other-plugin",
        "2.0",
        "[mvp_cell.drivers]\n"
        "other-lens = other_plugin:OtherLens\n"
        "half-lens = other_plugin:Incomplete\n"
        "sdk-lens = broken_plugin:Lens\n"
        "crash-lens = crashing_plugin:Lens\n",
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


def test_the_virtual_drivers_are_listed_with_their_roles():
    found = {entry.key: entry for entry in list_drivers()}
    for role in ("arm", "lens", "camera"):
        entry = found[f"virtual-{role}"]
        assert (entry.role, entry.error) == (role, "")
        assert entry.distribution == "mvp-cell"
        assert entry.version


def test_a_misspelt_key_is_refused_with_a_suggestion():
    with pytest.raises(PluginError) as error:
        load_driver("virtul-arm", "arm")
    assert "'virtual-arm'" in error.value.hint


def test_a_driver_for_another_role_is_refused():
    with pytest.raises(PluginError, match="for the lens, not for the arm"):
        load_driver("virtual-lens", "arm")


def test_an_unknown_world_is_refused():
    with pytest.raises(PluginError, match="unknown world"):
        load_world("reality")


def test_a_driver_of_another_distribution_appears_beside_ours(plugin: Path):
    found = {entry.key: entry for entry in list_drivers()}
    assert found["other-lens"].distribution == "other-plugin"
    assert found["other-lens"].version == "2.0"
    assert load_driver("other-lens", "lens").Config().port == "/dev/null"  # type: ignore[attr-defined]


def test_a_missing_library_breaks_only_its_own_driver(plugin: Path):
    found = {entry.key: entry for entry in list_drivers()}
    assert "no_such_sdk" in found["sdk-lens"].error
    assert "ZeroDivisionError" in found["crash-lens"].error
    assert found["virtual-lens"].error == ""
    with pytest.raises(PluginError, match="no_such_sdk"):
        load_driver("sdk-lens", "lens")


def test_a_driver_without_its_parts_is_refused(plugin: Path):
    with pytest.raises(PluginError, match="has no Config, from_config"):
        load_driver("half-lens", "lens")


def test_a_virtual_device_needs_a_virtual_world():
    driver = load_driver("virtual-arm", "arm")
    with pytest.raises(ConfigError) as error:
        driver.from_config(driver.Config(), DeviceContext(), name="arm")
    assert "[world]" in error.value.hint


def _refusal(script: str, folder: Path) -> str:
    """What a fresh interpreter prints that must end with 7; ``folder`` is argv[1]."""
    done = subprocess.run(
        [sys.executable, "-c", script, str(folder)],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 7, done.stderr
    return done.stdout


def test_a_foreign_drivers_package_is_noticed(tmp_path: Path):
    foreign = tmp_path / "drivers"
    foreign.mkdir()
    (foreign / "__init__.py").write_text("")
    script = (
        "import sys; sys.path.insert(0, sys.argv[1])\n"
        "from mvp.devices import load_driver\n"
        "from mvp.errors import PluginError\n"
        "try: load_driver('virtual-arm', 'arm')\n"
        "except PluginError as error: print(error.message); sys.exit(7)\n"
    )
    assert str(foreign) in _refusal(script, tmp_path)


def test_files_that_another_distribution_put_into_our_package_are_noticed(
    tmp_path: Path,
):
    info = tmp_path / "drivers-0.1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(
        "Metadata-Version: 2.1\nName: drivers\nVersion: 0.1.0\n"
    )
    (info / "RECORD").write_text("drivers/__init__.py,,\n")
    script = (
        "import sys; sys.path.append(sys.argv[1])\n"
        "from mvp.devices.registry import check_own_package\n"
        "from mvp.errors import PluginError\n"
        "try: check_own_package()\n"
        "except PluginError as error: print(error.message); sys.exit(7)\n"
    )
    assert "overwrites" in _refusal(script, tmp_path)
