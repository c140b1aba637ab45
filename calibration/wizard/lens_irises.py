"""The pupil at every iris of a lens session, and which could not be measured."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from calibration.camera_start import poses_with
from calibration.lens_table import AxisNodes, Measured, best_curve, measure_aperture
from calibration.lens_table.edge_blur import EdgeBlurs
from calibration.lens_table.sharpness import blur_shots
from calibration.wizard.lens_motors import IRIS
from calibration.wizard.lens_node_result import blur_of
from mvp.errors import CalibrationError
from mvp.optics import principal_distance_mm

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from calibration.lens_table import LensFit
    from calibration.projection import PinholeCamera
    from calibration.wizard.lens_node_result import NodeResult
    from calibration.wizard.session_store import Sample, SessionStore

_AIRY_SIGMA = 1.0290 / (2 * np.sqrt(2 * np.log(2)))
_SHARP_SHARE = 0.005
_A_FLOOR = 0.01  # discs of a few pixels, among diffraction and edges that are not sharp


@dataclass(frozen=True)
class Irises:
    """The pupil at the irises that were looked at.

    Attributes:
        measured: by step.
        failed: why not, by step.
    """

    measured: Mapping[int, Measured]
    failed: Mapping[int, str]

    @property
    def warnings(self) -> tuple[str, ...]:
        """One line for each that is missing, and which range that leaves."""
        if not self.failed or not self.measured:
            return ()
        first, last = min(self.measured), max(self.measured)
        values = [one.value for one in self.measured.values()]
        range_words = (
            f"the table holds from iris {first} to {last}, a = {min(values):.2f} to "
            f"{max(values):.2f} mm"
        )
        return tuple(
            f"iris {step} could not be measured ({why}): {range_words}"
            + (", and is interpolated there" if first < step < last else "")
            for step, why in sorted(self.failed.items())
        )


def irises_of(store: SessionStore, nodes: Sequence[NodeResult], fit: LensFit) -> Irises:
    """The pupil at every iris that was looked at.

    How far out of focus an edge is follows from the lens as just fitted.
    """
    every = [sample for sample in store.samples if sample.role == IRIS]
    measured: dict[int, Measured] = {}
    failed: dict[int, str] = {}
    for step in sorted({sample.lens_steps["iris"] for sample in every}):
        samples = [s for s in store.usable(IRIS) if s.lens_steps["iris"] == step]
        if not samples:
            failed[step] = "no usable picture"
            continue
        try:
            measured[step] = _pupil(store, samples, nodes, fit)
        except CalibrationError as error:
            failed[step] = error.message
    return Irises(measured, failed)


def _pupil(
    store: SessionStore,
    samples: Sequence[Sample],
    nodes: Sequence[NodeResult],
    fit: LensFit,
) -> Measured:
    facts = store.facts
    pitch = facts.sensor.pitch_y_mm
    focus = best_curve(AxisNodes(fit.seen.focus_steps, fit.x_mm, fit.x_sigma_mm))
    blurs, defocus, spot = [], [], 0.0
    for sample in samples:
        zoom = int(np.argmin(np.abs(fit.seen.zoom_steps - sample.lens_steps["zoom"])))
        f = float(fit.f_mm[zoom])
        x = float(
            np.interp(sample.lens_steps["focus"], focus.table_steps, focus.table_mm)
        )
        x += float(fit.shift_mm[zoom])
        f_cal = float(principal_distance_mm(f + x, f, fit.e_of_zoom_mm[zoom]))
        camera = _like(nodes, sample, f_cal / facts.sensor.pitch_x_mm)
        pose = poses_with(camera, store.observations([sample]))
        one = blur_of(store, sample, camera, (pose.rotation[0], pose.translation_mm[0]))
        blurs.append(one)
        defocus.append(x / f - f_cal / one.depth_mm)
        a_mm = facts.lens_at(sample.lens_steps).a_mm
        spot = _AIRY_SIGMA * facts.wavelength_mm * f_cal / a_mm / pitch
    shots = blur_shots(
        EdgeBlurs.joined(blurs),
        np.concatenate(defocus),
        pitch_mm=pitch,
        diffraction_px=spot,
    )
    deepest = float(np.abs(shots.defocus).max())
    result = measure_aperture(shots, (0.0, _SHARP_SHARE * deepest))
    sigma = float(np.hypot(result.a_sigma_mm, _A_FLOOR * result.a_mm))
    return Measured(result.a_mm, sigma)


def _like(nodes: Sequence[NodeResult], sample: Sample, f_px: float) -> PinholeCamera:
    """The camera of the nearest node with another principal distance."""
    zoom, focus = sample.lens_steps["zoom"], sample.lens_steps["focus"]
    near = min(
        nodes, key=lambda n: (abs(n.node.zoom - zoom), abs(n.node.focus - focus))
    )
    camera = near.camera
    ratio = camera.fy_px / camera.fx_px
    return replace(camera, fx_px=f_px, fy_px=f_px * ratio)
