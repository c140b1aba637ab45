"""What comes out of a session: the file in place, the document, the report."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any

from pydantic import JsonValue, TypeAdapter, ValidationError

from mvp.cell.calibrate_document import CalibrateDocument
from mvp.cell.calibrate_folders import (
    REPORT_FILE,
    RESULT_FILE,
    existing_session,
    put_in_place,
)
from mvp.cell.durable import write_durably
from mvp.errors import RecordError
from mvp.wizard import Outcome, Store, Wizard, load_wizard

if TYPE_CHECKING:
    from pathlib import Path

    from mvp.fileedge import FileModel

_LOG = logging.getLogger(__name__)


def recompute(key: str, folder: Path) -> CalibrateDocument:
    """The result of a stored session, from its files alone; nothing is put in place.

    A report that is there already is drawn anew only where the numbers are others.

    Raises:
        RecordError: not a session of this wizard, damaged, or changed.
        CalibrationError: there is nothing to compute from.
    """
    wizard = load_wizard(key)
    store = wizard.sessions.open(existing_session(folder))
    check_key(store, key)
    outcome = wizard.outcome(store)
    document = _document(store, outcome)
    stored = _stored_document(store.path / RESULT_FILE)
    if stored is not None:
        same = _numbers(stored) == _numbers(document)
        document = document.model_copy(update={"same_numbers": same})
    report = store.path / REPORT_FILE
    if document.same_numbers and report.is_file():
        return document.model_copy(update={"report": str(report)})
    return _drawn(wizard, store, outcome, document)


def check_key(store: Store, key: str) -> None:
    """Refuse a session of another wizard.

    Raises:
        RecordError: it is.
    """
    if store.facts.key != key:
        raise RecordError(
            f"{store.path}: a session of `calibrate {store.facts.key}`, not of "
            f"`calibrate {key}`",
            hint=f"say `mvp-cell calibrate {store.facts.key} CELL --session DIR`",
            where=str(store.path),
        )


def keep_result(place: Path, store: Store, outcome: Outcome) -> CalibrateDocument:
    """Put the result in place unless it is a NO-GO, and write what was found.

    Raises:
        OutputError: the disk does not take it.
    """
    document = _document(store, outcome)
    if outcome.document is not None and outcome.quality.verdict != "no-go":
        text = outcome.document.model_dump_json(by_alias=True, indent=1) + "\n"
        kept = put_in_place(place, text.encode())
        document = document.model_copy(
            update={"placed": str(place), "kept": str(kept) if kept else None}
        )
    _write_result(store, document)
    return document


def _write_result(store: Store, document: CalibrateDocument) -> None:
    text = document.model_dump_json(by_alias=True, indent=1) + "\n"
    write_durably(store.path / RESULT_FILE, text.encode())


def _document(store: Store, outcome: Outcome) -> CalibrateDocument:
    return CalibrateDocument(
        key=outcome.key,
        cell=store.facts.cell,
        simulated=store.facts.simulated,
        session=str(store.path),
        verdict=outcome.quality.verdict,
        samples=store.count,
        input_sha256=store.sha256(),
        lines=list(outcome.lines),
        quality=outcome.quality,
        document=_plain(outcome.document),
        comparison=outcome.comparison,
        points=list(outcome.points),
    )


def _plain(document: FileModel | None) -> JsonValue:
    """As it will be read back from its file, to the last digit."""
    if document is None:
        return None
    text = document.model_dump_json(by_alias=True)
    value: JsonValue = TypeAdapter(JsonValue).validate_json(text)
    return value


def _numbers(document: CalibrateDocument) -> JsonValue:
    """What was computed; a later version may say more of where it comes from."""
    if not isinstance(document.document, dict):
        return document.document
    return {k: v for k, v in document.document.items() if k != "provenance"}


def _stored_document(path: Path) -> CalibrateDocument | None:
    try:
        return CalibrateDocument.model_validate_json(path.read_bytes())
    except (OSError, ValidationError):
        return None


def with_page(
    wizard: Wizard[Any], store: Store, outcome: Outcome, document: CalibrateDocument
) -> CalibrateDocument:
    """The document with its report, in the folder, too."""
    drawn = _drawn(wizard, store, outcome, document)
    _write_result(store, drawn)
    return drawn


def _drawn(
    wizard: Wizard[Any], store: Store, outcome: Outcome, document: CalibrateDocument
) -> CalibrateDocument:
    """Draw the report; one that fails never spoils the result."""
    try:
        page = wizard.page(store, outcome)
        if not page:
            return document
        path = store.path / REPORT_FILE
        write_durably(path, page.encode())
    except Exception as error:
        _LOG.debug("no report", exc_info=error)
        why = f"no report: {type(error).__name__}: {error}"
        return document.model_copy(update={"lines": [*document.lines, why]})
    return document.model_copy(update={"report": str(path)})
