"""Every device met by every fault: the right error in time, no new motion, and back.

What is expected is written down in ``tools/faults/table.py``. About every third cell is
run by default, the slowest left out; every device and every fault has its turn. All of
them run with ``full``.
"""

from __future__ import annotations

import pytest

from tools.faults.table import TABLE
from tools.faults.trial import trial
from tools.faults.words import FAULTS, Case, NoSense

pytest.importorskip("rtde_control", reason="the client library of the UR is missing")

THIRD = 3
SLOW = {
    ("visca", "silent"),
    ("gantry, Marlin", "half frame"),
    ("gantry, Marlin", "alarm"),
    ("visca", "restarted"),
    ("opencv", "slow"),
    ("genicam", "dropped in motion"),
    ("gantry, grblHAL", "wrong identity"),
}


def cells() -> list[object]:
    found = []
    for i, (device, row) in enumerate(TABLE.items()):
        for k, fault in enumerate(FAULTS):
            if isinstance(row[fault], Case):
                often = (i + k) % THIRD == 0 and (device, fault) not in SLOW
                marks = () if often else (pytest.mark.full,)
                name = f"{device}-{fault}".replace(", ", " ").replace(" ", "-")
                found.append(pytest.param(device, fault, id=name, marks=marks))
    return found


@pytest.mark.parametrize(("device", "fault"), cells())
def test_a_fault_ends_rightly(device: str, fault: str) -> None:
    case = TABLE[device][fault]
    assert isinstance(case, Case)
    outcome = trial(device, fault, case)
    assert not outcome.problems, f"{outcome.error}: {outcome.message}"


def test_the_table_is_complete_and_says_why_a_cell_is_empty() -> None:
    for device, row in TABLE.items():
        assert set(row) == set(FAULTS), device
        assert all(case.why for case in row.values() if isinstance(case, NoSense))
    tried = [c for row in TABLE.values() for c in row.values() if isinstance(c, Case)]
    assert len(tried) >= 60
