"""Start a planned run and kill this very process when a state is reached."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from mvp.cell.loading import load_cell, load_task
from mvp.cell.plan_job import prepare
from mvp.cell.run_job import RunOptions, start_run
from mvp.cell.session import Watcher
from mvp.planning.plan import Plan

if TYPE_CHECKING:
    from mvp.cell.runner import Runner
    from mvp.cell.states import RunStatus


def main(cell: str, task: str, plan_file: str, out: str, moment: str) -> None:
    def on_status(status: RunStatus) -> None:
        if f"{status.state.value} {status.view}" == moment:
            os.kill(os.getpid(), signal.SIGKILL)

    loaded = load_cell(cell)
    setting = prepare(loaded, load_task(loaded, task))
    plan = Plan.model_validate_json(Path(plan_file).read_bytes())
    options = RunOptions(out=Path(out), partial=True)
    watcher = Watcher(lambda motion: True, _follow, on_status)
    start_run(setting, plan, options, watcher)


def _follow(runner: Runner) -> None:
    pass


if __name__ == "__main__":
    main(*sys.argv[1:])
