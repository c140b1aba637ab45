"""Calibrations as items of ``mvp-cell check``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from mvp.cell.check_items import CheckItem, doubtful, failed, good

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mvp.cell.calibration_gates import Objection
    from mvp.cell.check_items import CheckDocument
    from mvp.cell.loading import LoadedCell

UNJUDGED: Final = "only being checked"  # in place of a person's reason: nothing refuses
CALIBRATED_DEVICES: Final = "calibrated devices"
_CALIBRATION = "calibration "


def file_items(cell: LoadedCell) -> list[CheckItem]:
    """One item for each calibration, or for each thing that speaks against it."""
    items = []
    for name in cell.calibrations.files:
        model = getattr(cell.calibrations, name)
        said = f"{model.quality.verdict} of {model.provenance.date}"
        own = [one for one in cell.calibrations.objections if one.name == name]
        title = _CALIBRATION + name
        items += [objection_item(title, one, cell.accept_calibration) for one in own]
        items += [] if own else [good(title, said)]
    return items


def objection_item(title: str, objection: Objection, reason: str) -> CheckItem:
    """A failure, unless it only warns or a person took the responsibility."""
    if not objection.refused:
        return doubtful(title, objection.text, objection.fix)
    if not reason or reason == UNJUDGED:
        hint = f"{objection.fix}, or take the responsibility with "
        return failed(title, objection.text, hint + "--accept-calibration REASON")
    return doubtful(title, f"{objection.text}; accepted: {reason}", objection.fix)


def objection_items(objections: Sequence[Objection], reason: str) -> list[CheckItem]:
    """What speaks against the calibrations once the devices have answered.

    At most one failure and one warning, each with everything of its kind.
    """
    items = [objection_item(CALIBRATED_DEVICES, one, reason) for one in objections]
    kinds = [[one for one in items if one.passed is passed] for passed in (False, True)]
    return [
        kind[0].model_copy(
            update={
                "detail": "; ".join(one.detail for one in kind),
                "hint": "; ".join(dict.fromkeys(one.hint for one in kind)),
            }
        )
        for kind in kinds
        if kind
    ]


def only_calibrations_failed(document: CheckDocument) -> bool:
    """Whether a run would be refused for its calibrations and for nothing else."""
    bad = [item.name for item in document.items if not item.passed]
    return bool(bad) and all(
        name.startswith(_CALIBRATION) or name == CALIBRATED_DEVICES for name in bad
    )
