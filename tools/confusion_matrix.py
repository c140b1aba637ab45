"""Prints which fault is named what, over seeded pictures, as a Markdown table.

python tools/confusion_matrix.py --trials 30 --seed 0
"""

from __future__ import annotations

import argparse
import os
import sys
from collections import Counter
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from mvp.imaging import verify_view
from tools.picture_trials import (
    CAUSE_OF,
    CLASSES,
    Stage,
    make_trial,
    paper_stage,
)


@dataclass(frozen=True)
class Outcome:
    """What was injected and what was said."""

    fault: str
    seed: int
    view: str
    amount: str
    verdict: str
    cause: str | None
    explanation: str

    @property
    def named_right(self) -> bool:
        """The cause is right, and a pass is a pass."""
        passed = self.verdict == "pass"
        return self.cause == CAUSE_OF[self.fault] and passed == (self.fault == "none")


def outcome(stage: Stage, fault: str, seed: int) -> Outcome:
    trial = make_trial(stage, fault, seed)
    result = verify_view(trial.image, 255.0, trial.expectation)
    return Outcome(
        fault,
        seed,
        trial.view,
        trial.amount,
        result.verdict,
        result.cause,
        result.explanation,
    )


def _share(task: tuple[list[tuple[str, int]], int, int, bool]) -> list[Outcome]:
    jobs, part, parts, light_known = task
    stage = paper_stage(light_known=light_known)
    return [outcome(stage, fault, seed) for fault, seed in jobs[part::parts]]


def outcomes(
    counts: dict[str, int],
    seed: int,
    processes: int = 2,
    *,
    light_known: bool = True,
) -> list[Outcome]:
    """Run ``counts[fault]`` trials of each fault."""
    jobs = [(f, seed + k) for f, count in counts.items() for k in range(count)]
    tasks = [(jobs, part, processes, light_known) for part in range(processes)]
    if processes == 1:
        return _share(tasks[0])
    with get_context("spawn").Pool(processes) as pool:
        return [o for batch in pool.map(_share, tasks) for o in batch]


def table(results: list[Outcome]) -> str:
    """Rows: injected; columns: said."""
    said = Counter((o.fault, o.cause or o.verdict) for o in results)
    columns = sorted({cause for _, cause in said}, key=lambda c: (c != "pass", c))
    lines = [
        "| injected | trials | " + " | ".join(columns) + " | right |",
        "|---|" + "---|" * (len(columns) + 2),
    ]
    for fault in CLASSES:
        mine = [o for o in results if o.fault == fault]
        if mine:
            right = sum(o.named_right for o in mine) / len(mine)
            cells = [str(said[fault, c] or "") for c in columns]
            row = " | ".join([fault, str(len(mine)), *cells, f"{right:.1%}"])
            lines.append(f"| {row} |")
    total = sum(o.named_right for o in results) / len(results)
    passed = sum(o.verdict == "pass" for o in results if o.fault != "none")
    lines.append(f"\n{total:.1%} named right; faults that passed: {passed}")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=30, help="of each fault")
    parser.add_argument("--clean", type=int, help="without a fault (default: --trials)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--light-unknown", action="store_true")
    parser.add_argument("--misses", action="store_true", help="list them")
    given = parser.parse_args()
    counts = dict.fromkeys(CLASSES, given.trials)
    if given.clean is not None:
        counts["none"] = given.clean
    results = outcomes(
        counts, given.seed, given.processes, light_known=not given.light_unknown
    )
    print(table(results))
    if given.misses:
        for miss in (o for o in results if not o.named_right):
            print(f"- {miss}")


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    main()
