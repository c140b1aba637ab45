"""From the samples of a lens session to the table, verified at settings of its own."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from calibration.camera import CameraOptions, calibrate_camera
from calibration.camera_start import poses_with, start_from_planes
from calibration.lens_table import (
    AxisNodes,
    Conditions,
    LensIdentity,
    LensMeasurements,
    LensTables,
    Measured,
    best_curve,
    build_tables,
    calibration_file,
    judge_lens,
    measure_aperture,
    separate,
)
from calibration.lens_table.edge_blur import EdgeBlurs
from calibration.lens_table.sharpness import blur_shots
from calibration.lens_table.zoom_curves import WORDS
from calibration.wizard.before import half_field_mm, kept, line_of
from calibration.wizard.compare_lens import compare_lens_tables
from calibration.wizard.lens_motors import IRIS, hysteresis_of, plan_sides
from calibration.wizard.lens_node_result import (
    NodeResult,
    blur_of,
    nodes_of,
    on_the_target,
    plan_of,
    target_causes,
)
from calibration.wizard.lens_nodes import samples_of
from calibration.wizard.lens_work import OnTheWork, left_out_mm, on_the_work
from calibration.wizard.points import rms_px
from calibration.wizard.provenance import provenance_of, temperature_of
from calibration.wizard.verification import HeldOutView, Verification, with_causes
from mvp.calibrated import AxisTable, LensTableCalibration, Quality, ViewResidual
from mvp.errors import CalibrationError
from mvp.optics import principal_distance_mm
from mvp.wizard import Outcome

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibration.lens_table import LensFit
    from calibration.projection import PinholeCamera
    from calibration.wizard.session_store import Sample, SessionStore

KEY = "lens"
VERIFICATION = "verification"
_WHAT = "the principal distance at settings between the nodes"
_AIRY_SIGMA = 1.0290 / (2 * np.sqrt(2 * np.log(2)))
_SHARP_SHARE = 0.005
_A_FLOOR = 0.01  # discs of a few pixels, among diffraction and edges that are not sharp
_CENTRE_PX, _K1 = 0.3, 0.003


def outcome_of(store: SessionStore) -> Outcome:
    """The result of a session.

    Raises:
        CalibrationError: too little was measured to make a table; says what is missing.
    """
    facts = store.facts
    nodes = nodes_of(store)
    if not nodes:
        raise CalibrationError(
            "no lens setting was measured with three usable views or more",
            hint="check the light, and where [target] of the cell file says it lies",
            where=str(store.path),
        )
    fit = separate([one.node for one in nodes])
    iris = irises_of(store, nodes, fit)
    model = facts.lens_table
    data = LensMeasurements(
        [one.node for one in nodes],
        iris,
        facts.blur_circle_mm,
        approach={
            "zoom": model.zoom_f_mm.approach,
            "focus": model.focus_extension_mm.approach,
            "iris": model.iris_a_mm.approach,
        },
        hysteresis=hysteresis_of(store, plan_sides(facts, plan_of(store))),
        conditions=Conditions(*temperature_of(store)),
    )
    tables = build_tables(data)
    if tables.table is None:
        return _nothing(tables, nodes)
    held = verified(store, tables, nodes)
    return _told(store, tables, nodes, held)


def irises_of(
    store: SessionStore, nodes: Sequence[NodeResult], fit: LensFit
) -> dict[int, Measured]:
    """The pupil at every iris that was looked at.

    How far out of focus an edge is follows from the lens as just fitted.
    """
    steps = sorted({sample.lens_steps["iris"] for sample in store.usable(IRIS)})
    found: dict[int, Measured] = {}
    for step in steps:
        samples = [s for s in store.usable(IRIS) if s.lens_steps["iris"] == step]
        try:
            found[step] = _pupil(store, samples, nodes, fit)
        except CalibrationError:
            continue
    return found


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


# ------------------------------------------------------------------- held-out views


def verified(
    store: SessionStore, tables: LensTables, nodes: Sequence[NodeResult]
) -> Verification:
    """The principal distance at settings between the nodes, foretold and measured."""
    samples = store.usable(VERIFICATION)
    settings = sorted({(s.lens_steps["zoom"], s.lens_steps["focus"]) for s in samples})
    views = []
    for zoom, focus in settings:
        mine = samples_of(samples, zoom, focus)
        if len(mine) >= 2:
            views.append(_foretold(store, tables, nodes, mine))
    return Verification(_WHAT, tuple(views))


def _foretold(
    store: SessionStore,
    tables: LensTables,
    nodes: Sequence[NodeResult],
    samples: tuple[Sample, ...],
) -> HeldOutView:
    if tables.table is None:
        raise ValueError("only a table can foretell")
    steps, sensor = samples[0].lens_steps, store.facts.sensor
    iris = tables.table.iris.range_steps[0]
    lens = tables.table.setting(steps["zoom"], steps["focus"], iris)
    wanted = float(principal_distance_mm(lens.d_mm, lens.f_mm, lens.e_mm))
    seen, aspect = store.observations(samples), sensor.pitch_x_mm / sensor.pitch_y_mm
    found = calibrate_camera(
        on_the_target(seen, nodes),
        CameraOptions(
            free=("fx_px", "fy_px", "cx_px", "cy_px", "k1"),
            tied_focal=True,
            aspect=aspect,
            priors=_usual(nodes),
            folds=0,
        ),
        start=start_from_planes(seen, aspect=aspect),
    )
    error = found.camera.fx_px * sensor.pitch_x_mm - wanted
    own = found.sigma_of("fx_px") * sensor.pitch_x_mm
    table = float(np.hypot(tables.fit.d_sigma_mm.max(), left_out_mm(tables)))
    return HeldOutView(
        f"zoom {steps['zoom']} focus {steps['focus']}",
        abs(float(error)),
        float(np.hypot(own, table)),
    )


def _usual(nodes: Sequence[NodeResult]) -> tuple[tuple[str, float, float], ...]:
    """Centre and k1 as the nodes have them, with how much they differ."""
    values = np.array([[n.camera.cx_px, n.camera.cy_px, n.camera.k1] for n in nodes])
    spread = np.maximum(values.std(axis=0), [_CENTRE_PX, _CENTRE_PX, _K1])
    middle = np.median(values, axis=0)
    return tuple(
        (name, float(mean), float(sd))
        for name, mean, sd in zip(("cx_px", "cy_px", "k1"), middle, spread, strict=True)
    )


# -------------------------------------------------------------------------- the file


def _told(
    store: SessionStore,
    tables: LensTables,
    nodes: Sequence[NodeResult],
    held: Verification,
) -> Outcome:
    facts = store.facts
    identity = LensIdentity(
        facts.serials.get("lens", ""), facts.date, simulated=facts.simulated
    )
    document = calibration_file(tables, identity)
    stamp = provenance_of(store, "lens", document.provenance.method)
    work = on_the_work(facts, tables)
    causes = (*target_causes(nodes), *held.causes())
    quality = with_causes(_quality(document.quality, nodes, work, held), causes)
    document = document.model_copy(
        update={
            "provenance": stamp,
            "quality": quality,
            "focus_extension_mm": _without_tube(document, facts.tube_mm),
        }
    )
    before = compare_lens_tables(
        facts.lens_table,
        document,
        distance_mm=work.distance_mm,
        half_field_mm=half_field_mm(facts, document, work.distance_mm),
    )
    return Outcome(
        KEY,
        document,
        quality,
        (work.words, *_lines(tables, held), line_of(before)),
        {
            "tables": tables,
            "nodes": tuple(nodes),
            "pictures": [one.pictures for one in nodes if one.pictures],
            "verification": held,
        },
        points=tuple(point for one in nodes for point in one.points),
        comparison=kept(before),
    )


def _quality(
    quality: Quality,
    nodes: Sequence[NodeResult],
    work: OnTheWork,
    held: Verification,
) -> Quality:
    """With what pictures leave at every node, and errors in mm."""
    views = [
        ViewResidual(
            name=f"zoom {one.node.zoom} focus {one.node.focus}",
            rms_px=rms_px(one.points),
        )
        for one in nodes
    ]
    own = quality.out_of_sample_mm
    return quality.model_copy(
        update={
            "rms_px": rms_px([point for one in nodes for point in one.points]),
            "error_95_mm": work.across_95_mm,
            "out_of_sample_mm": held.error if held.views else own,
            "views": views,
        }
    )


def _without_tube(document: LensTableCalibration, tube_mm: float) -> AxisTable:
    axis = document.focus_extension_mm
    return axis.model_copy(
        update={"values_mm": [value - tube_mm for value in axis.values_mm]}
    )


def _lines(tables: LensTables, held: Verification) -> tuple[str, ...]:
    fit = tables.fit
    share = 100 * float((fit.d_sigma_mm / fit.d_mm).max())
    play = ", ".join(
        f"{name} {found.width_steps:.1f}"
        for name, found in tables.measured.hysteresis.items()
    )
    words = (f"play between motor and glass, steps: {play}",) if play else ()
    return (
        f"d is known to {1000 * float(fit.d_sigma_mm.max()):.1f} um ({share:.3f} %), f to "
        f"{1000 * float(fit.f_sigma_mm.max()):.1f} um (one sigma)",
        f"the pupil lies {_e_words(fit)} mm before the nodal point",
        *_changed(tables),
        *words,
        held.words,
    )


def _e_words(fit: LensFit) -> str:
    """One value, or from which to which over the zoom."""
    if not fit.freedom.own_e:
        return f"{fit.e_mm:.2f} +- {fit.e_sigma_mm:.2f}"
    low, high = fit.e_of_zoom_mm.min(), fit.e_of_zoom_mm.max()
    return f"{low:.2f} to {high:.2f} (+- {fit.e_sigma_mm:.2f} or better)"


def _changed(tables: LensTables) -> tuple[str, ...]:
    """What the zoom changes beside f."""
    names = [WORDS[name] for name in tables.by_zoom.curves]
    return (f"the zoom also changes {', '.join(names)}",) if names else ()


def _nothing(tables: LensTables, nodes: Sequence[NodeResult]) -> Outcome:
    verdict = judge_lens(tables)
    quality = Quality(
        verdict="no-go", reasons=verdict.reasons, next_action=verdict.next_action
    )
    details = {"tables": tables, "nodes": tuple(nodes)}
    return Outcome(KEY, None, quality, tuple(verdict.reasons), details)
