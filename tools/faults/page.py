"""The page of the documentation that tells what came of every fault."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tools.faults.table import TABLE
from tools.faults.words import FAULTS, Case, NoSense

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tools.faults.trial import Outcome

HEAD = """# What happens when something breaks

`python -m tools.fault_matrix --write` has written this page from what it saw. In every
cell the simulated far end runs for itself, the real driver talks to it over the real
wire, and the fault is brought about at the far end. Then

- the error must be of the stated kind, say what to do next, and come before its deadline,
- the far end must have been asked for no motion after the error,
- once the fault is taken away, closing, opening, recovering and homing must lead to a
  next action that ends where it should,
- no thread, descriptor or process may be left behind.

No cell was tried on hardware. What a controller had accepted before the fault may still
be carried out: the run's report says what may still be moving.

"""


def page(outcomes: Sequence[Outcome]) -> str:
    """All of it, as Markdown."""
    found = {(o.device, o.fault): o for o in outcomes}
    parts = [HEAD, _summary(outcomes), _overview(found)]
    parts += [_device(device, found) for device in TABLE]
    return "\n".join(parts).rstrip() + "\n"


def _summary(outcomes: Sequence[Outcome]) -> str:
    good = sum(not outcome.problems for outcome in outcomes)
    return (
        f"{len(outcomes)} cells were run, {good} ended as they must. A dash is a fault "
        "that the device cannot have.\n"
    )


def _overview(found: dict[tuple[str, str], Outcome]) -> str:
    lines = ["| | " + " | ".join(TABLE) + " |", "|---" * (len(TABLE) + 1) + "|"]
    for fault, meaning in FAULTS.items():
        cells = [_short(TABLE[d][fault], found.get((d, fault))) for d in TABLE]
        lines.append(f"| **{fault}**: {meaning} | " + " | ".join(cells) + " |")
    return "\n".join([*lines, ""])


def _short(case: Case | NoSense, outcome: Outcome | None) -> str:
    if isinstance(case, NoSense):
        return "-"
    if outcome is None:
        return "not run"
    return _verdict(outcome)


def _verdict(outcome: Outcome) -> str:
    kind = "goes on" if outcome.error == "none" else f"`{outcome.error}`"
    return f"**not as it must be**: {kind}" if outcome.problems else kind


def _device(device: str, found: dict[tuple[str, str], Outcome]) -> str:
    lines = [
        f"## {device}",
        "",
        "| fault | what was done | error | seconds / deadline | next action works |",
        "|---|---|---|---|---|",
    ]
    for fault in FAULTS:
        case, outcome = TABLE[device][fault], found.get((device, fault))
        if isinstance(case, NoSense):
            lines.append(f"| {fault} | {case.why} | - | - | - |")
        elif outcome is None:
            lines.append(f"| {fault} | {case.how} | not run | | |")
        else:
            lines.append(f"| {fault} | {case.how} | " + _result(outcome) + " |")
    return "\n".join([*lines, ""])


def _result(outcome: Outcome) -> str:
    works = "yes" if outcome.next_works else "no"
    seconds = f"{outcome.seconds:.2f} / {outcome.within_s:g}"
    return f"{_verdict(outcome)} | {seconds} | {works}"
