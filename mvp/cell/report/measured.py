"""What was measured in one picture, as table rows and lines to draw over it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from mvp.cell.report.overlay import Polyline, Role

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from mvp.cell.run_document import VerificationDocument

Entry: TypeAlias = "Mapping[str, object]"

HEADS = (
    "feature",
    "predicted",
    "measured (± 95 %)",
    "difference",
    "offset (before)",
    "offset (after registration)",
    "visible",
    "blur measured / predicted / allowed",
    "detail / required",
)


_CROSS_PX = np.array([[-6.0, 0.0], [6.0, 0.0], [0.0, 0.0], [0.0, -6.0], [0.0, 6.0]])


@dataclass(frozen=True)
class Shown:
    """The lines of one feature, and what its close-up is called."""

    lines: list[Polyline]
    caption: str


@dataclass(frozen=True)
class Measured:
    """Rows of the table, notes below it, lines over the picture."""

    rows: list[list[str]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    shown: list[Shown] = field(default_factory=list)
    heads: tuple[str, ...] = HEADS


def measured_in(document: VerificationDocument | None) -> Measured:
    """Read a verification; empty when the picture was not verified."""
    if document is None:
        return Measured()
    extra: Mapping[str, object] = document.model_extra or {}
    entries = [*document.edges, *_entries(extra.get("holes"))]
    shown = [_edge_lines(entry) for entry in document.edges]
    shown += [_rim_lines(entry) for entry in _entries(extra.get("holes"))]
    points = _entries(extra.get("points"))
    shown += [_point_marks(entry) for entry in points]
    return Measured(
        rows=[*map(_row, entries), *map(_point_row, points)],
        notes=_notes(document, extra, entries),
        shown=[item for item in shown if item.lines],
    )


def _row(entry: Entry) -> list[str]:
    predicted, measured = _number(entry, "predicted_px"), _number(entry, "measured_px")
    spread = _number(entry, "measured_sd_px")
    blur = entry.get("blur")
    blur = blur if isinstance(blur, dict) else {}
    return [
        str(entry.get("name") or entry.get("feature")),
        _text(predicted, "px"),
        _text(measured, "px") + ("" if spread is None else f" ± {1.96 * spread:.2f}"),
        _difference(predicted, measured),
        _text(_number(entry, "offset_px"), "px")
        + f" (≤ {_text(_number(entry, 'allowed_offset_px'), 'px')})",
        _text(_number(entry, "offset_after_px"), "px"),
        _text(_number(entry, "visible_fraction"), "%", scale=100, digits=0),
        " / ".join(
            _text(_number(blur, key), "px")
            for key in ("measured_px", "predicted_px", "c_px")
        ),
        f"{_text(_number(entry, 'detail_px'), 'px')} / "
        f"{_text(_number(entry, 'required_px'), 'px')}",
    ]


def _point_row(entry: Entry) -> list[str]:
    """A point has a place, not a length."""
    predicted, measured = entry.get("predicted_px"), entry.get("measured_px")
    spread = _number(entry, "measured_sd_px")
    return [
        str(entry.get("feature")),
        f"at {_place(predicted)}",
        f"at {_place(measured)}"
        + ("" if spread is None else f" ± {1.96 * spread:.2f}"),
        "–",
        _text(_number(entry, "offset_px"), "px")
        + f" (≤ {_text(_number(entry, 'allowed_offset_px'), 'px')})",
        *["–"] * (len(HEADS) - 5),
    ]


def _place(value: object) -> str:
    if not isinstance(value, list | tuple) or len(value) != 2:
        return "–"
    return f"{float(value[0]):z.2f}, {float(value[1]):z.2f} px"


def _point_marks(entry: Entry) -> Shown:
    name, lines = str(entry.get("feature")), []
    roles: tuple[tuple[str, Role], ...] = (
        ("predicted_px", "predicted"),
        ("measured_px", "measured"),
    )
    for key, role in roles:
        place = entry.get(key)
        if isinstance(place, list | tuple) and len(place) == 2:
            cross = np.array(place, dtype=np.float64) + _CROSS_PX
            lines.append(Polyline(cross, role, f"{name}, {role}"))
    found = "not measured" if entry.get("measured_px") is None else "measured"
    return Shown(lines, f"{name}: {found}")


def _difference(predicted: float | None, measured: float | None) -> str:
    if predicted is None or measured is None:
        return "–"
    return f"{measured - predicted:+.2f} px"


def _notes(
    document: VerificationDocument, extra: Entry, entries: Sequence[Entry]
) -> list[str]:
    lines = _strings(extra.get("notes"))
    for entry in entries:
        for note in _strings(entry.get("notes")):
            lines.append(f"{entry.get('name') or entry.get('feature')}: {note}")
    blur = document.blur
    if _number(blur, "measured_px") is not None:
        lines.append(
            f"Blur over all features: {_text(_number(blur, 'measured_px'), 'px')} "
            f"(95 %: {_text(_number(blur, 'low_px'), 'px')} to "
            f"{_text(_number(blur, 'high_px'), 'px')}), predicted "
            f"{_text(_number(blur, 'predicted_px'), 'px')}, allowed "
            f"{_text(_number(blur, 'c_px'), 'px')}."
        )
    return lines + _registration(extra.get("registration"))


def _registration(value: object) -> list[str]:
    if not isinstance(value, dict):
        return []
    shift = value.get("shift_px")
    x, y = shift if isinstance(shift, list | tuple) else (0.0, 0.0)
    return [
        f"The picture lies {float(x):+.2f}, {float(y):+.2f} px from the plan, turned by "
        f"{_text(_number(value, 'roll_deg'), 'deg', digits=3)}, scaled by "
        f"{_text(_number(value, 'scale'), '', digits=5)}; found "
        f"{_text(_number(value, 'found_before'), '%', scale=100, digits=0)} of the "
        "expected edges before and "
        f"{_text(_number(value, 'found_after'), '%', scale=100, digits=0)} after "
        "registration."
    ]


def _edge_lines(entry: Entry) -> Shown:
    name = str(entry.get("name") or entry.get("feature"))
    predicted = _points(entry, "predicted_start_px", "predicted_end_px")
    measured = _points(entry, "start_px", "end_px")
    lines = []
    if predicted is not None:
        lines.append(Polyline(predicted, "predicted", f"{name}, predicted"))
    if measured is not None:
        lines.append(Polyline(measured, "measured", f"{name}, measured"))
    return Shown(lines, _caption(name, entry))


def _rim_lines(entry: Entry) -> Shown:
    name = str(entry.get("name") or entry.get("feature"))
    lines = []
    for key, role in (("predicted_rim_px", "predicted"), ("rim_px", "measured")):
        points = entry.get(key)
        if isinstance(points, list | tuple) and len(points) > 2:
            array = np.array(points, dtype=np.float64)
            is_prediction = role == "predicted"
            lines.append(
                Polyline(
                    array,
                    "predicted" if is_prediction else "measured",
                    f"{name}, {role}",
                    closed=True,
                )
            )
    return Shown(lines, _caption(name, entry))


def _caption(name: str, entry: Entry) -> str:
    measured = _number(entry, "measured_px")
    found = "not measured" if measured is None else f"measured {measured:z.2f} px"
    return f"{name}: {found}, predicted {_text(_number(entry, 'predicted_px'), 'px')}"


def _entries(value: object) -> list[dict[str, object]]:
    if not isinstance(value, list | tuple):
        return []
    return [item for item in value if isinstance(item, dict)]


def _strings(value: object) -> list[str]:
    return [str(item) for item in value] if isinstance(value, list | tuple) else []


def _number(entry: Entry, key: str) -> float | None:
    value = entry.get(key)
    return float(value) if isinstance(value, int | float) else None


def _points(entry: Entry, first: str, last: str) -> np.ndarray | None:
    ends = [entry.get(first), entry.get(last)]
    if not all(isinstance(end, list | tuple) and len(end) == 2 for end in ends):
        return None
    return np.array(ends, dtype=np.float64)


def _text(
    value: float | None, unit: str, *, scale: float = 1.0, digits: int = 2
) -> str:
    if value is None:
        return "–"
    return f"{scale * value:z.{digits}f} {unit}".rstrip()
