"""What the folder of a session adds to a report: pictures, facts, the result before."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibration.report.model import About, LeftOut, Photo
from calibration.wizard.before import compared_with_before
from calibration.wizard.provenance import temperature_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibration.wizard.session_store import Sample, SessionStore
    from mvp.fileedge import FileModel
    from mvp.wizard import SessionFacts

_WHITE = 255
_KNOWN_BY = {
    "cell-file": "as the cell file says",
    "device": "as a device measured",
    "operator": "as the operator said",
}


def about_session(
    store: SessionStore,
    document: FileModel | None,
    *,
    distance_mm: float,
    point_part_mm: Sequence[float] = (0.0, 0.0, 0.0),
) -> About:
    """Everything about a session that its estimator does not know.

    Args:
        store: the session.
        document: the new result, to be compared with the one that the cell had; None:
            there is none.
        distance_mm: working distance from the entrance pupil.
        point_part_mm: where poses of a part are compared.

    Raises:
        RecordError: a picture is missing or damaged.
    """
    facts, samples = store.facts, store.samples
    return About(
        _subject(facts),
        facts.simulated,
        _facts(store),
        tuple(_photo(store, sample) for sample in samples if sample.usable),
        tuple(LeftOut(s.name, s.reason, s.action) for s in samples if not s.usable),
        compared_with_before(
            facts, document, distance_mm=distance_mm, point_part_mm=point_part_mm
        ),
        (
            ("session", store.path.name),
            ("input sha256", store.sha256()),
            ("seed", str(facts.seed)),
        ),
    )


def _subject(facts: SessionFacts) -> str:
    role = {"camera": "camera", "lens": "lens", "hand-eye": "arm"}.get(facts.key, "")
    serial = facts.serials.get(role, "")
    return f"{role} {serial} of cell {facts.cell}" if serial else f"cell {facts.cell}"


def _facts(store: SessionStore) -> tuple[tuple[str, str], ...]:
    facts, samples = store.facts, store.samples
    used = sum(sample.usable for sample in samples)
    rows = [
        ("date", facts.date),
        ("pictures", f"{used} used, {len(samples) - used} not used"),
        ("arm", facts.arm_model),
    ]
    rows += [(f"serial of the {role}", text) for role, text in facts.serials.items()]
    rows.append(("temperature", _warmth(store)))
    target = facts.target
    if target is not None:
        rows.append(
            (
                "target",
                f"{target.kind} {target.columns} x {target.rows}, square "
                f"{target.square_mm:.4g} ± {target.square_sigma_mm:.2g} mm",
            )
        )
    steps = sorted({tuple(sorted(s.lens_steps.items())) for s in samples if s.usable})
    if len(steps) == 1:
        words = ", ".join(f"{name} {step}" for name, step in steps[0])
        rows.append(("lens setting", words))
    elif steps:
        rows.append(("lens settings", f"{len(steps)} different ones"))
    return tuple(rows)


def _warmth(store: SessionStore) -> str:
    warmth, source = temperature_of(store)
    if warmth is None:
        return "not known"
    return f"{warmth:.1f} deg C ({_KNOWN_BY.get(source, source)})"


def _photo(store: SessionStore, sample: Sample) -> Photo:
    pixels = store.image(sample)
    grey = np.asarray(pixels, np.float64) * (_WHITE / max(sample.full_scale, 1))
    flat = grey if grey.ndim == 2 else grey.mean(axis=2)
    shown = np.clip(flat, 0, _WHITE).astype(np.uint8)
    return Photo(sample.name, shown, sample.found_pixels, sample.image)
