"""How large the target's squares truly are: asked once, kept beside the cell.

All lengths found with a target are wrong by as much as its squares are; what a printer
makes of a page no residual shows. Intrinsics do not depend on it; sharp distances,
hand-eye and the error stated for them do.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from calibration.targets import caliper
from calibration.wizard.session_store import TARGET_SIZE
from mvp.calibrated import MeasuredTarget
from mvp.wizard import Ask, Say

if TYPE_CHECKING:
    from collections.abc import Generator

    from calibration.wizard.session_store import SessionStore
    from mvp.wizard import Answer, Step, TargetFacts

SQUARES, READINGS = "caliper_squares", "caliper_readings_mm"
_NEAR = 0.1


def size_told(store: SessionStore) -> Generator[Step, Answer, None]:
    """Ask for readings where the size was never measured; nobody has to have any."""
    target = store.facts.target
    if target is None:
        return
    if target.measured is None and store.recall(TARGET_SIZE) is None:
        found = yield from _asked(target, store.facts.date)
        told = False if found is None else found.model_dump(mode="json", by_alias=True)
        store.remember(TARGET_SIZE, told)
    yield Say(_words(store.facts.target or target))


def _asked(
    target: TargetFacts, date: str
) -> Generator[Step, Answer, MeasuredTarget | None]:
    """None when nobody measured; [target] counts then, as it does unattended."""
    while True:
        squares = yield Ask(
            SQUARES,
            "measure the print with a caliper, over as many squares as it reaches; how "
            "many are that (0: not measured, the size in the cell file counts)?",
            "number",
            0.0,
        )
        if not isinstance(squares, float | int) or squares < 1:
            return None
        readings = yield Ask(
            READINGS,
            f"what does it show over {squares:.0f} squares, at two places or more along "
            "and across, in mm (with blanks between)?",
            "text",
            "",
        )
        if not isinstance(readings, str) or not readings.strip():
            return None
        try:
            return _measured(target, date, int(squares), readings)
        except ValueError as error:
            yield Say(f"{error}; once more", "warning")


def _measured(
    target: TargetFacts, date: str, squares: int, readings: str
) -> MeasuredTarget:
    """The size from readings as they were typed.

    Raises:
        ValueError: not lengths, too different, or not those of this target.
    """
    words = re.split(r"[;\s]+", readings.strip())
    lengths = [float(word.replace(",", ".")) for word in words]
    size = caliper(lengths, across=squares)
    if abs(size.mm / target.square_mm - 1) > _NEAR:
        raise ValueError(
            f"{size.mm:.4g} mm a square is far from the {target.square_mm:g} mm of the "
            "cell file: were that so many squares?"
        )
    return MeasuredTarget(
        date=date,
        kind=target.kind,
        columns=target.columns,
        rows=target.rows,
        stated_mm=target.square_mm,
        readings_mm=lengths,
        squares=squares,
        square_mm=size.mm,
        square_sigma_mm=size.sigma_mm,
    )


def _words(target: TargetFacts) -> str:
    share = 100 * target.square_sigma_mm / target.square_mm
    size = (
        f"squares of {target.square_mm:.4f} mm, one sigma {target.square_sigma_mm:.4f} mm "
        f"({share:.2f} % of all lengths)"
    )
    if target.measured is None:
        return f"{size}, as [target] of the cell file says"
    return f"{size}, by caliper on {target.measured.date}"
