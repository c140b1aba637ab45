"""The person's side of a run: questions, progress, Ctrl-C."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mvp.cell.durable import check_writable
from mvp.cell.in_use import refuse_in_use
from mvp.cell.loading import LoadedCell, load_task
from mvp.cell.locate_job import locate_first, noted
from mvp.cell.plan_job import Setting, make_plan
from mvp.cell.report_hook import write_report_if_possible
from mvp.cell.resume_command import resume_command
from mvp.cell.resume_job import plan_left, resume_run
from mvp.cell.run_job import RunOptions, dry_run, require_runnable, start_run
from mvp.cell.session import Motion, RunResult, Watcher
from mvp.cell.simulation import refuse_other_task
from mvp.cell.states import RunState, RunStatus
from mvp.cli.ask import allow_motion, ask, terminal, whose_word
from mvp.cli.naming import name_cell
from mvp.cli.output import (
    console,
    print_model,
    tell_error,
    tell_rest,
    tell_warning,
)
from mvp.cli.progress import phase, stages
from mvp.cli.tables import print_plan, print_run
from mvp.cli.wizard_view import TerminalView
from mvp.errors import MvpCellError, OutputError, StoppedByOperator, UsageError

if TYPE_CHECKING:
    from mvp.cell.loading import LoadedTask
    from mvp.cell.run_folder import RunFolder
    from mvp.cell.runner import Runner, RunOutcome
    from mvp.planning.plan import Plan

_LOOK_EVERY_S = 0.2
_SMALL_RUN_BYTES = 50_000_000


@dataclass(frozen=True, eq=False)
class RunFlow:
    """One invocation of ``mvp-cell run``.

    Attributes:
        given: the cell as it was named on the command line.
    """

    given: str
    cell: LoadedCell
    task: str | None
    options: RunOptions
    seed: int
    yes: bool

    def start(self) -> RunResult:
        """Plan and run."""
        self._refuse_step_without_terminal()
        refuse_in_use(self.cell)
        check_writable(self.options.out, needed_bytes=_SMALL_RUN_BYTES)
        setting, plan = self._planned()
        result = start_run(setting, plan, self.options, self._watcher())
        return self._reported(result)

    def locate_and_start(self) -> RunResult:
        """Find the part from its own features, plan for where it lies, and run."""
        self._refuse_step_without_terminal()
        refuse_in_use(self.cell)
        check_writable(self.options.out, needed_bytes=_SMALL_RUN_BYTES)
        view = TerminalView(
            simulated=self.cell.config.simulated, auto=True, yes=self.yes
        )
        task = self._task()
        with stages() as tell:
            planned = make_plan(self.cell, task, seed=self.seed, tell=tell)
        with view:
            located = locate_first(
                planned, self.options, view, view.tell, seed=self.seed
            )
        with stages() as tell:
            again = make_plan(self.cell, located.task, seed=self.seed, tell=tell)
        plan = noted(again.plan, located)
        print_plan(plan)
        watcher = self._watcher()
        result = start_run(again.setting, plan, self.options, watcher, located)
        return self._reported(result)

    def resume(self, run: str) -> RunResult:
        """Go on with a run that broke off."""
        self._refuse_step_without_terminal()
        left = plan_left(run, self.options.out)
        if left.views:
            console().print(f"left of {run}: {len(left.views)} views", markup=False)
            print_plan(left)
        try:
            result = resume_run(self.cell, run, self.options, self._watcher())
        except OutputError as error:
            error.hint = f"{error.hint}; then give the same command again"
            raise
        return self._reported(result)

    def dry_run(self, as_json: bool) -> int:
        """Plan and check; nothing moves, nothing is kept."""
        refuse_in_use(self.cell)
        setting, plan = self._planned()
        require_runnable(setting, plan, partial=self.options.partial)
        document = dry_run(setting, plan, phase)
        print_run(document)
        if as_json:
            print_model(document)
        return 0

    def _task(self) -> LoadedTask:
        """The task, unless somebody simulates the cell with another one."""
        task = load_task(self.cell, self.task)
        refuse_other_task(self.cell, task)
        return task

    def _planned(self) -> tuple[Setting, Plan]:
        task = self._task()
        with stages() as tell:
            planned = make_plan(self.cell, task, seed=self.seed, tell=tell)
        print_plan(planned.plan)
        return planned.setting, planned.plan

    def _reported(self, result: RunResult) -> RunResult:
        """Draw the report; where the disk took no more before, that would be in vain."""
        if isinstance(result.outcome.error, OutputError):
            return result
        if result.log_error is not None:
            tell_warning(f"the log is incomplete: {result.log_error}")
        try:
            with stages("drawing the report"):
                page = write_report_if_possible(result)
        except KeyboardInterrupt:
            console().print("no report: stopped by the operator")
            return result
        if isinstance(page, Path):
            console().print(f"report: {page}", markup=False)
        else:
            self._tell_no_report(page, result.folder)
        return result

    def _tell_no_report(self, error: Exception, folder: RunFolder) -> None:
        """Why, and the command that makes it up; it moves nothing."""
        first = f"the log says more: {folder.log_file}"
        if isinstance(error, MvpCellError):
            first = error.hint
        hint = f"{first}; then: {_resume_command(self.cell, folder)}"
        tell_warning(f"no report: {error}", hint=hint)

    def _watcher(self) -> Watcher:
        return Watcher(
            self._allow,
            self._follow,
            _show,
            self._tell_end,
            _tell_rest,
            phase,
            whose_word(yes=self.yes),
        )

    def _tell_end(self, folder: RunFolder, outcome: RunOutcome) -> None:
        """Before anything else: what may still be moving cannot wait."""
        error = early_end(self.cell, folder, outcome)
        if error is not None:
            name_cell(error, self.given)
            tell_error(error)
            phase("looking whether arm and lens stand")

    def _allow(self, motion: Motion) -> bool:
        return allow_motion(motion, yes=self.yes)

    def _follow(self, runner: Runner) -> None:
        """Answer pauses until the run has ended."""
        while True:
            status = runner.wait(
                lambda s: s.state in (RunState.PAUSED, RunState.FINISHED),
                timeout_s=_LOOK_EVERY_S,
            )
            if status.state is RunState.FINISHED:
                return
            if status.state is RunState.PAUSED:
                answer = ask(f"Enter takes {status.view}, q stops: ")
                if answer.strip().lower().startswith("q"):
                    runner.abort()
                    return
                runner.resume()

    def _refuse_step_without_terminal(self) -> None:
        if self.options.step and not terminal():
            raise UsageError(
                "--step asks before every view, and there is no terminal to ask on",
                hint="leave out --step, or run it on a terminal",
            )


def early_end(
    cell: LoadedCell, folder: RunFolder, outcome: RunOutcome
) -> MvpCellError | None:
    """Why a run ended early and how to go on; None when it did not, or for a bug."""
    if outcome.reason == "completed":
        return None
    command = _resume_command(cell, folder)
    error = outcome.error
    if outcome.reason == "aborted":
        error = StoppedByOperator("stopped by the operator")
    if not isinstance(error, MvpCellError):
        return None
    if command not in error.hint:
        first = f"{error.hint}; then " if error.hint else ""
        error.hint = f"{first}go on with: {command}"
    error.may_still_move, error.stands = outcome.may_still_move, outcome.stands
    return error


def _resume_command(cell: LoadedCell, folder: RunFolder) -> str:
    return resume_command(
        folder.path, cell.source.path, accept_calibration=cell.accept_calibration
    )


def _tell_rest(outcome: RunOutcome) -> None:
    tell_rest(stands=outcome.stands, moving=outcome.may_still_move)


def _show(status: RunStatus) -> None:
    if status.view is None:
        return
    place = f"{status.view} ({status.index + 1} of {status.total})"
    if status.state in (
        RunState.MOVING,
        RunState.ADJUSTING,
        RunState.CAPTURING,
        RunState.VERIFYING,
    ):
        console().print(f"  {place}: {status.state.value}", markup=False)
