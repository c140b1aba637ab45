"""Plans and runs as tables for people."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mvp.cli.output import console

if TYPE_CHECKING:
    from collections.abc import Mapping

    from mvp.cell.run_document import RunDocument, ViewDocument
    from mvp.planning.plan import Margin, Plan, PlannedView

_MOST_LENGTHS = 6
_COLOURS = {
    "admissible": "green",
    "verified": "green",
    "checked": "green",
    "partial": "yellow",
    "not measurable": "yellow",
}


def print_plan(plan: Plan) -> None:
    """Views with margins, then what is not covered and why."""
    from rich.table import Table

    lines = console()
    colour = _COLOURS.get(plan.status, "red")
    lines.print(f"plan: [{colour}]{plan.status}[/] in {plan.timing_s.total:.1f} s")
    for note in plan.notes:
        lines.print(f"  {note}", markup=False)
    for view in plan.views:
        lines.print(_view_line(view), markup=False)
        table = Table(
            "requirement", "margin", "sigmas", "holds", "about", pad_edge=False
        )
        for kind, margin in view.margins.items():
            name = kind.replace("_", " ")
            mark = " <- binding" if kind == view.binding else ""
            table.add_row(
                name + mark,
                _value(margin),
                _sigmas(margin),
                _kept(view, kind),
                margin.row,
            )
        lines.print(table)
        for text in (
            _tolerance(view),
            *_probability(view),
            *_contrast(view),
            *view.notes,
        ):
            lines.print(f"  {text}", markup=False)
    for missing in plan.not_covered:
        lines.print(f"not covered: {missing.feature}", style="bold red", markup=False)
        lines.print(f"  why: {missing.reason}", markup=False)
        lines.print(f"  fix: {missing.fix}", markup=False)


def print_run(document: RunDocument) -> None:
    """Verdict first, then every view."""
    from rich.table import Table

    lines = console()
    table = Table(
        "view", "features", "verdict", "cause", "lengths, px (plan / picture)"
    )
    for view in document.views:
        colour = _COLOURS.get(view.status, "red")
        table.add_row(
            view.id,
            ", ".join(view.features),
            f"[{colour}]{view.status}[/]",
            _cause(view),
            _lengths(view),
        )
    lines.print(table)
    colour = _COLOURS.get(document.status, "red")
    lines.print(
        f"run {document.run_id or '(nothing kept)'}: [{colour}]{document.status}[/]"
    )
    if document.folder:
        lines.print(f"kept in {document.folder}", markup=False)
    tell_believed(document.believed_axes)


def tell_believed(believed_axes: Mapping[str, str]) -> None:
    """Axes that nothing measures, and by whose word they are where they are."""
    for axis, word in believed_axes.items():
        console().print(f"axis {axis}: on the word of {word}", markup=False)


def _view_line(view: PlannedView) -> str:
    x, y, z = view.position_mm
    return (
        f"{view.id}: {', '.join(view.features)}; pupil at ({x:z.1f}, {y:z.1f}, {z:z.1f}) mm, "
        f"f {view.f_mm:.3f}, d {view.d_mm:.3f}, a {view.a_mm:.3f} mm "
        f"(zoom {view.lens_steps.zoom}, focus {view.lens_steps.focus}, "
        f"iris {view.lens_steps.iris} steps)"
    )


def _tolerance(view: PlannedView) -> str:
    t = view.tolerance
    text = (
        f"tolerance ({t.method}): {t.position_mm:.2f} mm, {t.angle_deg:.2f} deg and "
        f"{t.d_mm * 1000:.0f} um of d, all at once"
    )
    if view.failure_probability is not None:
        from mvp.cell.wording import chance_text

        text += f"; chance of failing {chance_text(view.failure_probability)}"
    return text


def _probability(view: PlannedView) -> list[str]:
    if view.probability is None:
        return []
    from mvp.cell.wording import probability_lines

    return probability_lines(view.probability)


def _kept(view: PlannedView, kind: str) -> str:
    if view.probability is None or kind not in view.probability.each:
        return ""
    from mvp.cell.wording import kept_text

    return kept_text(view.probability.each[kind])


def _contrast(view: PlannedView) -> list[str]:
    """Predicted contrast by feature, the faintest first."""
    if not view.contrast:
        return []
    shown = sorted(view.contrast.items(), key=lambda item: item[1])
    texts = [f"{name} {value:.0%}" for name, value in shown[:_MOST_LENGTHS]]
    more = len(shown) - _MOST_LENGTHS
    texts += [f"and {more} more"] if more > 0 else []
    return [f"contrast at least: {', '.join(texts)}"]


def _value(margin: Margin) -> str:
    if margin.value is None:
        return "unbounded"
    return f"{margin.value:z.2f} {margin.unit}"


def _sigmas(margin: Margin) -> str:
    return "" if margin.normalised is None else f"{margin.normalised:z.1f}"


def _cause(view: ViewDocument) -> str:
    """Cause, how it shows, and what to look at first."""
    if view.verification is None or view.verification.cause is None:
        return ""
    more = view.verification.model_extra or {}
    texts = [view.verification.cause, more.get("explanation"), more.get("check_first")]
    return "\n".join(str(text) for text in texts if text)


def _lengths(view: ViewDocument) -> str:
    if view.verification is None:
        return ""
    texts = []
    for edge in view.verification.edges:
        planned, measured = edge.get("predicted_px"), edge.get("measured_px")
        if isinstance(planned, float):
            shown = f"{measured:z.2f}" if isinstance(measured, float) else "-"
            texts.append(f"{edge.get('feature')}: {planned:z.2f} / {shown}")
    if len(texts) > _MOST_LENGTHS:
        texts[_MOST_LENGTHS:] = [f"and {len(texts) - _MOST_LENGTHS} more"]
    return "\n".join(texts)
