"""The page of a lens session."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, cast

from calibration.lens_table import LensTables
from calibration.report import (
    about_session,
    lens_report,
    refused_report,
    render_report,
)
from calibration.wizard.lens_work import working_mm
from calibration.wizard.verification import Verification
from mvp.errors import CalibrationError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibration.camera import CameraEstimate
    from calibration.observations import Observations
    from calibration.wizard.session_store import SessionStore
    from mvp.wizard import Outcome

    Pictures = Sequence[tuple[CameraEstimate, Observations]]


def page_of(store: SessionStore, outcome: Outcome) -> str:
    """The report of a result, or of what is missing for one."""
    facts = store.facts
    tables = outcome.details.get("tables")
    if not isinstance(tables, LensTables):
        raise TypeError("not the outcome of a lens session")
    distance = working_mm(facts, tables)
    about = about_session(store, outcome.document, distance_mm=distance)
    if tables.table is None:
        why = CalibrationError(
            "; ".join(outcome.quality.reasons), hint=outcome.quality.next_action
        )
        return render_report(refused_report("lens", why, about))
    held = outcome.details.get("verification")
    pictures = cast("Pictures", outcome.details.get("pictures", ()))
    data = lens_report(
        tables,
        about,
        sensor=facts.sensor,
        distance_mm=distance,
        pictures=pictures,
        more_causes=held.causes() if isinstance(held, Verification) else (),
    )
    words = (held.words,) if isinstance(held, Verification) else ()
    warnings = cast("Sequence[str]", outcome.details.get("warnings", ()))
    return render_report(replace(data, notes=(*data.notes, *words, *warnings)))
