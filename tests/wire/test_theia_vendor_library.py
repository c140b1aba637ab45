"""The vendor's own library drives the simulated board: a check none of us wrote."""

from __future__ import annotations

import json
import subprocess
import sys
from importlib.util import find_spec

import pytest

from drivers.simulators.control import ControlClient
from drivers.simulators.theia import TheiaConfig, TheiaSimulator
from mvp.devices import DeviceContext

# In a process of its own: the library puts itself into the interpreter's error hook.
_SCRIPT = """
import json, sys
import TheiaMCR
board = TheiaMCR.MCRControl(sys.argv[1], logFiles=False)
found = {
    "firmware": board.MCRBoard.readFWRevision(),
    "serial": board.MCRBoard.readBoardSN(),
    "homed": [board.focusInit(8390, 7959), board.zoomInit(3227, 3119)],
    "iris": board.irisInit(75),
}
board.focus.moveAbs(4000)
board.focus.moveRel(500)
board.focus.moveRel(-800)
board.zoom.moveAbs(1000)
board.iris.moveRel(20)
found["steps"] = [board.zoom.currentStep, board.focus.currentStep, board.iris.currentStep]
print("FOUND", json.dumps(found))
board.close()
"""


@pytest.mark.skipif(
    find_spec("TheiaMCR") is None, reason="the vendor's library TheiaMCR is missing"
)
def test_the_vendors_library_homes_and_moves_the_simulated_lens() -> None:
    config = TheiaConfig(speed_scale=20)
    simulator = TheiaSimulator.from_config(config, DeviceContext(), name="lens")
    port = str(simulator.start()["port"])
    try:
        done = subprocess.run(
            [sys.executable, "-c", _SCRIPT, port],
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
        with ControlClient(simulator.control_port) as control:
            places = control.do("state")["places"]
    finally:
        simulator.stop()
    assert done.returncode == 0, done.stderr
    line = next(x for x in done.stdout.splitlines() if x.startswith("FOUND"))
    found = json.loads(line.removeprefix("FOUND "))
    assert found["firmware"] == "5.3.0.0.0"
    assert found["serial"] == "055-001234"
    assert found["homed"] == [True, True]
    assert found["steps"] == [1000, 3700, 20]
    assert places == {"zoom": 1000.0, "focus": 3700.0, "iris": 20.0}
