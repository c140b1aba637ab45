"""The cell as a wizard sees it: what is refused, what moves, how pictures are exposed."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING

import numpy as np
import pytest

from calibration.wizard.working import working_setting
from mvp.calibrated import LensValidity
from mvp.cell.calibrate_bench import CellBench
from mvp.cell.calibrate_facts import facts_of
from mvp.cell.calibrate_folders import (
    existing_session,
    put_in_place,
    unfinished_session,
)
from mvp.cell.hardware import opened
from mvp.cell.lens_validity import require_held
from mvp.cell.loading import load_cell, load_task
from mvp.cell.plan_job import prepare
from mvp.cell.session import devices_for
from mvp.errors import CalibrationError, MotionStopped, RecordError, UsageError
from mvp.geometry import Pose
from mvp.kinematics import inverse
from mvp.wizard import Refusal, Stand, Way

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from mvp.cell.plan_job import Setting
    from mvp.wizard import SessionFacts

_D_MM = 12.9


@pytest.fixture(scope="module")
def setting() -> Setting:
    cell = load_cell("virtual_uncalibrated", accept_calibration="not measured yet")
    return prepare(cell, load_task(cell, None))


@pytest.fixture(scope="module")
def bench(setting: Setting) -> Iterator[CellBench]:
    cell = setting.cell
    with ExitStack() as stack:
        devices = stack.enter_context(devices_for(setting))
        infos = stack.enter_context(opened(devices))
        facts = facts_of(cell, devices, infos, key="camera", seed=0)
        yield CellBench(setting, devices, facts, start_speed=1.0)


NARROW = LensValidity(
    zoom_steps=(0, 20_000), focus_steps=(3000, 4000), iris_steps=(0, 600)
)


def held(bench: CellBench, key: str, accepted: str = "") -> SessionFacts:
    """The same session for something else, on a table that holds in a part of it."""
    table = bench.facts.lens_table.model_copy(update={"validity": NARROW})
    return bench.facts.model_copy(
        update={"key": key, "lens_table": table, "accepted_calibration": accepted}
    )


@pytest.mark.parametrize("key", ["hand-eye", "part"])
def test_the_lens_is_not_driven_to_where_its_table_does_not_hold(
    bench: CellBench, setting: Setting, key: str
) -> None:
    before = bench.devices.lens.state()
    narrow = CellBench(setting, bench.devices, held(bench, key), start_speed=1.0)
    with pytest.raises(CalibrationError, match="holds from 3000 to 4000") as refused:
        narrow.set_lens(zoom=1000, focus=5000, iris=100)
    assert f"`calibrate {key}` needs focus step 5000" in refused.value.message
    assert "mvp-cell calibrate lens CELL" in refused.value.hint
    assert bench.devices.lens.state() == before
    require_held(held(bench, key), {"zoom": 1000, "focus": 3500, "iris": 100})


@pytest.mark.parametrize(
    ("key", "accepted"), [("camera", ""), ("lens", ""), ("hand-eye", "on my word")]
)
def test_what_comes_before_the_table_or_was_accepted_may_go_anywhere(
    bench: CellBench, key: str, accepted: str
) -> None:
    facts = held(bench, key, accepted)
    require_held(facts, {"zoom": 1000, "focus": 5000, "iris": 100})


def test_hand_eye_is_measured_where_the_lens_table_holds(bench: CellBench) -> None:
    wide = working_setting(held(bench, "camera"))
    assert not 3000 <= wide.focus <= 4000
    narrow = working_setting(held(bench, "hand-eye"))
    assert 3000 <= narrow.focus <= 4000
    require_held(held(bench, "hand-eye"), narrow.by_name)


def above_target(bench: CellBench, height_mm: float, side_mm: float = 0.0) -> Pose:
    target = bench.facts.target
    assert target is not None
    middle = np.array([90.0 + side_mm, 67.5, -height_mm])
    return target.base_from_target @ Pose("target", "camera", np.eye(3), middle)


def test_where_the_arm_must_stand_puts_the_camera_where_it_was_asked(
    bench: CellBench,
) -> None:
    asked = above_target(bench, 400.0)
    stand = bench.joints_for(asked, d_mm=_D_MM)
    assert isinstance(stand, Stand)
    tool = bench.arm.forward(stand.joints)
    camera = tool @ bench.facts.tool_from_camera(_D_MM)
    assert np.allclose(camera.matrix, asked.matrix, atol=1e-6)


@pytest.mark.parametrize(
    ("height", "side", "why"),
    [(12.0, 0.0, "target"), (400.0, 3000.0, "workspace"), (850.0, -250.0, "reach")],
)
def test_what_touches_leaves_or_is_too_far_is_refused_in_words(
    bench: CellBench, height: float, side: float, why: str
) -> None:
    refused = bench.joints_for(above_target(bench, height, side), d_mm=_D_MM)
    assert isinstance(refused, Refusal)
    assert why in refused.reason


def test_a_place_inside_the_board_has_no_way_to_it(bench: CellBench) -> None:
    stand = bench.joints_for(above_target(bench, 300.0), d_mm=_D_MM)
    assert isinstance(stand, Stand)
    deep = stand.base_from_tool.matrix.copy()
    deep[2, 3] -= 330.0

    joints = inverse(bench.arm, Pose.from_matrix("base", "tool", deep))
    refused = bench.way_to(joints[0])
    assert isinstance(refused, Refusal)


def test_it_moves_and_exposes_without_saturation_until_it_is_stopped(
    bench: CellBench,
) -> None:
    stand = bench.joints_for(above_target(bench, 400.0), d_mm=_D_MM)
    assert isinstance(stand, Stand)
    way = bench.way_to(stand.joints)
    assert isinstance(way, Way)
    assert way.seconds > 0
    reached = bench.move(stand.joints)
    assert np.allclose(reached.joints, stand.joints, atol=2e-3)
    steps = bench.facts.table.steps(12.5, 12.9, 2.2)
    bench.set_lens(zoom=steps.zoom, focus=steps.focus, iris=steps.iris)
    shot = bench.shoot()
    assert shot.settled
    assert shot.lens_steps == {
        "zoom": steps.zoom,
        "focus": steps.focus,
        "iris": steps.iris,
    }
    level = np.percentile(shot.pixels, 99.5) / shot.full_scale
    assert 0.55 < level < 0.95
    assert shot.times_s["exposure_start"] >= shot.times_s["arm_standing"]
    bench.stop()
    with pytest.raises(MotionStopped):
        bench.move(reached.joints + np.radians(1.0) * np.eye(6)[5])


def test_the_size_that_nobody_measured_is_as_good_as_a_printer(
    bench: CellBench,
) -> None:
    target = bench.facts.target
    assert target is not None
    assert 0 < target.square_sigma_mm < 0.1
    assert bench.facts.temperature_c == pytest.approx(20.0, abs=5)
    assert bench.facts.serials["camera"]


def test_a_calibration_that_is_replaced_is_kept(tmp_path: Path) -> None:
    place = tmp_path / "camera.json"
    assert put_in_place(place, b"1") is None
    assert put_in_place(place, b"1") is None
    first = put_in_place(place, b"2")
    second = put_in_place(place, b"3")
    assert first is not None
    assert second is not None
    assert (first.read_bytes(), second.read_bytes()) == (b"1", b"2")
    assert place.read_bytes() == b"3"
    assert first.parent == tmp_path / "previous"


def test_the_newest_session_without_a_result_is_the_one_to_resume(
    tmp_path: Path,
) -> None:
    with pytest.raises(UsageError):
        unfinished_session(tmp_path, "camera")
    for day, done in (("01", False), ("02", False), ("03", True)):
        folder = tmp_path / "sessions" / f"camera-202601{day}T000000Z"
        folder.mkdir(parents=True)
        (folder / "session.json").write_text("{}")
        if done:
            (folder / "result.json").write_text("{}")
    assert unfinished_session(tmp_path, "camera").name == "camera-20260102T000000Z"
    with pytest.raises(RecordError):
        existing_session(tmp_path)
