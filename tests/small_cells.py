"""A small virtual cell with a target, whose truth is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.hand_eye import RobotNoise
from mvp.calibrated import (
    LensTableCalibration,
    Provenance,
    Quality,
    RigidCalibration,
    TargetPrint,
)
from mvp.geometry import Pose
from mvp.imaging.printed_target import printed_target
from mvp.optics import LensTable
from mvp.testing import example_belief, virtual_cell
from mvp.testing.virtual_bench import VirtualBench
from mvp.wizard import SessionFacts

WIDTH, HEIGHT = 320, 256
BOARD = {
    "kind": "charuco",
    "columns": 9,
    "rows": 7,
    "square_mm": 20.0,
    "marker_mm": 13.0,
}
REFERENCE_D, REFERENCE_F = 12.93, 12.5
ROBOT = RobotNoise(0.1, float(np.radians(0.02)))


def stamp():
    return Provenance(
        date="2026-01-01", device_serial="", method="example", simulated=True
    )


def rigid(schema, pose, **reference):
    return RigidCalibration(
        schema=schema,
        provenance=stamp(),
        quality=Quality(verdict="go"),
        target=pose.target,
        source=pose.source,
        matrix=pose.matrix.tolist(),
        **reference,
    )


def changed(table, **factors):
    """A lens whose values are those of the table times a factor."""
    moved = {
        name: getattr(table, name).model_copy(
            update={"values_mm": [v * factor for v in getattr(table, name).values_mm]}
        )
        for name, factor in factors.items()
    }
    return table.model_copy(update=moved)


class Cell:
    """A virtual cell that is not quite what its facts say."""

    def __init__(self, key, *, e_mm=2.0, f_share=1.0, x_share=1.0, forbids=None):
        base = example_belief(width_px=WIDTH, height_px=HEIGHT, e_mm=e_mm)
        self.hand = Pose.from_rotvec(
            "tool", "camera", np.radians([0.5, -0.4, 25.0]), [2.0, -2.0, 105.0]
        )
        table = base.lens_table
        truth = changed(table, zoom_f_mm=f_share, focus_extension_mm=x_share)
        belief = replace(
            base,
            lens_table=truth,
            tool_from_camera=self.hand,
            reference_d_mm=REFERENCE_D,
        )
        self.target = Pose.from_rotvec(
            "base",
            "target",
            np.array([np.pi, 0.0, 0.0]),
            np.array([-580.0, -60.0, 5.0]),
        )
        self.truth = LensTable.from_calibration(truth)
        self.cell = virtual_cell(belief=belief, clock_speed=5000.0)
        body = printed_target(TargetPrint(**BOARD), self.target, texel_mm=0.2)
        self.cell.world.place_targets((body,))
        self.facts = self._facts(key, table, base.camera)
        self.bench = VirtualBench(self.cell, self.facts, forbids or (lambda _: ""))

    def _facts(self, key, table: LensTableCalibration, camera):
        rough = Pose.from_rotvec(
            "tool", "camera", np.radians([0.0, 0.0, 25.0]), [0.0, 0.0, 104.0]
        )
        part = Pose.identity("base", "part")
        place = self.target.translation_mm + np.array([4.0, -3.0, 2.0])
        return SessionFacts(
            key=key,
            cell="small",
            simulated=True,
            date="2026-01-01",
            seed=3,
            serials={"arm": "A-1", "lens": "L-1", "camera": "C-1"},
            arm_model="ur5e",
            camera=camera,
            lens_table=table,
            hand_eye=rigid(
                "mvp-cell/hand-eye/1",
                rough,
                reference_d_mm=REFERENCE_D,
                reference_f_mm=REFERENCE_F,
            ),
            part_pose=rigid("mvp-cell/part-pose/1", part),
            robot={"position_mm": 0.05, "angle_deg": 0.01},
            target={
                **BOARD,
                "square_sigma_mm": 0.005,
                "position_mm": tuple(place),
                "rotation_deg": (180.0, 0.0, 0.0),
            },
            blur_circle_mm=0.0135,
            workspace_low_mm=(-1000, -1000, 0),
            workspace_high_mm=(1000, 1000, 1500),
        )

    def close(self):
        self.bench.close()
