"""The truth of a simulated cell stays where it is, whatever the cell believes."""

from __future__ import annotations

import json
import shutil
from typing import TYPE_CHECKING

import numpy as np
import pytest

from drivers.virtual_world import VirtualWorld
from mvp.cell.loading import LoadedCell, load_cell, load_task
from mvp.cell.places import bundled_root
from mvp.cell.truth import truth_of
from mvp.cell.world_building import WorldBodies, build_world
from mvp.devices import ScaledClock
from mvp.errors import CalibrationError
from mvp.optics import LensTable
from mvp.testing import block

if TYPE_CHECKING:
    from pathlib import Path

BODIES = WorldBodies(block((-10.0, -10.0, 0.0), (10.0, 10.0, 10.0)), ())
STEPS = {"zoom": 1300.0, "focus": 3000.0, "iris": 120.0}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A copy of the uncalibrated cell."""
    source = bundled_root() / "virtual_uncalibrated"
    return shutil.copytree(source, tmp_path / "cell", copy_function=shutil.copyfile)


def world(cell: LoadedCell) -> VirtualWorld:
    found = build_world(cell, BODIES, ScaledClock(50))
    assert isinstance(found, VirtualWorld)
    found.report_lens(0.0, dict.fromkeys(STEPS, 0.0))  # arrive from below
    found.report_lens(0.5, STEPS)
    return found


def seen(found: VirtualWorld) -> np.ndarray:
    """Everything that a picture depends on."""
    state = found.state(1.0)
    intrinsics = found.intrinsics
    return np.concatenate(
        [
            state.base_from_camera.matrix.ravel(),
            found.base_from_part.matrix.ravel(),
            [state.lens.f_mm, state.lens.d_mm, state.lens.a_mm, state.lens.e_mm],
            [intrinsics.centre_x_px, intrinsics.centre_y_px, intrinsics.k1],
        ]
    )


def rewritten(path: Path, **change: object) -> None:
    content = json.loads(path.read_text())
    path.write_text(json.dumps(content | change))


def test_rewriting_the_belief_moves_nothing_that_is_true(folder: Path) -> None:
    before = seen(world(load_cell(str(folder))))
    believed = folder / "calibration"
    matrix = json.loads((believed / "hand_eye.json").read_text())["matrix"]
    matrix[2][3] += 20.0
    rewritten(believed / "hand_eye.json", matrix=matrix, reference_d_mm=12.6)
    rewritten(believed / "camera.json", k1=0.2, centre_x_px=300.0)
    rewritten(believed / "lens_table.json", pupil_offset_mm=9.0)
    shutil.copyfile(folder / "truth" / "part_pose.json", believed / "part_pose.json")
    np.testing.assert_array_equal(seen(world(load_cell(str(folder)))), before)


def test_the_truth_is_what_its_folder_says(folder: Path) -> None:
    cell = load_cell(str(folder))
    found, true = world(cell), truth_of(cell)
    table = LensTable.from_calibration(true.lens_table)
    lens = found.state(1.0).lens
    assert lens.f_mm == pytest.approx(float(table.zoom.value_mm(STEPS["zoom"])))
    assert lens.e_mm == true.lens_table.pupil_offset_mm == 2.4
    np.testing.assert_allclose(
        found.base_from_part.matrix, true.part_pose.matrix, atol=1e-12
    )
    reference = true.hand_eye.reference_d_mm
    assert reference is not None
    np.testing.assert_allclose(
        found.tool_from_camera(reference).matrix, true.hand_eye.matrix, atol=1e-12
    )
    believed = cell.calibrations
    shift = true.base_from_part.translation_mm - believed.base_from_part.translation_mm
    assert 3 < np.linalg.norm(shift) < 5


def test_errors_come_on_top_of_the_truth(folder: Path) -> None:
    before = world(load_cell(str(folder)))
    text = (folder / "cell.toml").read_text()
    errors = "[world.errors]\npart_mm = [0.0, 3.0, 0.0]\nzoom_fraction = 0.01\n"
    (folder / "cell.toml").write_text(text.replace("[world.errors]\n", errors))
    after = world(load_cell(str(folder)))
    moved = before.base_from_part.inverse() @ after.base_from_part
    np.testing.assert_allclose(moved.translation_mm, [0, 3, 0], atol=1e-9)
    ratio = after.state(1.0).lens.f_mm / before.state(1.0).lens.f_mm
    assert ratio == pytest.approx(1.01)


def test_the_flange_is_off_by_the_stated_amount_and_comes_back_to_it(
    folder: Path,
) -> None:
    found = world(load_cell(str(folder)))
    rng = np.random.default_rng(4)
    places = rng.uniform(-2, 2, (100, 6))
    errors = []
    for number, joints in enumerate(places):
        found.report_arm(float(number), joints)
        state = found.state(float(number))
        hand = found.tool_from_camera(state.lens.d_mm)
        true = state.base_from_camera @ hand.inverse()
        off = found.model.forward(joints).inverse() @ true
        errors.append([*off.translation_mm, *np.degrees(off.rotvec_rad)])
    spread = np.std(errors, axis=0)
    assert spread[:3] == pytest.approx([0.05] * 3, rel=0.25)
    assert spread[3:] == pytest.approx([0.01] * 3, rel=0.25)
    found.report_arm(900.0, places[7])
    again, first = found.state(900.0), found.state(7.0)
    np.testing.assert_allclose(
        again.base_from_camera.matrix, first.base_from_camera.matrix, atol=1e-9
    )


def test_without_a_truth_folder_the_belief_is_true(folder: Path) -> None:
    text = (folder / "cell.toml").read_text()
    (folder / "cell.toml").write_text(text.replace('truth = "truth"', ""))
    cell = load_cell(str(folder))
    assert truth_of(cell) is cell.calibrations


def test_a_truth_that_is_not_there_is_named_with_its_line(folder: Path) -> None:
    (folder / "truth" / "hand_eye.json").unlink()
    with pytest.raises(
        CalibrationError, match=r"cell\.toml:\d+: world\.truth"
    ) as caught:
        truth_of(load_cell(str(folder)))
    assert "hand_eye.json" in caught.value.message
    assert "leave out truth" in caught.value.hint


def test_a_part_that_its_task_places_is_there_unless_the_folder_knows_better(
    folder: Path,
) -> None:
    task = folder / "tasks" / "paper_object.toml"
    task.write_text(
        task.read_text().replace('units = "mm"', 'units = "mm"\npose = "other.json"')
    )
    own = folder / "tasks" / "other.json"
    shutil.copyfile(folder / "calibration" / "part_pose.json", own)
    cell = load_cell(str(folder))
    held = cell.holding(load_task(cell, None))
    np.testing.assert_array_equal(
        truth_of(held).base_from_part.matrix,
        cell.calibrations.base_from_part.matrix,
    )
    shutil.copyfile(folder / "truth" / "part_pose.json", folder / "truth" / own.name)
    np.testing.assert_array_equal(
        truth_of(held).base_from_part.matrix, truth_of(cell).base_from_part.matrix
    )


def test_the_printed_target_is_in_the_world(folder: Path) -> None:
    names = [body.mesh.name for body in world(load_cell(str(folder))).bodies()]
    assert names.count("target") == 1
