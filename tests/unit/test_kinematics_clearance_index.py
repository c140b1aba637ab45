"""The index of a clearance against errors that are drawn."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mvp.geometry import Box
from mvp.kinematics import (
    Capsule,
    CellBodies,
    arm_model,
    clearance_index,
    obstacles,
)

JOINTS = np.array([0.2, -1.4, 1.5, -1.57, -1.57, 0.1])
LENS = Capsule("lens", np.zeros(3), np.array([0.0, 0.0, 120.0]), 30.0)


def cell(gap_mm: float) -> tuple[CellBodies, np.ndarray]:
    """A small table at some distance below the lens, and where the pupil is."""
    model = arm_model("ur5e")
    pose = model.forward(JOINTS)
    pupil = pose.apply(np.array([0.0, 0.0, 100.0]))
    ends = pose.apply(np.stack([LENS.start_mm, LENS.end_mm]))
    tip = ends[ends[:, 2].argmin()]
    middle = tip - [0.0, 0.0, LENS.radius_mm + gap_mm + 25.0]
    half = np.array([40.0, 40.0, 25.0])
    table = Box(middle - half, middle + half)
    things = obstacles(None, keep_outs=[("table", table)])
    return CellBodies(model, (LENS,), things), pupil


def test_a_shift_alone_gives_the_distance_over_its_deviation() -> None:
    bodies, pupil = cell(20.0)
    found = clearance_index(
        bodies,
        JOINTS,
        pupil_mm=pupil,
        part_mm=np.zeros(3),
        asked_mm=5.0,
        position_mm=2.0,
        angle_rad=0.0,
    )
    assert found is not None
    assert found.sigmas == pytest.approx((20.0 - 5.0) / 2.0, rel=1e-6)


def test_the_index_is_that_of_drawn_errors() -> None:
    bodies, pupil = cell(20.0)
    found = clearance_index(
        bodies,
        JOINTS,
        pupil_mm=pupil,
        part_mm=np.zeros(3),
        asked_mm=5.0,
        position_mm=0.5,
        angle_rad=0.01,
    )
    rng = np.random.default_rng(3)
    pose = bodies.model.forward(JOINTS)
    ends = pose.apply(np.stack([LENS.start_mm, LENS.end_mm])) - pupil
    turns = Rotation.from_rotvec(rng.normal(0, 0.01, (20_000, 3))).as_matrix()
    moved = np.einsum("nij,kj->nki", turns, ends) + pupil
    moved += rng.normal(0, 0.5, (20_000, 1, 3))
    table_top = bodies.obstacles[0].mesh.vertices_mm[:, 2].max()
    gap = moved[:, :, 2].min(axis=1) - LENS.radius_mm - table_top
    assert found is not None
    assert found.sigmas == pytest.approx((20.0 - 5.0) / gap.std(), rel=0.05)


def test_nothing_to_touch_has_no_index() -> None:
    bodies = CellBodies(arm_model("ur5e"), (LENS,), ())
    assert (
        clearance_index(
            bodies,
            JOINTS,
            pupil_mm=np.zeros(3),
            part_mm=np.zeros(3),
            asked_mm=5.0,
            position_mm=1.0,
            angle_rad=0.01,
        )
        is None
    )


def test_a_link_is_judged_by_turns_of_the_part() -> None:
    model = arm_model("ur5e")
    foot = model.links_batch(JOINTS[None]).at(0)[1]
    middle = foot.start_mm + np.array([0.0, foot.radius_mm + 60.0, 0.0])
    part = Box(middle - 40.0, middle + 40.0)
    bodies = CellBodies(model, (), obstacles(None, keep_outs=[("part", part)]))

    def found(part_mm: np.ndarray) -> float:
        index = clearance_index(
            bodies,
            JOINTS,
            pupil_mm=np.full(3, 1e4),
            part_mm=part_mm,
            asked_mm=0.0,
            position_mm=1.0,
            angle_rad=0.01,
        )
        assert index is not None
        assert index.other == "part"
        return index.sigmas

    away = middle + np.array([0.0, 0.0, 1000.0])
    assert found(middle) > 5 * found(away)
