"""What every result of a session says about where it comes from."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mvp.calibrated import Provenance, Validity
from mvp.calibrated.content import inputs_sha256
from mvp.cell.calibration_gates import WIZARDS

if TYPE_CHECKING:
    from calibration.wizard.session_store import SessionStore
    from mvp.wizard import SessionFacts


def provenance_of(store: SessionStore, role: str, method: str) -> Provenance:
    """Where a result of this session comes from."""
    facts = store.facts
    made = {key: name for name, key in WIZARDS.items()}[facts.key]
    return Provenance(
        date=facts.date,
        device_serial=facts.serials.get(role, ""),
        method=method,
        simulated=facts.simulated,
        input_sha256=store.sha256(),
        temperature_c=facts.temperature_c,
        origin="measured",
        serial_numbers=facts.serials,
        built_on=inputs_sha256(made, facts.camera, facts.lens_table, facts.hand_eye),
    )


def validity_of(facts: SessionFacts, range_k: float = 5.0) -> Validity:
    """So far above and below the temperature of the session, where it is known."""
    if facts.temperature_c is None:
        return Validity()
    return Validity(
        temperature_min_c=facts.temperature_c - range_k,
        temperature_max_c=facts.temperature_c + range_k,
    )
