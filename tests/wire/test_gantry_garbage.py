"""Whatever comes over a gantry's wire, only the driver's own errors come out."""

from __future__ import annotations

from contextlib import suppress

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers._gantry.codes import alarm_fault, line_error, loses_home
from drivers._gantry.config import GantryConfig
from drivers._gantry.grbl_identity import (
    error_number,
    identity_of,
    listing,
    refuse_inches,
)
from drivers._gantry.grbl_report import ReportReader
from drivers._gantry.grbl_settings import setting_findings, settings_of
from drivers._gantry.wire import Activity
from mvp.devices import LineFramer, text
from mvp.errors import MvpCellError
from tests.fuzzing import Mutants, at_length, fuzz

AXES = [
    {
        "letter": x,
        "low": -100,
        "high": 0,
        "speed": 10,
        "acceleration": 10,
        "home": "declared" if x in "AB" else "switch",
    }
    for x in "XYZAB"
]
CONFIG = GantryConfig.model_validate(
    {"port": "none", "firmware": "grblhal", "axes": AXES}
)
LISTINGS = [
    b"[VER:1.1f.20240928:Table 3]\r\n[OPT:V,100,1024,5,0]\r\n[AXS:5:XYZAB]\r\nok\r\n",
    b"$1=25\r\n$13=0\r\n$20=1\r\n$110=5000.000\r\n$133=350.000\r\nok\r\n",
    b"<Idle|MPos:-1.000,-1.000,-1.000,0.000,0.000|Bf:100,1023|H:1>\r\n",
    b"<Run|WPos:1.000,2.000,3.000,0.000,0.000|WCO:-10.0,0.0,5.0,0.0,0.0|Pn:XY>\r\n",
    b"error:8\r\n",
    b"ALARM:9\r\n",
]
PIECES = b"ok < > | , : ] [VER: [AXS: [OPT: MPos: WPos: WCO: $13= error: ALARM: XYZAB"
_LINES = st.lists(
    st.one_of(
        st.binary(max_size=60),
        st.from_regex(
            rb"<(Idle|Run|Hold:[01]|Alarm(:[0-9])?|Door:[0-4]|Odd)"
            rb"(\|(MPos|WPos|WCO|H|Bf|Pn|FS):[-0-9.,XYZ]{0,30}){0,5}>\r",
            fullmatch=True,
        ),
        st.from_regex(
            rb"(\[(VER|AXS|OPT):|\$1?3=|error:|ok|ALARM:)[ -~]{0,12}", fullmatch=True
        ),
    ),
    max_size=8,
)


def _read(lines: list[bytes]) -> Activity | None:
    """Everything reads the garbage; what a good report after it says."""
    framer = LineFramer()
    frames = framer.feed(b"\n".join([*lines, b""]))
    reader, accept = ReportReader("XYZAB"), listing("$", "arm")
    for frame in frames:
        report = reader.read(text(frame).strip())
        assert report is None or len(report.machine) == 5
        with suppress(MvpCellError):
            accept(frame)
        number = error_number(text(frame))
        assert alarm_fault(number, "grblhal", "arm").message
        assert line_error(number, "G90", "arm").message
        assert loses_home(number) in (True, False)
    for finding in setting_findings(settings_of(frames), CONFIG.axes, "XYZAB"):
        assert finding.detail
    for understand in (
        lambda: identity_of(frames, CONFIG, "arm"),
        lambda: refuse_inches(frames, "arm"),
    ):
        with suppress(MvpCellError):
            understand()
    good = b"<Run|MPos:1.000,2.000,3.000,4.000,5.000>"
    assert framer.feed(b"\n" + good + b"\n")[-1] == good
    report = reader.read(text(good))
    return report.activity if report else None


@given(_LINES)
@settings(max_examples=200, deadline=None)
def test_garbage(lines: list[bytes]) -> None:
    assert _read(lines) is Activity.MOVES


@at_length
def test_much_garbage() -> None:
    mutants = Mutants(LISTINGS, PIECES.split())

    def check(lines: bytes) -> None:
        assert _read(lines.split(b"\n")) is Activity.MOVES

    fuzz(check, mutants)


def test_reports_of_real_firmware() -> None:
    grbl, hal = ReportReader("XYZ"), ReportReader("XYZAB")
    idle = grbl.read(
        "<Idle|MPos:0.000,0.000,0.000|Bf:15,128|FS:0,0|WCO:0.000,0.000,0.000>"
    )
    run = grbl.read("<Run|MPos:-8.440,0.000,0.000|Bf:14,128|FS:985,0|Ov:100,100,100>")
    homed = hal.read("<Idle|MPos:-1.000,-1.000,-1.000,0.000,0.000|Bf:100,1023|H:1>")
    assert idle is not None
    assert (idle.activity, idle.homed) == (Activity.STANDS, None)
    assert run is not None
    assert (run.activity, run.machine["X"]) == (Activity.MOVES, -8.44)
    assert homed is not None
    assert homed.homed is True


def test_work_positions_need_the_offset_that_came_before() -> None:
    reader = ReportReader("XYZ")
    assert reader.read("<Idle|WPos:1.000,2.000,3.000>") is None
    reader.read("<Idle|WPos:1.000,2.000,3.000|WCO:-10.000,0.000,5.000>")
    report = reader.read("<Idle|WPos:1.000,2.000,3.000|Pn:>")
    assert report is not None
    assert dict(report.machine) == {"X": -9.0, "Y": 2.0, "Z": 8.0}


@pytest.mark.parametrize("state", ["Alarm:1", "Check", "Sleep", "Door:1", "Hold:0"])
def test_states_in_which_nothing_may_move(state: str) -> None:
    report = ReportReader("XYZ").read(f"<{state}|MPos:0.000,0.000,0.000>")
    assert report is not None
    assert report.activity in (Activity.ALARM, Activity.HELD)
