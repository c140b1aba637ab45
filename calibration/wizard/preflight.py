"""What a person looks to before the first picture: warm-up, target, temperature.

Answers are kept with the session: a result says under which conditions it was made.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from calibration.wizard.caliper import size_told
from calibration.wizard.provenance import TEMPERATURE
from mvp.wizard import Ask, Say, Wait, Word

if TYPE_CHECKING:
    from collections.abc import Generator

    from calibration.wizard.session_store import SessionStore
    from mvp.wizard import Answer, Step

WARM, FLAT = "warm_minutes", "target_flat"
_UNKNOWN = "unknown"
_UNIT = re.compile(r"\s*(\N{DEGREE SIGN}|deg)?\s*C$", re.IGNORECASE)
_COLD_C, _HOT_C = -40.0, 90.0
WARM_MINUTES = 30.0  # after which a camera's sensor and mount hardly move any more


def before_pictures(store: SessionStore) -> Generator[Step, Answer, None]:
    """Asked once in a session; a resumed one goes on without."""
    yield from _warm(store)
    yield from _flat(store)
    yield from size_told(store)


def temperature_told(store: SessionStore) -> Generator[Step, Answer, None]:
    """From cell file or device, else from the operator, else unknown, which is said."""
    if store.facts.temperature_c is not None or store.recall(TEMPERATURE) is not None:
        return
    value = yield from _celsius_asked()
    store.remember(TEMPERATURE, _UNKNOWN if value is None else value)
    if value is None:
        yield Say(
            "the temperature is unknown: a later change of it cannot be noticed; state "
            "temperature_c in [conditions] of the cell file",
            "warning",
        )


def _celsius_asked() -> Generator[Step, Answer, float | None]:
    """Until it is a temperature, or nobody knows it: None."""
    while True:
        told = yield Ask(
            TEMPERATURE,
            "temperature at lens and camera in deg C, or unknown",
            "text",
            _UNKNOWN,
        )
        try:
            return _celsius(told)
        except ValueError as error:
            yield Say(f"{error}; once more", "warning")


def _celsius(told: Answer) -> float | None:
    """What was typed, with or without its unit; None: nobody knows.

    Raises:
        ValueError: no temperature that a camera could have.
    """
    if isinstance(told, Word):
        raise ValueError("there is nothing to take back or to finish yet")
    text = str("" if told is None else told).strip()
    if text.lower() in ("", _UNKNOWN):
        return None
    try:
        value = float(_UNIT.sub("", text).replace(",", "."))
    except ValueError:
        raise ValueError(f"{text} is not a number of degrees Celsius") from None
    if not _COLD_C < value < _HOT_C:
        raise ValueError(f"{text} is not between {_COLD_C:.0f} and {_HOT_C:.0f} deg C")
    return value


def _warm(store: SessionStore) -> Generator[Step, Answer, None]:
    """A camera that was switched on just now is waited for, if the person agrees."""
    if store.recall(WARM) is not None:
        return
    said = yield Ask(
        WARM,
        "for how many minutes have camera and arm been switched on?",
        "number",
        WARM_MINUTES,
        "min",
    )
    minutes = WARM_MINUTES if isinstance(said, Word | bool) else float(said or 0.0)
    lacking = WARM_MINUTES - minutes
    if lacking > 0:
        wait = yield Ask(
            "warm_up_now",
            f"the picture moves while they warm up; wait {lacking:.0f} minutes now?",
            default=True,
        )
        if wait is True:
            yield Wait("warming up", 60 * lacking)
            minutes = WARM_MINUTES
        else:
            yield Say(
                "camera and arm are not warm: pictures taken first and last may "
                "contradict each other",
                "warning",
            )
    store.remember(WARM, minutes)


def _flat(store: SessionStore) -> Generator[Step, Answer, None]:
    """Of a target that is bent or moves the residuals tell only a part."""
    if store.recall(FLAT) is not None:
        return
    said = yield Ask(
        FLAT,
        "does the target lie fast, and is it flat (on glass or a plate, no bubble)?",
        default=True,
    )
    flat = said is not False
    store.remember(FLAT, flat)
    if not flat:
        yield Say(
            "glue it to glass or to a plate, and fix that: 0.02 mm out of flat are "
            "0.03 % of the focal length, and of all distances",
            "warning",
        )
