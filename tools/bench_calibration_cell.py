"""The uncalibrated virtual cell with a drawn truth: for wizard sessions over many seeds.

Lens, camera, hand-eye, the target's place and its printed size differ from what the
session is told by random errors; the arm errs as the virtual arm does. Nothing is known
of this but the truth that errors are taken from.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from mvp.calibrated import CameraCalibration, LensTableCalibration, TargetPrint
from mvp.cell.calibrate_facts import target_facts
from mvp.cell.check_job import load_unjudged
from mvp.geometry import Pose
from mvp.imaging.printed_target import printed_target
from mvp.optics import LensTable
from mvp.testing import example_belief, virtual_cell
from mvp.testing.virtual_bench import VirtualBench
from mvp.wizard import Allow, Ask, SessionFacts, WizardOptions

if TYPE_CHECKING:
    from calibration.wizard.session_store import SessionStore
    from mvp.wizard import Outcome, Wizard

_HIGHEST_MM = 900.0


@dataclass(frozen=True)
class Errors:
    """One standard deviation of what is drawn; shares of f, x = d - f and a."""

    f: float = 0.012
    x: float = 0.02
    a: float = 0.03
    e_mm: float = 0.3
    centre_px: float = 4.0
    k1: float = 0.03
    hand_mm: float = 1.5
    hand_deg: float = 0.4
    target_mm: float = 2.5
    target_deg: float = 0.6
    arm_mm: float = 0.05
    arm_deg: float = 0.01


class DrawnCell:
    """Truth, and the bench of a session that does not know it.

    Attributes:
        lens: true table.
        camera: true sensor, centre and distortion.
        hand: true ``tool_from_camera`` at ``reference_d_mm``.
        bench: for a wizard; its facts are the nominal ones.
    """

    def __init__(self, seed: int, errors: Errors | None = None) -> None:
        drawn = errors or Errors()
        rng = np.random.default_rng([61, seed])
        self._facts = _facts(seed)
        nominal, target = self._facts, self._facts.target
        if target is None:
            raise ValueError("the cell has a target")
        self.lens_file = _true_lens(nominal.lens_table, drawn, rng)
        self.lens = LensTable.from_calibration(self.lens_file)
        self.camera = _true_camera(nominal.camera, drawn, rng)
        self.reference_d_mm = nominal.hand_eye.reference_d_mm or 0.0
        self.hand = nominal.tool_from_camera(self.reference_d_mm) @ _small(
            "camera", drawn.hand_deg, drawn.hand_mm, rng
        )
        place = target.base_from_target @ _small(
            "target", drawn.target_deg, drawn.target_mm, rng
        )
        size = 1 + rng.normal(0, target.square_sigma_mm) / target.square_mm
        belief = replace(
            example_belief(),
            lens_table=self.lens_file,
            camera=self.camera,
            tool_from_camera=self.hand,
            reference_d_mm=self.reference_d_mm,
        )
        settings = {
            "seed": seed,
            "errors": {"arm_mm": drawn.arm_mm, "arm_deg": drawn.arm_deg},
        }
        cell = virtual_cell(belief=belief, settings=settings, clock_speed=5000.0)
        printed = TargetPrint.model_validate(
            {name: getattr(target, name) for name in TargetPrint.model_fields}
        )
        sides = {"square_mm": size * target.square_mm}
        if target.marker_mm is not None:
            sides["marker_mm"] = size * target.marker_mm
        body = printed_target(printed.model_copy(update=sides), place)
        cell.world.place_targets((body,))
        self._cell = cell
        self.bench = self._bench(self._facts)

    def _bench(self, facts: SessionFacts) -> VirtualBench:
        return VirtualBench(
            self._cell,
            facts,
            lambda pose: "too high" if pose.translation_mm[2] > _HIGHEST_MM else "",
        )

    def told(self, key: str, **files: object) -> SessionFacts:
        """The bench for the next wizard, which knows the files measured so far."""
        self._facts = self._facts.model_copy(update={"key": key, **files})
        self.bench.close()
        self.bench = self._bench(self._facts)
        return self._facts

    def close(self) -> None:
        """Close the devices."""
        self.bench.close()


def driven(wizard: Wizard, cell: DrawnCell, store: SessionStore) -> Outcome:
    """A whole session that is left alone."""
    answer: bool | float | str | None = None
    steps = wizard.steps(cell.bench, store, WizardOptions(auto=True))
    while True:
        try:
            step = steps.send(answer)
        except StopIteration as end:
            return end.value
        answer = None
        if isinstance(step, Allow):
            answer = True
        if isinstance(step, Ask):
            answer = step.default


def _true_lens(
    nominal: LensTableCalibration, drawn: Errors, rng: np.random.Generator
) -> LensTableCalibration:
    update: dict[str, object] = {
        "pupil_offset_mm": nominal.pupil_offset_mm + rng.normal(0, drawn.e_mm)
    }
    shares = {
        "zoom_f_mm": drawn.f,
        "focus_extension_mm": drawn.x,
        "iris_a_mm": drawn.a,
    }
    for name, share in shares.items():
        axis = getattr(nominal, name)
        factor = 1 + rng.normal(0, share)
        values = [value * factor for value in axis.values_mm]
        update[name] = axis.model_copy(update={"values_mm": values})
    return nominal.model_copy(update=update)


def _true_camera(
    nominal: CameraCalibration, drawn: Errors, rng: np.random.Generator
) -> CameraCalibration:
    return nominal.model_copy(
        update={
            "centre_x_px": nominal.centre_x_px + rng.normal(0, drawn.centre_px),
            "centre_y_px": nominal.centre_y_px + rng.normal(0, drawn.centre_px),
            "k1": nominal.k1 + rng.normal(0, drawn.k1),
        }
    )


def _small(frame: str, deg: float, mm: float, rng: np.random.Generator) -> Pose:
    turn, shift = np.radians(rng.normal(0, deg, 3)), rng.normal(0, mm, 3)
    return Pose.from_rotvec(frame, frame, turn, shift)


def _facts(seed: int) -> SessionFacts:
    """What the cell believes on its first day."""
    cell = load_unjudged("virtual_uncalibrated")
    told, config = cell.calibrations, cell.config
    return SessionFacts(
        key="camera",
        cell="drawn",
        simulated=True,
        date="2026-01-01",
        seed=seed,
        serials={"arm": "A-1", "lens": "L-1", "camera": "C-1"},
        arm_model=config.kinematics.model,
        camera=told.camera,
        lens_table=told.lens_table,
        hand_eye=told.hand_eye,
        part_pose=told.part_pose,
        robot={
            "position_mm": config.uncertainty.robot_position_mm,
            "angle_deg": config.uncertainty.robot_angle_deg,
        },
        target=target_facts(config.target),
        blur_circle_mm=config.optics.blur_circle_um / 1000,
        wavelength_mm=config.optics.wavelength_nm * 1e-6,
        workspace_low_mm=config.workspace.low_mm,
        workspace_high_mm=config.workspace.high_mm,
        temperature_c=20.0,
    )
