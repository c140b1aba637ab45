"""What is built on a calibration that does not hold now is refused before a motion."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from mvp.cell.calibrate_facts import facts_of
from mvp.cell.calibrate_job import CalibrateRequest, calibrate, check_reliance
from mvp.cell.calibrated_devices import temperature_of
from mvp.cell.hardware import build_devices, opened
from mvp.cell.loading import load_cell, load_task
from mvp.cell.locate_job import locate_part
from mvp.cell.plan_job import Planned, make_plan, prepare
from mvp.cell.run_folder import create_run_folder
from mvp.cell.world_building import WorldBodies
from mvp.errors import CalibrationError
from mvp.testing import block
from tests.measured_cells import measured_cell

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from mvp.cell.engine import CellDevices
    from mvp.cell.loading import LoadedCell
    from mvp.cell.session import Motion
    from mvp.devices import DeviceInfo
    from mvp.wizard import Answer, Step

BODIES = WorldBodies(block((-10.0, -10.0, 0.0), (10.0, 10.0, 10.0)), ())


class Unasked:
    """A person who must not be asked to let anything move."""

    def __init__(self) -> None:
        self.heard: list[Step] = []

    def allow(self, motion: Motion) -> bool:
        raise AssertionError(f"about to move: {motion.errand}")

    def answer(self, step: Step) -> Answer:
        self.heard.append(step)
        return None


def from_the_other_side(cell: Path) -> None:
    """The table was measured coming from above; the lens comes from below."""
    path = cell.parent / "calibration" / "lens_table.json"
    table = json.loads(path.read_text())
    table["focus_extension_mm"]["approach"] = "from_above"
    path.write_text(json.dumps(table))


def ten_kelvin_off(cell: Path) -> None:
    """Everything was measured at 20 deg C."""
    cell.write_text(
        cell.read_text().replace("temperature_c = 20.0 ", "temperature_c = 30.0 ")
    )


def at_other_steps(cell: Path) -> None:
    """The table holds in a small range of focus only."""
    path = cell.parent / "calibration" / "lens_table.json"
    table = json.loads(path.read_text())
    table["validity"] = {
        "zoom_steps": [0, 20_000],
        "focus_steps": [0, 1],
        "iris_steps": [0, 20_000],
    }
    path.write_text(json.dumps(table))


SPOILED = [(from_the_other_side, "coming from above"), (ten_kelvin_off, "30 deg C now")]


@pytest.mark.parametrize("key", ["hand-eye", "part"])
@pytest.mark.parametrize(("spoil", "said"), SPOILED)
def test_a_calibration_is_not_built_on_what_does_not_hold_now(
    tmp_path: Path, key: str, spoil: Callable[[Path], None], said: str
) -> None:
    cell = measured_cell(tmp_path / "cell")
    spoil(cell)
    loaded = load_cell(str(cell))
    setting = prepare(loaded, load_task(loaded, None))
    with pytest.raises(CalibrationError, match=said) as refused:
        calibrate(setting, CalibrateRequest(key), Unasked())
    assert refused.value.exit_code == 2
    assert "mvp-cell calibrate lens CELL" in refused.value.hint
    assert not list((cell.parent / "calibration" / "sessions").glob(f"{key}*"))


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> Planned:
    cell = load_cell(str(measured_cell(tmp_path_factory.mktemp("good") / "cell")))
    return make_plan(cell, load_task(cell, None))


@pytest.mark.parametrize(
    ("spoil", "said"), [*SPOILED, (at_other_steps, "holds from 0 to 1")]
)
def test_a_part_is_not_located_by_what_does_not_hold_now(
    tmp_path: Path, planned: Planned, spoil: Callable[[Path], None], said: str
) -> None:
    cell = measured_cell(tmp_path / "cell")
    spoil(cell)
    setting = replace(planned.setting, cell=load_cell(str(cell)))
    folder = create_run_folder(tmp_path / "runs", "one")
    with pytest.raises(CalibrationError, match=said) as refused:
        locate_part(replace(planned, setting=setting), folder, Unasked())
    assert refused.value.exit_code == 2


def at_devices(
    cell: LoadedCell, use: Callable[[CellDevices, dict[str, DeviceInfo]], object]
) -> None:
    devices = build_devices(cell, BODIES, {})
    with opened(devices) as infos:
        use(devices, infos)


def test_the_lens_may_be_measured_anew_from_its_own_side(tmp_path: Path) -> None:
    file = measured_cell(tmp_path / "cell")
    from_the_other_side(file)
    cell = load_cell(str(file))

    def use(devices: CellDevices, infos: dict[str, DeviceInfo]) -> None:
        assert check_reliance(cell, devices, infos, "lens", "") == []
        sides = {
            key: facts_of(
                cell, devices, infos, key=key, seed=0
            ).lens_table.focus_extension_mm.approach
            for key in ("lens", "hand-eye")
        }
        assert sides == {"lens": "from_below", "hand-eye": "from_above"}

    at_devices(cell, use)


def test_an_unknown_temperature_is_said_before_it_is_built_on(tmp_path: Path) -> None:
    file = measured_cell(tmp_path / "cell")
    file.write_text(file.read_text().replace("temperature_c = 20.0 ", ""))
    cell = load_cell(str(file))

    def use(devices: CellDevices, infos: dict[str, DeviceInfo]) -> None:
        told = check_reliance(cell, devices, infos, "hand-eye", "")
        assert [one.name for one in told] == ["camera", "lens_table"]
        assert all("nobody knows how warm" in one.text for one in told)

    at_devices(cell, use)


class Warm:
    """A device with a thermometer, or one that is out of order."""

    def __init__(self, measured_c: float | None) -> None:
        self.measured_c = measured_c

    def temperature_c(self) -> float | None:
        return self.measured_c


@pytest.mark.parametrize(
    ("stated", "lens", "camera", "known"),
    [
        ("21.5", 30.0, 40.0, (21.5, "cell-file")),
        (None, 30.0, 40.0, (30.0, "device")),
        (None, None, 40.0, (40.0, "device")),
        (None, None, None, (None, "unknown")),
    ],
)
def test_run_and_calibrate_know_the_same_temperature_from_the_same_source(
    tmp_path: Path,
    stated: str | None,
    lens: float | None,
    camera: float | None,
    known: tuple[float | None, str],
) -> None:
    file = measured_cell(tmp_path / "cell")
    if stated is not None:
        table = f"[conditions]\ntemperature_c = {stated}\n\n[workspace]"
        file.write_text(file.read_text().replace("[workspace]", table))
    cell = load_cell(str(file))

    def use(devices: CellDevices, infos: dict[str, DeviceInfo]) -> None:
        warm = replace(devices, lens=Warm(lens), camera=Warm(camera))
        assert tuple(temperature_of(cell, warm, infos)) == known
        facts = facts_of(cell, warm, infos, key="camera", seed=0)
        assert (facts.temperature_c, facts.temperature_source) == known

    at_devices(cell, use)
