from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from drivers.virtual_settings import Faults, WorldErrors
from drivers.virtual_world import VirtualWorld
from mvp.devices import Frame
from mvp.errors import ConnectError, DeviceFault, DeviceTimeout, LimitError
from mvp.geometry import Pose
from mvp.imaging import textured_plane
from mvp.kinematics import arm_model, tool_from_camera_at
from mvp.optics import LensTable
from mvp.testing import VirtualCell, example_belief, virtual_cell

AWAY = np.radians([4.0, -88, 88, -90, -90, 3])
MIDDLE = {"zoom": 500, "focus": 1400, "iris": 300}


@pytest.fixture
def cell() -> Iterator[VirtualCell]:
    with Opened(virtual_cell()) as one:
        yield one


class Opened:
    def __init__(self, cell: VirtualCell) -> None:
        self.cell = cell

    def __enter__(self) -> VirtualCell:
        for device in (self.cell.arm, self.cell.lens, self.cell.camera):
            device.open()
        self.cell.camera.configure(exposure_s=0.004)
        return self.cell

    def __exit__(self, *exc: object) -> None:
        for device in (self.cell.arm, self.cell.lens, self.cell.camera):
            device.close()


def truth(cell: VirtualCell) -> VirtualWorld:
    assert isinstance(cell.world, VirtualWorld)
    return cell.world


def shoot(cell: VirtualCell) -> Frame:
    return cell.camera.capture(not_before_s=cell.clock.now_s(), timeout_s=500)


def fault(cell: VirtualCell, **faults: object) -> None:
    truth(cell).inject(Faults.model_validate(faults))


def set_lens(cell: VirtualCell, **steps: int) -> None:
    cell.lens.move_steps(**(MIDDLE | steps), timeout_s=100)


def test_without_errors_the_truth_is_the_belief(cell: VirtualCell):
    cell.arm.move_joints(AWAY, timeout_s=60)
    cell.lens.home(timeout_s=60)
    set_lens(cell)
    state = truth(cell).state(cell.clock.now_s())
    lens = LensTable.from_calibration(cell.belief.lens_table).setting(**MIDDLE)
    assert (state.lens.f_mm, state.lens.d_mm, state.lens.a_mm) == pytest.approx(
        (lens.f_mm, lens.d_mm, lens.a_mm), abs=1e-12
    )
    hand = tool_from_camera_at(
        cell.belief.tool_from_camera, d_mm=lens.d_mm, reference_d_mm=13.0
    )
    expected = arm_model("ur5e").forward(AWAY) @ hand
    np.testing.assert_allclose(
        state.base_from_camera.matrix, expected.matrix, atol=1e-9
    )


