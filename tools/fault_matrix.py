"""Run every cell of the fault matrix and write what came of it into the docs.

python -m tools.fault_matrix [--device NAME] [--fault NAME] [--write]
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from tools.faults.page import page
from tools.faults.table import TABLE
from tools.faults.trial import Outcome, trial
from tools.faults.words import FAULTS, Case

PAGE = Path(__file__).parents[1] / "docs" / "explanation" / "faults.md"


def main(arguments: list[str] | None = None) -> int:
    """Run what is asked for; 1 when something is not as it must be."""
    options = _parser().parse_args(arguments)
    outcomes: list[Outcome] = []
    for device, row in TABLE.items():
        for fault in FAULTS:
            case = row[fault]
            asked = options.device in device and options.fault in fault
            if not asked or not isinstance(case, Case):
                continue
            began_s = time.monotonic()
            outcome = trial(device, fault, case)
            outcomes.append(outcome)
            print(_line(outcome, time.monotonic() - began_s), flush=True)
    bad = [outcome for outcome in outcomes if outcome.problems]
    print(f"{len(outcomes)} cells, {len(bad)} not as they must be")
    if options.write:
        PAGE.write_text(page(outcomes), encoding="utf-8")
    return 1 if bad else 0


def _line(outcome: Outcome, total_s: float) -> str:
    text = (
        f"{outcome.device:16} {outcome.fault:18} {outcome.error:14} "
        f"{outcome.seconds:5.2f}/{outcome.within_s:g} s, {total_s:5.1f} s in all"
    )
    return "\n    ".join([text, *outcome.problems])


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m tools.fault_matrix")
    parser.add_argument("--device", default="", help="part of a device's name")
    parser.add_argument("--fault", default="", help="part of a fault's name")
    parser.add_argument("--write", action="store_true", help="write the page")
    return parser


if __name__ == "__main__":
    sys.exit(main())
