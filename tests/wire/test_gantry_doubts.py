"""What about a machine somebody should look at: its settings, and a stop that waits."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from mvp.devices import HasDoubts, cannot_stop
from tests.wire.conftest import GRBL_AXES, TURN

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

    Make = Callable[..., Any]

CALM = {"speed": 100, "acceleration": 400}
AXES = [
    *({**axis, **CALM} for axis in GRBL_AXES),
    *({"letter": x, **TURN, "speed": 80, "acceleration": 250} for x in "AB"),
]
GOOD = {"21": "1"}
BAD = {
    "motors": {"1": "25"},
    "soft limits": {"20": "0"},
    "hard limits": {"21": "0"},
    "X rate": {"110": "5999.0"},
    "B rate": {"114": "300"},
    "Z acceleration": {"122": "399.9"},
    "Y travel": {"131": "150.000"},
}


def doubts(bench: Any) -> dict[str, str]:
    arm = bench.arm(axes=AXES)
    arm.open()
    assert isinstance(arm, HasDoubts)
    assert b"$1" not in bench.sent  # nothing is ever written
    assert all(one.level == "warning" and one.hint for one in arm.doubts())
    return {one.name: one.detail for one in arm.doubts()}


def test_a_machine_that_is_set_well_has_none(gantry_bench: Make) -> None:
    assert doubts(gantry_bench("grblhal", settings=GOOD)) == {}


@pytest.mark.parametrize("name", BAD)
def test_a_setting_that_is_not_as_a_camera_needs_it(
    gantry_bench: Make, name: str, caplog: pytest.LogCaptureFixture
) -> None:
    (number, value), *_ = BAD[name].items()
    found = doubts(gantry_bench("grblhal", settings={**GOOD, **BAD[name]}))
    assert list(found) == [name]
    assert f"${number}={float(value):g}" in found[name]
    assert f"arm: {name}: " in caplog.text


@pytest.mark.parametrize(
    ("idle", "held", "said"),
    [
        ("25", "0", "they are let go 25 ms"),
        ("25", "7", "those of A, B are let go 25 ms"),
        ("25", "31", ""),
        ("0", "31", "they are let go 0 ms"),
        ("255", "0", ""),
    ],
)
def test_motors_that_the_machine_holds_at_rest_are_no_doubt(
    gantry_bench: Make, idle: str, held: str, said: str
) -> None:
    settings = {**GOOD, "1": idle, "37": held}
    found = doubts(gantry_bench("grblhal", settings=settings))
    assert bool(found) is bool(said)
    assert said in found.get("motors", "")


def test_what_a_firmware_does_not_list_is_not_judged(gantry_bench: Make) -> None:
    settings = {"1": "25", "20": "0", "110": "300"}
    found = doubts(gantry_bench("fluidnc", settings=settings))
    assert list(found) == ["soft limits"]


@pytest.mark.parametrize("parser", [True, False])
def test_a_marlin_that_cannot_stop_at_once_says_so(
    gantry_bench: Make, parser: bool
) -> None:
    arm = gantry_bench("marlin", emergency_parser=parser).arm()
    arm.open()
    info = arm.info()
    assert info.extra["can_stop"].startswith("yes" if parser else "no: ")
    assert ("emergency parser" in cannot_stop(info)) is not parser
    assert arm.doubts() == ()


def test_a_grbl_stops_at_once(gantry_bench: Make) -> None:
    arm = gantry_bench("grblhal").arm()
    arm.open()
    assert arm.info().extra["can_stop"] == "yes"
    assert cannot_stop(arm.info()) == ""
