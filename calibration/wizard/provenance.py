"""What every result of a session says about where it comes from."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mvp.calibrated import Provenance, TemperatureSource, Validity
from mvp.calibrated.content import inputs_sha256
from mvp.cell.calibration_gates import WIZARDS

if TYPE_CHECKING:
    from calibration.wizard.session_store import SessionStore

TEMPERATURE = "temperature_c"  # what the operator said, in a session


def provenance_of(store: SessionStore, role: str, method: str) -> Provenance:
    """Where a result of this session comes from."""
    facts = store.facts
    warmth, source = temperature_of(store)
    made = {key: name for name, key in WIZARDS.items()}[facts.key]
    return Provenance(
        date=facts.date,
        device_serial=facts.serials.get(role, ""),
        method=method,
        simulated=facts.simulated,
        input_sha256=store.sha256(),
        temperature_c=warmth,
        temperature_source=source,
        origin="measured",
        serial_numbers=facts.serials,
        built_on=inputs_sha256(made, facts.camera, facts.lens_table, facts.hand_eye),
    )


def temperature_of(store: SessionStore) -> tuple[float | None, TemperatureSource]:
    """How warm it was, and who knew: the cell file, a device or the operator."""
    facts, told = store.facts, store.recall(TEMPERATURE)
    if facts.temperature_c is not None:
        return facts.temperature_c, facts.temperature_source or "device"
    if isinstance(told, float | int) and not isinstance(told, bool):
        return float(told), "operator"
    return None, "unknown"


def validity_of(store: SessionStore, range_k: float = 5.0) -> Validity:
    """So far above and below the temperature of the session, where it is known."""
    warmth, _ = temperature_of(store)
    if warmth is None:
        return Validity()
    return Validity(
        temperature_min_c=warmth - range_k, temperature_max_c=warmth + range_k
    )