def test_the_glass_stands_at_the_same_place_from_either_side(cell: VirtualCell):
    cell.lens.home(timeout_s=60)
    settings = []
    for start in (0, 1900, 510, 490):
        set_lens(cell, zoom=start, focus=2 * start, iris=start // 5)
        set_lens(cell)
        settings.append(truth(cell).state(cell.clock.now_s()).lens)
    assert all(s == settings[0] for s in settings)


def test_an_approach_from_the_wrong_side_would_leave_the_glass_behind(
    cell: VirtualCell,
):
    world, now = truth(cell), cell.clock.now_s()
    start = world.state(now).lens.d_mm
    rates = {"zoom": 1e5, "focus": 1e5, "iris": 1e5}
    motors = world.lens_motors(now)
    down = {axis: (place - 20.0,) for axis, place in motors.items()}
    end = world.begin_lens(down, rates, now)
    # 20 steps are less than the 30 of the dead band.
    assert world.state(end + 1).lens.d_mm == pytest.approx(start, abs=1e-12)


def test_lost_steps_move_the_glass_and_not_the_counter(cell: VirtualCell):
    cell.lens.home(timeout_s=60)
    set_lens(cell)
    before = truth(cell).state(cell.clock.now_s()).lens
    fault(cell, lens={"lost_steps": {"focus": 100}})
    after = truth(cell).state(cell.clock.now_s()).lens
    assert after.d_mm - before.d_mm == pytest.approx(100 * 1.1 / 4000)
    assert cell.lens.state().focus == MIDDLE["focus"]


def test_configured_errors_separate_truth_from_belief():
    errors = {
        "hand_eye_mm": [0.5, 0, 0],
        "part_mm": [0, 2.0, 0],
        "part_deg": [0, 0, 1.0],
        "focus_d_mm": 0.05,
        "zoom_fraction": 0.01,
        "a_fraction": -0.1,
        "centre_px": [3.0, 0],
        "pupil_offset_mm": 0.4,
        "arm_joints_deg": [0.1],
    }
    plain, off = virtual_cell(), virtual_cell(settings={"errors": errors})
    a, b = (truth(c).state(0.0) for c in (plain, off))
    assert b.lens.d_mm - a.lens.d_mm == pytest.approx(0.05)
    assert b.lens.f_mm / a.lens.f_mm == pytest.approx(1.01)
    assert b.lens.a_mm / a.lens.a_mm == pytest.approx(0.9)
    assert b.lens.e_mm - a.lens.e_mm == pytest.approx(0.4)
    assert b.joints[0] - a.joints[0] == pytest.approx(np.radians(0.1))
    assert truth(off).intrinsics.centre_x_px - truth(plain).intrinsics.centre_x_px == 3
    moved = off.belief.base_from_part.inverse() @ truth(off).base_from_part
    np.testing.assert_allclose(moved.translation_mm, [0, 2, 0])
    assert moved.angle_to_rad(Pose.identity("part", "part")) == pytest.approx(
        np.radians(1)
    )


def test_a_scaled_part_and_a_moved_corner_change_only_the_true_part():
    errors = {
        "part_scale": 1.02,
        "moved_vertices": [{"at_mm": [30, 30, 40], "by_mm": [1, 0, 0]}],
    }
    cell = virtual_cell(settings={"errors": errors})
    mesh = truth(cell).bodies()[0].mesh
    assert mesh.vertices_mm.max(axis=0) == pytest.approx([31 * 1.02, 30.6, 40.8])
    assert cell.belief.part.vertices_mm.max() == 40


def test_the_picture_shows_the_part_where_the_pinhole_says(cell: VirtualCell):
    image = shoot(cell)
    world = truth(cell)
    state = world.state(cell.clock.now_s())
    camera_from_part = state.base_from_camera.inverse() @ world.base_from_part
    top = np.array([[-30.0, -30, 40], [30, 30, 40]])
    f_cal = state.lens.d_mm
    low, high = np.sort(
        world.intrinsics.project(camera_from_part.apply(top), f_cal), axis=0
    )
    bright = image.pixels > image.pixels.max() / 2
    rows, columns = np.nonzero(bright)
    assert columns.min() == pytest.approx(low[0], abs=1.5)
    assert columns.max() == pytest.approx(high[0], abs=1.5)
    assert rows.min() == pytest.approx(low[1], abs=1.5)
    assert rows.max() == pytest.approx(high[1], abs=1.5)


def test_noise_comes_from_the_seed(cell: VirtualCell):
    first, second = shoot(cell), shoot(cell)
    assert (first.pixels != second.pixels).mean() > 0.2
    with Opened(virtual_cell()) as again:
        np.testing.assert_array_equal(shoot(again).pixels, first.pixels)


def test_motion_during_the_exposure_smears_the_picture(cell: VirtualCell):
    world = truth(cell)
    still = world.picture(world.clock.now_s(), 0.01)
    start = world.clock.now_s()
    end = world.begin_arm(AWAY, speed_fraction=1.0, t_s=start)
    middle = (start + end) / 2
    moving, sharp = world.picture(middle, 0.2), world.picture(end + 1, 0.2)

    def steepest(picture: object) -> float:
        return float(np.abs(np.diff(picture.grey, axis=1)).max())  # type: ignore[attr-defined]

    assert steepest(moving) < 0.7 * steepest(sharp)
    assert np.abs(still.grey - sharp.grey).max() > 0.1


def test_a_frame_that_was_asked_for_after_the_stop_shows_the_part_standing(
    cell: VirtualCell,
):
    cell.arm.move_joints(AWAY, timeout_s=60)
    frame = shoot(cell)
    world = truth(cell)
    assert frame.exposure_start_s >= world.arm.end_s
    assert not world.arm.moving_between(
        frame.exposure_start_s, frame.exposure_start_s + frame.exposure_s
    )


def test_stale_frames_in_the_queue_are_thrown_away(cell: VirtualCell):
    fault(cell, camera={"stale_frames": 5})
    for _ in range(3):
        asked = cell.clock.now_s()
        assert shoot(cell).exposure_start_s >= asked


def test_time_stamps_that_lie_deliver_an_old_picture(cell: VirtualCell):
    old = shoot(cell)
    cell.arm.move_joints(AWAY, timeout_s=60)
    new = shoot(cell)
    fault(cell, camera={"stamp_ahead_s": 100.0})
    lied = shoot(cell)

    def apart(a: Frame, b: Frame) -> float:
        return float(np.abs(a.pixels.astype(float) - b.pixels).mean())

    assert apart(lied, old) < apart(new, old) / 3


def test_a_dead_camera_times_out(cell: VirtualCell):
    fault(cell, camera={"dead_after_frames": 1})
    shoot(cell)
    with pytest.raises(DeviceTimeout, match="camera"):
        cell.camera.capture(not_before_s=cell.clock.now_s(), timeout_s=5)


def test_dropped_frames_are_counted(cell: VirtualCell):
    fault(cell, camera={"drop_every": 2})
    assert any(shoot(cell).dropped for _ in range(40))


def test_an_exposure_that_reads_back_wrong_is_a_fault(cell: VirtualCell):
    fault(cell, camera={"read_back_factor": 1.5})
    with pytest.raises(DeviceFault, match="reads back"):
        cell.camera.configure(exposure_s=0.004)


def test_a_wrong_exposure_saturates_the_picture(cell: VirtualCell):
    before = shoot(cell)
    fault(cell, camera={"exposure_factor": 50.0})
    after = shoot(cell)
    assert (after.pixels == 255).mean() > (before.pixels == 255).mean() + 0.02
    assert after.exposure_s == before.exposure_s


def test_an_unknown_body_hides_the_part(cell: VirtualCell):
    before = shoot(cell)
    box = {"low_mm": [-10, -10, 60], "high_mm": [10, 10, 70], "albedo": 0.0}
    fault(cell, occluders=[box])
    change = shoot(cell).pixels.astype(float) - before.pixels
    assert change.min() < -20


def test_a_protective_stop_is_a_fault_until_it_is_cleared(cell: VirtualCell):
    fault(cell, arm={"protective_stop_after_s": 0.2})
    for _ in range(2):
        with pytest.raises(DeviceFault) as error:
            cell.arm.move_joints(AWAY, timeout_s=60)
        assert error.value.code == "C153A0"
    assert cell.arm.state().standing
    fault(cell)
    assert cell.arm.move_joints(AWAY, timeout_s=60).standing


def test_a_stalled_arm_times_out(cell: VirtualCell):
    fault(cell, arm={"stall_after_s": 0.1})
    with pytest.raises(DeviceTimeout):
        cell.arm.move_joints(AWAY, timeout_s=5)


def test_a_stalled_lens_axis_is_a_fault_that_names_it(cell: VirtualCell):
    cell.lens.home(timeout_s=60)
    fault(cell, lens={"stall": "focus"})
    with pytest.raises(DeviceFault, match="focus"):
        set_lens(cell)


def test_a_lens_that_lost_its_home_refuses_to_move(cell: VirtualCell):
    cell.lens.home(timeout_s=60)
    fault(cell, lens={"loses_home": True})
    assert not cell.lens.state().homed
    with pytest.raises(LimitError, match="homed"):
        set_lens(cell)


@pytest.mark.parametrize("role", ["arm", "lens", "camera"])
def test_a_device_that_is_switched_off_cannot_be_opened(role: str):
    cell = virtual_cell(settings={"faults": {role: {"unreachable": True}}})
    with pytest.raises(ConnectError, match="nobody answers"):
        getattr(cell, role).open()


def test_an_extension_tube_adds_to_d():
    belief = replace(example_belief(), mounted_tube_mm=0.5)
    plain, tube = virtual_cell(), virtual_cell(belief=belief)
    d = [truth(c).state(0.0).lens.d_mm for c in (plain, tube)]
    assert d[1] - d[0] == pytest.approx(0.5)
    truth(tube).mount_tube(0.0)
    assert truth(tube).state(0.0).lens.d_mm == pytest.approx(d[0])


def test_truth_can_be_changed_while_it_runs(cell: VirtualCell):
    before = shoot(cell)
    truth(cell).change_truth(WorldErrors(part_mm=(15.0, 0.0, 0.0)))
    moved = shoot(cell)
    assert np.abs(moved.pixels.astype(float) - before.pixels).max() > 50


def test_an_error_given_as_a_length_takes_its_direction_from_the_seed():
    poses = [
        truth(virtual_cell(settings={"seed": seed, "errors": {"part_mm": 2.0}}))
        for seed in (1, 1, 2)
    ]
    shifts = [
        w.belief.base_from_part.inverse().apply(w.base_from_part.translation_mm)
        for w in poses
    ]
    assert [np.linalg.norm(s) for s in shifts] == pytest.approx([2.0] * 3)
    np.testing.assert_array_equal(shifts[0], shifts[1])
    assert np.linalg.norm(shifts[0] - shifts[2]) > 0.1


def test_more_backlash_than_the_table_says_leaves_the_glass_behind(cell: VirtualCell):
    cell.lens.home(timeout_s=60)
    set_lens(cell)
    right = truth(cell).state(cell.clock.now_s()).lens.d_mm
    fault(cell, lens={"backlash_steps": {"focus": 200}})
    set_lens(cell, focus=3000)
    set_lens(cell)
    wrong = truth(cell).state(cell.clock.now_s()).lens.d_mm
    assert wrong - right > 0.02
    assert cell.lens.state().focus == MIDDLE["focus"]


def test_a_printed_target_can_be_placed_before_the_camera(cell: VirtualCell):
    before = shoot(cell)
    board = np.kron(np.indices((6, 8)).sum(axis=0) % 2, np.full((10, 10), 0.9))
    flat = Pose.from_rotvec("world", "texture", [0, 0, 0], [-530.0, -165.0, 110.0])
    truth(cell).place_targets((textured_plane(board.astype(np.float32), 1.0, flat),))
    after = shoot(cell)
    on_part = before.pixels > 60
    assert 0.3 < (after.pixels[on_part] < 20).mean() < 0.6
