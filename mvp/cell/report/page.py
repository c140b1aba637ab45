"""Everything the page says, gathered from plan.json, run.json and the pictures."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import zip_longest
from pathlib import PurePath
from typing import TYPE_CHECKING, Literal, TypeAlias

from mvp.cell.report.measured import Measured, measured_in
from mvp.cell.wording import chance_text, error_text, kept_text, spread_text
from mvp.kinematics import ARM_MODELS, arm_model

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.cell.records import Stillness
    from mvp.cell.run_document import RunDocument, ViewDocument
    from mvp.planning.plan import (
        KeptProbability,
        Margin,
        NotCovered,
        Plan,
        PlannedView,
    )

FULL_SIGMAS = 20.0
WARN_SIGMAS = 3.0

VerdictClass: TypeAlias = Literal["pass", "fail", "unsure"]

_RUN_WORDS: dict[str, tuple[str, VerdictClass]] = {
    "verified": ("Verified", "pass"),
    "failed": ("Failed", "fail"),
    "aborted": ("Stopped", "unsure"),
    "fault": ("Device fault", "fail"),
    "error": ("Error", "fail"),
    "running": ("Unfinished", "unsure"),
    "checked": ("Checked only", "unsure"),
}
_VIEW_CLASS: dict[str, VerdictClass] = {
    "verified": "pass",
    "failed": "fail",
    "not measurable": "fail",
}


@dataclass(frozen=True)
class MarginBar:
    """One requirement: value in its unit, and how many sigmas from failing."""

    name: str
    value: str
    sigmas: str
    percent: float
    level: Literal["", "plain", "thin", "broken"]
    binding: bool
    row: str


@dataclass(frozen=True)
class ViewSection:
    """What the page says about one view; pictures are added by the caller."""

    id: str
    features: list[str]
    verdict: str
    verdict_class: VerdictClass
    binding: str
    cause: str
    explanation: str
    check_first: str
    notes: list[str]
    tolerance_line: str
    tolerance_method: str
    tolerance: list[tuple[str, str]]
    sensitivity: list[tuple[str, str]]
    settings: list[tuple[str, str, str]]
    margins: list[MarginBar]
    measured: Measured


@dataclass(frozen=True)
class Page:
    """What the page says."""

    run_id: str
    verdict_word: str
    verdict_class: VerdictClass
    headline: str
    subline: str
    simulated: bool
    facts: list[tuple[str, str]]
    views: list[ViewSection]
    not_covered: list[NotCovered]
    provenance: list[tuple[str, str]]
    notes: list[str] = field(default_factory=list)
    full_sigmas: float = FULL_SIGMAS
    warn_sigmas: float = WARN_SIGMAS

    @property
    def warn_percent(self) -> float:
        """Where the warning tick stands on a bar."""
        return 100 * WARN_SIGMAS / FULL_SIGMAS


def page_of(plan: Plan, run: RunDocument) -> Page:
    """Gather the page from a plan and its run."""
    word, verdict_class = _RUN_WORDS[run.status]
    documents = {view.id: view for view in run.views}
    units = _joint_units(run)
    views = [_section(view, documents.get(view.id), units) for view in plan.views]
    return Page(
        run_id=run.run_id or "",
        verdict_word=word,
        verdict_class=verdict_class,
        headline=_headline(run),
        subline=run.fault or f"task {run.task} on cell {run.cell}",
        simulated=run.simulated,
        facts=_facts(plan, run),
        views=views,
        not_covered=run.not_covered,
        provenance=_provenance(plan, run),
        notes=[*plan.notes, *_rest(run)],
    )


def _rest(run: RunDocument) -> list[str]:
    """What moved and what stood when the run ended early."""
    moving = f"under way as the run ended: {run.may_still_move}"
    stands = f"seen to stand a moment later: {run.stands}"
    told = ((moving, run.may_still_move), (stands, run.stands))
    return [text for text, known in told if known]


def _headline(run: RunDocument) -> str:
    passed = sum(view.status == "verified" for view in run.views)
    features = sum(len(view.features) for view in run.views)
    views = "1 view" if len(run.views) == 1 else f"{len(run.views)} views"
    return f"{passed} of {views} verified, {features} features asked for"


def _facts(plan: Plan, run: RunDocument) -> list[tuple[str, str]]:
    facts = [
        ("run", run.run_id or "not kept"),
        (
            "part",
            _name(plan.part.file) + (f", id {run.part_id}" if run.part_id else ""),
        ),
        ("cell", f"{run.cell}{' (simulated)' if run.simulated else ''}"),
        ("task", run.task),
        ("started", run.started_utc),
        ("finished", run.finished_utc or "not finished"),
        ("plan", f"{plan.status}, seed {plan.seed}"),
        (
            "planning time",
            f"{plan.timing_s.total:.2f} s (load {plan.timing_s.load:.2f} s, visibility "
            f"{plan.timing_s.visibility:.2f} s, optimise {plan.timing_s.optimise:.2f} s)",
        ),
    ]
    facts += [
        (f"accepted calibration: {name}", reason)
        for name, reason in run.accepted_calibration.items()
    ]
    facts += [
        (f"axis {axis}", f"nothing measures it; on the word of {word}")
        for axis, word in run.believed_axes.items()
    ]
    return facts


def _provenance(plan: Plan, run: RunDocument) -> list[tuple[str, str]]:
    rows = [
        ("mvp-cell", run.version),
        (f"part {_name(plan.part.file)}", plan.part.sha256),
        (f"task {_name(plan.task.file)}", plan.task.sha256),
        (f"cell {plan.cell.name}", plan.cell.sha256),
    ]
    if run.inputs is not None:
        rows += [(f"calibration {k}", v) for k, v in run.inputs.calibration.items()]
    rows += [
        (
            f"{device.role} ({device.driver})",
            f"{device.model}, serial {device.serial}, firmware {device.firmware}"
            + (", simulated" if device.simulated else ""),
        )
        for device in run.devices
    ]
    rows += [(f"picture {v.id}", v.sha256) for v in run.views if v.sha256]
    return rows


def _name(file: str) -> str:
    """The last part of a path: a page that is handed on names no folder of ours."""
    return PurePath(file).name


def _section(
    view: PlannedView, document: ViewDocument | None, units: tuple[str, ...]
) -> ViewSection:
    status = "pending" if document is None else document.status
    verification = None if document is None else document.verification
    extra = {} if verification is None else (verification.model_extra or {})
    tolerance = view.tolerance
    return ViewSection(
        id=view.id,
        features=view.features,
        verdict=status,
        verdict_class=_VIEW_CLASS.get(status, "unsure"),
        binding=view.binding.replace("_", " "),
        cause="" if verification is None else verification.cause or "",
        explanation=str(extra.get("explanation") or ""),
        check_first=str(extra.get("check_first") or ""),
        notes=list(view.notes),
        tolerance_line=(
            f"{tolerance.position_mm:.2f} mm, {tolerance.angle_deg:.2f} deg, "
            f"d {1000 * tolerance.d_mm:.0f} um"
        ),
        tolerance_method=tolerance.method,
        tolerance=_tolerance(view),
        sensitivity=[
            (error_text(key), f"-{loss:.2f} sigma")
            for key, loss in view.sensitivity.items()
        ],
        settings=_settings(view, document, units),
        margins=[
            _bar(name, margin, view.binding) for name, margin in view.margins.items()
        ],
        measured=measured_in(verification),
    )


def _bar(name: str, margin: Margin, binding: str) -> MarginBar:
    sigmas = margin.normalised
    if margin.unbounded or margin.value is None:
        value, text, share = "unbounded", "", 1.0
    else:
        value = f"{margin.value:z.2f} {margin.unit}"
        text = "" if sigmas is None else f"{sigmas:z.1f} sigma"
        share = 1.0 if sigmas is None else min(1.0, max(0.0, sigmas / FULL_SIGMAS))
    broken = margin.value is not None and margin.value < 0
    thin = sigmas is not None and sigmas < WARN_SIGMAS
    level: Literal["", "plain", "thin", "broken"] = "plain" if sigmas is None else ""
    return MarginBar(
        name=name.replace("_", " "),
        value=value,
        sigmas=text,
        percent=round(100 * share, 1) if not broken else 100.0,
        level="broken" if broken else "thin" if thin else level,
        binding=name == binding,
        row=margin.row,
    )


def _tolerance(view: PlannedView) -> list[tuple[str, str]]:
    tolerance = view.tolerance
    rows = [
        ("position, any direction", f"{tolerance.position_mm:.2f} mm"),
        ("angle, any axis", f"{tolerance.angle_deg:.2f} deg"),
        ("image distance d", f"{1000 * tolerance.d_mm:.0f} um"),
    ]
    alone = (
        ("position alone", tolerance.position_alone_mm, "mm", 1.0),
        ("angle alone", tolerance.angle_alone_deg, "deg", 1.0),
        ("d alone", tolerance.d_alone_mm, "um", 1000.0),
    )
    rows += [
        (name, f"{scale * value:z.2f} {unit}")
        for name, value, unit, scale in alone
        if value is not None
    ]
    if view.failure_probability is not None:
        chance = chance_text(view.failure_probability)
        rows.append(("chance of failing", chance))
    if view.probability is not None:
        rows += _probability(view.probability)
    return rows


def _probability(found: KeptProbability) -> list[tuple[str, str]]:
    rows = [
        (f"{kind.replace('_', ' ')} holds", kept_text(kept))
        for kind, kept in found.each.items()
        if kept < 1
    ]
    return [
        *rows,
        ("everything holds", kept_text(found.together)),
        ("camera within, in 95 %", spread_text(found.spread)),
    ]


def _joint_units(run: RunDocument) -> tuple[str, ...]:
    """Rad or mm per joint; an arm without a model here turns all its joints."""
    names = [d.model for d in run.devices if d.role == "arm" and d.model in ARM_MODELS]
    return arm_model(names[0]).joint_units if names else ()


def _joints(values: Sequence[float], units: tuple[str, ...]) -> str:
    named = zip_longest(values, units, fillvalue="rad")
    return ", ".join(f"{value:.4f} {unit}" for value, unit in named)


def _settings(
    view: PlannedView, document: ViewDocument | None, units: tuple[str, ...]
) -> list[tuple[str, str, str]]:
    reached = None if document is None else document.reached
    steps = view.lens_steps.model_dump()
    rows = [
        (
            f"{axis} motor",
            f"{asked} steps",
            "–" if reached is None else f"{reached.lens_steps.get(axis)} steps",
        )
        for axis, asked in steps.items()
    ]
    rows += [
        ("f, d, a", f"{view.f_mm:.3f}, {view.d_mm:.4f}, {view.a_mm:.4f} mm", ""),
        ("pupil in part frame", _vector(view.position_mm) + " mm", ""),
        ("viewing direction", _vector(view.view_direction, digits=4), ""),
        (
            "roll",
            f"{view.roll_rad:z.4f} rad ({math.degrees(view.roll_rad):z.1f} deg)",
            "",
        ),
    ]
    arrived = "–" if reached is None else _joints(reached.joints, units)
    rows.append(("joints", _joints(view.joints_rad, units), arrived))
    exposure = None if document is None else document.exposure_s
    asked_exposure = (
        f"{1000 * view.exposure_s:.2f} ms" if view.exposure_s else "metered"
    )
    used = "–" if exposure is None else f"{1000 * exposure:.2f} ms"
    rows.append(("exposure", asked_exposure, used))
    if document is not None and document.stillness is not None:
        rows.append(_stillness(document.stillness))
    return rows


def _stillness(found: Stillness) -> tuple[str, str, str]:
    shift = "nothing in it would show it"
    if found.shift_px is not None:
        shift = f"{found.shift_px:.2f} px in {found.apart_s:.2f} s"
    return "picture moved between two frames", f"within {found.within_px:.2f} px", shift


def _vector(values: tuple[float, float, float], *, digits: int = 2) -> str:
    return ", ".join(f"{value:z.{digits}f}" for value in values)
