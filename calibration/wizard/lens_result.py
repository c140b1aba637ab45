"""From the samples of a lens session to the table, verified at settings of its own."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibration.camera import CameraOptions, calibrate_camera
from calibration.camera_start import start_from_planes
from calibration.lens_table import (
    Conditions,
    LensIdentity,
    LensMeasurements,
    LensTables,
    build_tables,
    calibration_file,
    judge_lens,
    separate,
)
from calibration.lens_table.zoom_curves import WORDS
from calibration.results import refused
from calibration.wizard.before import half_field_mm, kept, line_of
from calibration.wizard.compare_lens import compare_lens_tables
from calibration.wizard.lens_irises import irises_of
from calibration.wizard.lens_motors import hysteresis_of, plan_sides
from calibration.wizard.lens_node_result import (
    NodeResult,
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
from mvp.optics import achievable_set, principal_distance_mm
from mvp.wizard import Outcome

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibration.lens_table import LensFit
    from calibration.wizard.lens_irises import Irises
    from calibration.wizard.session_store import Sample, SessionStore

KEY = "lens"
VERIFICATION = "verification"
_WHAT = "the principal distance at settings between the nodes"
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
    irises = irises_of(store, nodes, fit)
    model = facts.lens_table
    data = LensMeasurements(
        [one.node for one in nodes],
        irises.measured,
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
        return without_table(tables, nodes)
    held = verified(store, tables, nodes)
    return _told(store, tables, nodes, held, irises)


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
    irises: Irises,
) -> Outcome:
    facts = store.facts
    work = on_the_work(facts, tables)
    document = _document(store, tables, nodes, held, irises, work)
    before = compare_lens_tables(
        facts.lens_table,
        document,
        distance_mm=work.distance_mm,
        half_field_mm=half_field_mm(facts, document, work.distance_mm),
    )
    return Outcome(
        KEY,
        document,
        document.quality,
        (
            work.words,
            *_lines(tables, held),
            *(f"warning: {warning}" for warning in irises.warnings),
            line_of(before),
        ),
        {
            "tables": tables,
            "nodes": tuple(nodes),
            "pictures": [one.pictures for one in nodes if one.pictures],
            "verification": held,
            "warnings": irises.warnings,
        },
        points=tuple(point for one in nodes for point in one.points),
        comparison=kept(before),
    )


def _document(
    store: SessionStore,
    tables: LensTables,
    nodes: Sequence[NodeResult],
    held: Verification,
    irises: Irises,
    work: OnTheWork,
) -> LensTableCalibration:
    """The file, with what the session knows beyond the tables."""
    if tables.table is None:
        raise ValueError("no table, no result")
    facts = store.facts
    identity = LensIdentity(
        facts.serials.get("lens", ""), facts.date, simulated=facts.simulated
    )
    document = calibration_file(tables, identity)
    stamp = provenance_of(store, "lens", document.provenance.method)
    causes = (*target_causes(nodes), *held.causes())
    quality = with_causes(_quality(document.quality, nodes, work, held), causes)
    quality = quality.model_copy(
        update={"reasons": [*quality.reasons, *irises.warnings]}
    )
    return document.model_copy(
        update={
            "provenance": stamp,
            "quality": quality,
            "focus_extension_mm": _without_tube(document, facts.tube_mm),
            "achievable": achievable_set(tables.table.with_tube(-facts.tube_mm)),
        }
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


def without_table(tables: LensTables, nodes: Sequence[NodeResult]) -> Outcome:
    """Of nodes that make no table: why, and what to do."""
    details = {"tables": tables, "nodes": tuple(nodes)}
    lines = ("these pictures give no lens table",)
    return Outcome(KEY, None, refused(judge_lens(tables)), lines, details)
