"""The report of a lens table."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibration.lens_table import judge_lens
from calibration.poses import Poses
from calibration.report.model import Quantity, ReportData
from calibration.report.numbers import sigma_text, value_text
from calibration.report.plots import (
    BudgetPart,
    Coverage,
    ErrorBudget,
    LensCurve,
    NodeErrors,
    ResidualField,
    ViewBars,
)
from calibration.report.shapes import NORMAL_95, target_scene, tilts_of
from calibration.verdict import judged
from mvp.optics import focus_distance_mm

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibration.camera import CameraEstimate
    from calibration.lens_table import Hysteresis, LensTables
    from calibration.lens_table.interpolation import AxisCurve
    from calibration.observations import Observations
    from calibration.report.model import About
    from calibration.report.plots import Plot
    from calibration.verdict import Cause
    from mvp.geometry import FloatArray
    from mvp.optics import AxisName, Sensor

_SYMBOLS: dict[AxisName, str] = {"zoom": "f", "focus": "x = d - f", "iris": "a"}


def lens_report(
    tables: LensTables,
    about: About,
    *,
    sensor: Sensor,
    distance_mm: float,
    pictures: Sequence[tuple[CameraEstimate, Observations]] = (),
    more_causes: Sequence[Cause] = (),
) -> ReportData:
    """Everything that the page of a lens table shows.

    Args:
        tables: the result.
        about: device, day, pictures.
        sensor: behind the lens.
        distance_mm: working distance from the entrance pupil.
        pictures: camera fits of single nodes, where pictures made them.
        more_causes: what else speaks against it, such as held-out settings.
    """
    fit = tables.fit
    share = float((fit.d_sigma_mm / fit.d_mm).max())
    half_field = _half_field_mm(tables, sensor, distance_mm)
    return ReportData(
        "lens",
        about,
        f"A length at the corner of the field at {distance_mm:.0f} mm is known to "
        f"{NORMAL_95 * share * half_field:.2g} mm (95 %); d to {100 * share:.2g} % (one "
        "sigma) at every measured setting.",
        judged(more_causes, judge_lens(tables).causes),
        _quantities(tables),
        tuple(_plots(tables, sensor, distance_mm, half_field, pictures)),
        ((_nodes(tables)), _assumptions(tables)),
        (
            f"Nodes were combined {fit.way}; chi-square {fit.estimate.chi_square:.1f} with "
            f"{fit.estimate.degrees_of_freedom} degrees of freedom (probability "
            f"{fit.estimate.probability:.2g}). Worst determined combination: "
            f"{fit.estimate.weakest.words}.",
        ),
    )


def _half_field_mm(tables: LensTables, sensor: Sensor, distance_mm: float) -> float:
    """Half the diagonal of the widest field of view."""
    half = np.hypot(
        sensor.width_px * sensor.pitch_x_mm, sensor.height_px * sensor.pitch_y_mm
    )
    return float(half / 2 / tables.fit.node_values[:, 0].min() * distance_mm)


def _quantities(tables: LensTables) -> tuple[Quantity, ...]:
    fit = tables.fit
    worst_d = int((fit.d_sigma_mm / fit.d_mm).argmax())
    node = fit.seen.nodes[worst_d]
    depth = 100 * float((tables.sharp_sigma_mm / tables.depth_of_focus_mm).max())
    rows = [
        Quantity(f"f at zoom {step}", float(f), float(sigma), "mm")
        for step, f, sigma in zip(
            fit.seen.zoom_steps, fit.f_mm, fit.f_sigma_mm, strict=True
        )
    ]
    rows += [
        Quantity(
            "pupil offset e", fit.e_mm, fit.e_sigma_mm, "mm", "towards the object"
        ),
        Quantity(
            "d, least certain node",
            float(fit.d_mm[worst_d]),
            float(fit.d_sigma_mm[worst_d]),
            "mm",
            f"zoom {node.zoom}, focus {node.focus}",
        ),
        Quantity(
            "sigma of the sharp place by the depth of focus",
            depth,
            None,
            "%",
            "at most 10",
        ),
        Quantity(
            "steps -> mm -> steps",
            float(tables.round_trip_steps),
            None,
            "steps",
            "largest difference",
        ),
    ]
    rows += _changes(tables)
    for name, found in tables.measured.hysteresis.items():
        rows += _sides(name, found)
    return tuple(rows)


def _changes(tables: LensTables) -> list[Quantity]:
    """What the zoom changes beside f, at every zoom."""
    return [
        Quantity(
            f"{name.removesuffix('_' + unit).replace('_', ' ')} at zoom {step}",
            float(value),
            float(sigma),
            unit,
            left_out,
        )
        for name, curve in tables.by_zoom.curves.items()
        for unit in [name.rpartition("_")[2] if "_" in name else ""]
        for step, value, sigma, left_out in zip(
            curve.nodes.steps,
            curve.nodes.values_mm,
            curve.nodes.sigma_mm,
            _left_out_words(curve),
            strict=True,
        )
    ]


def _left_out_words(curve: AxisCurve) -> list[str]:
    """For every node; the ends are never left out."""
    if not len(curve.left_out_mm):
        return [""] * len(curve.nodes.steps)
    inner = [f"left out, foretold {error:+.2g} off" for error in curve.left_out_mm]
    return ["", *inner, ""]


def _sides(name: AxisName, found: Hysteresis) -> list[Quantity]:
    return [
        Quantity(
            f"{name}, backlash", found.width_steps, found.width_sigma_steps, "steps"
        ),
        Quantity(
            f"{name}, repeatability",
            found.repeatability_steps,
            None,
            "steps",
            f"one sigma, approached {found.side.replace('_', ' ')}",
        ),
    ]


def _plots(
    tables: LensTables,
    sensor: Sensor,
    distance_mm: float,
    half_field_mm: float,
    pictures: Sequence[tuple[CameraEstimate, Observations]],
) -> list[Plot]:
    fit = tables.fit
    off = fit.seen.values[:, 0] - fit.node_values[:, 0]
    names = tuple(f"{node.zoom} / {node.focus}" for node in fit.seen.nodes)
    plots: list[Plot] = [
        _budget(tables, sensor, distance_mm, half_field_mm, pictures),
        *(_curve(tables, name) for name in _SYMBOLS),
        NodeErrors(names, 1000 * off, 1000 * np.sqrt(fit.seen.covariances[:, 0, 0])),
    ]
    if pictures:
        plots += _of_pictures(pictures, (sensor.width_px, sensor.height_px))
    return plots


def _of_pictures(
    pictures: Sequence[tuple[CameraEstimate, Observations]], size_px: tuple[int, int]
) -> list[Plot]:
    """Of the views at all nodes together: residuals, coverage, tilts, places."""
    pixels = np.concatenate([seen.pixels for _, seen in pictures])
    errors = np.concatenate([found.errors_px for found, _ in pictures])
    names = tuple(name for found, _ in pictures for name in found.view_names)
    rms = np.concatenate([found.view_rms_px for found, _ in pictures])
    rotation = np.concatenate([found.state.rotation for found, _ in pictures])
    shift = np.concatenate([found.state.translation_mm for found, _ in pictures])
    widest = min((found.camera for found, _ in pictures), key=lambda c: c.fx_px)
    scene = target_scene(Poses(rotation, shift), widest, pictures[0][1], names)
    return [
        ViewBars("residual of each view (RMS)", "px", names, rms),
        ResidualField(pixels, errors, size_px, _sigma_px(pictures)),
        Coverage.of(pixels, size_px),
        tilts_of(rotation, names),
        scene,
    ]


def _sigma_px(pictures: Sequence[tuple[CameraEstimate, Observations]]) -> float:
    return float(np.sqrt(np.mean([found.sigma_px**2 for found, _ in pictures])))


def _budget(
    tables: LensTables,
    sensor: Sensor,
    distance_mm: float,
    half_field_mm: float,
    pictures: Sequence[tuple[CameraEstimate, Observations]],
) -> ErrorBudget:
    fit = tables.fit
    share = float((fit.d_sigma_mm / fit.d_mm).max())
    parts = [
        BudgetPart(
            "calibration", share * half_field_mm, f"sigma of d, {100 * share:.2g} %"
        )
    ]
    focus = tables.measured.hysteresis.get("focus")
    if focus is not None:
        curve = tables.curves["focus"]
        slope = float(np.abs(curve.slope_mm(curve.nodes.steps)).max())
        play = focus.repeatability_steps * slope
        lateral = play / float(fit.d_mm.min()) * half_field_mm
        words = f"focus repeats to {focus.repeatability_steps:.2g} steps, {play:.2g} mm of d"
        parts.append(BudgetPart("motor", lateral, words))
    if pictures:
        sigma = _sigma_px(pictures)
        mm_per_px = sensor.pitch_x_mm * distance_mm / float(fit.node_values[:, 0].min())
        parts.append(
            BudgetPart("pixel noise", sigma * mm_per_px, f"{sigma:.2g} px of one point")
        )
    what = "a length from the middle to the corner of the field"
    return ErrorBudget(distance_mm, what, tuple(parts))


def _curve(tables: LensTables, name: AxisName) -> LensCurve:
    curve, found = tables.curves[name], tables.measured.hysteresis.get(name)
    nodes = curve.nodes
    return LensCurve(
        name,
        _SYMBOLS[name],
        nodes.steps,
        nodes.values_mm,
        nodes.sigma_mm,
        curve.table_steps,
        curve.table_mm,
        curve.left_out_mm,
        _around(nodes.sigma_mm)[: len(curve.left_out_mm)],
        curve.kind.words,
        "" if found is None else _hysteresis_words(found),
    )


def _around(sigma_mm: FloatArray) -> FloatArray:
    """(k - 2,): of each inner node with its two neighbours."""
    square = sigma_mm**2
    return np.sqrt((square[:-2] + square[1:-1] + square[2:]) / 3)


def _hysteresis_words(found: Hysteresis) -> str:
    width, sigma = found.width_steps, found.width_sigma_steps
    return (
        f"Backlash {value_text(width, sigma)} ± {sigma_text(sigma)} steps, "
        f"repeatability {found.repeatability_steps:.2g} steps."
    )


def _nodes(
    tables: LensTables,
) -> tuple[str, tuple[str, ...], tuple[tuple[str, ...], ...]]:
    fit = tables.fit
    rows = []
    for index, node in enumerate(fit.seen.nodes):
        f_cal, cx, cy, k1 = fit.node_values[index]
        f = float(fit.f_mm[fit.seen.zoom_of[index]])
        sharp = float(focus_distance_mm(fit.d_mm[index], f)) - fit.e_of_node_mm[index]
        rows.append(
            (
                str(node.zoom),
                str(node.focus),
                f"{f_cal:.4f} mm",
                f"{fit.d_mm[index]:.4f} ± {fit.d_sigma_mm[index]:.4f} mm",
                f"{sharp:.1f} mm" if np.isfinite(sharp) else "infinity",
                f"{cx:.1f}, {cy:.1f} px",
                f"{k1 * f_cal**2:.4f}",
            )
        )
    heads = (
        "zoom",
        "focus",
        "principal distance",
        "d",
        "sharp at (from the pupil)",
        "centre",
        "k1",
    )
    return ("Measured settings, as fitted", heads, tuple(rows))


def _assumptions(
    tables: LensTables,
) -> tuple[str, tuple[str, ...], tuple[tuple[str, ...], ...]]:
    rows = []
    for test in tables.fit.tests:
        said = "contradicted" if test.contradicted else "not contradicted"
        answer = said if test.tested else "these data cannot test it"
        chance = f"{test.probability:.2g}" if test.tested else "–"
        rows.append((test.assumption, answer, chance))
    heads = ("taken for granted", "the data say", "probability")
    return ("What the table takes for granted", heads, tuple(rows))
