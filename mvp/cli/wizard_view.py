"""A wizard's steps on the terminal, and the answers to them."""

from __future__ import annotations

import sys
import time
from contextlib import suppress
from typing import TYPE_CHECKING, Self

from mvp.cli.ask import allow_motion, ask, terminal
from mvp.cli.output import console, tell_warning
from mvp.errors import UsageError
from mvp.wizard import Allow, Ask, Covered, Sampled, Say, Wait, Word, Working

if TYPE_CHECKING:
    from collections.abc import Callable

    from rich.console import Console
    from rich.status import Status

    from mvp.cell.calibrate_document import CalibrateDocument
    from mvp.cell.session import Motion
    from mvp.wizard import Answer, Forecast, Step

_STYLES = {"info": "", "good": "green", "warning": "yellow"}
_VERDICTS = {"go": "bold green", "marginal": "bold yellow", "no-go": "bold red"}
_WORDS = {"u": Word.UNDO, "undo": Word.UNDO, "f": Word.FINISH, "finish": Word.FINISH}
_SHADES = " .:-=+*#%@"
_BAR = 10
_TICK_S = 1.0


class TerminalView:
    """The person's side of a session; with ``auto`` it answers itself.

    Args:
        simulated: the cell is; then nothing real moves.
        auto: questions get their defaults.
        yes: motion is allowed.
        sleep: lets seconds pass.
    """

    def __init__(
        self,
        *,
        simulated: bool,
        auto: bool,
        yes: bool,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._simulated, self._auto, self._yes = simulated, auto, yes
        self._sleep = sleep
        self._lines: Console = console()
        self._status: Status | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self._quiet()

    def refuse_if_nobody_answers(self) -> None:
        """Before anything is opened.

        Raises:
            UsageError: questions will be asked, and nobody can answer.
        """
        if not self._auto and not terminal():
            raise UsageError(
                "calibrate asks questions, and there is no terminal to ask on",
                hint="let it answer itself with --auto",
            )

    def tell(self, text: str) -> None:
        """What is being done; only where somebody watches."""
        if not sys.stderr.isatty():
            return
        if self._status is None:
            self._status = self._lines.status(text)
            self._status.start()
        self._status.update(text)

    def allow(self, motion: Motion) -> bool:
        """Asked once, before anything moves."""
        self._quiet()
        return allow_motion(motion, yes=self._yes)

    def answer(self, step: Step) -> Answer:
        """Show a step; the answer to it.

        Raises:
            UsageError: it needs an answer, and nobody can be asked.
            KeyboardInterrupt: the end of the input.
        """
        if isinstance(step, Working):
            share = f" ({step.done} of {step.total})" if step.total else ""
            self.tell(step.text + share)
            return None
        self._quiet()
        match step:
            case Say():
                self._print(step.text, _STYLES[step.grade])
            case Sampled():
                self._print(*_sampled(step))
            case Covered():
                self._print("\n".join(covered_lines(step)))
            case Wait():
                self._wait(step)
            case Ask():
                return self._asked(step)
            case Allow():
                return self._allowed(step)
        return None

    def _print(self, text: str, style: str = "") -> None:
        self._lines.print(text, style=style, markup=False)

    def _quiet(self) -> None:
        if self._status is not None:
            self._status.stop()
            self._status = None

    def _wait(self, step: Wait) -> None:
        """Count down; in a simulated cell nothing warms up."""
        self._print(
            f"{step.text}: {step.seconds / 60:.0f} min; Ctrl-C ends the session"
        )
        if self._simulated:
            return
        left = step.seconds
        while left > 0:
            self.tell(f"{step.text}: {left / 60:.0f} min left")
            self._sleep(min(left, _TICK_S))
            left -= _TICK_S
        self._quiet()

    def _allowed(self, step: Allow) -> Answer:
        if self._yes or (self._auto and self._simulated):
            self.tell(step.text)
            return True
        if not terminal():
            raise UsageError(
                f"the arm would move ({step.text}), and nobody can be asked",
                hint="run it on a terminal, or allow motion with --yes",
            )
        self._print(f"{step.text} ({step.seconds:.0f} s)", "bold")
        while True:
            said = ask("Move? [Y/n, u(ndo) takes the last one back, f(inish)] ")
            word = said.strip().lower()
            if word in _WORDS:
                return _WORDS[word]
            if word in ("", "y", "yes"):
                return True
            if word in ("n", "no"):
                return False

    def _asked(self, step: Ask) -> Answer:
        if self._auto:
            if step.default is None:
                raise UsageError(
                    f"nobody can be asked: {step.question}",
                    hint="run it on a terminal, without --auto",
                )
            shown = f"{step.question} {step.default}{_unit(step)}"
            self._print(shown)
            return step.default
        while True:
            said = ask(f"{step.question}{_choices(step)} ").strip()
            if said.lower() in _WORDS:
                return _WORDS[said.lower()]
            understood = parsed(step, said)
            if understood is not None:
                return understood


def parsed(step: Ask, said: str) -> Answer:
    """What was typed, as the kind of question wants it; None: ask again."""
    if not said:
        return step.default
    if step.kind == "number":
        with suppress(ValueError):
            return float(said)
        return None
    if step.kind == "yes-no":
        return {"y": True, "yes": True, "n": False, "no": False}.get(said.lower())
    if step.kind == "choice":
        return said if said in step.choices else None
    return said


def _unit(step: Ask) -> str:
    return f" {step.unit}" if step.unit else ""


def _choices(step: Ask) -> str:
    """What may be typed, the default marked."""
    if step.kind == "yes-no":
        return {True: " [Y/n]", False: " [y/N]"}.get(step.default is True, " [y/n]")
    listed = f" ({', '.join(step.choices)})" if step.choices else ""
    default = "" if step.default is None else f" [{step.default}{_unit(step)}]"
    return listed + default


def _sampled(step: Sampled) -> tuple[str, str]:
    if step.usable:
        return f"  {step.number:3d} {step.name}: taken", ""
    text = f"  {step.number:3d} {step.name}: not used: {step.reason}; {step.action}"
    return text, "yellow"


def covered_lines(step: Covered) -> list[str]:
    """The picture's map in characters, bars, and the forecast."""
    lines = []
    most = max((count for row in step.grid for count in row), default=0)
    for row in step.grid:
        cells = [_shade(count, most) * 2 for count in row]
        lines.append("    |" + "".join(cells) + "|")
    for name, share in step.bars:
        done = round(_BAR * min(max(share, 0.0), 1.0))
        lines.append(f"    {name:<12} {'#' * done}{'.' * (_BAR - done)}")
    if step.forecast is not None:
        lines.append("    " + _forecast(step.forecast))
    return lines


def _shade(count: int, most: int) -> str:
    if count == 0:
        return _SHADES[0]
    return _SHADES[1 + (len(_SHADES) - 2) * count // max(most, 1)]


def _forecast(found: Forecast) -> str:
    if found.value is None:
        return f"{found.what}: too early to tell; asked {found.bar:.3g} {found.unit}"
    state = "reached" if found.met else "not yet"
    return (
        f"{found.what}: {found.value:.3g} {found.unit}, asked {found.bar:.3g} "
        f"{found.unit}: {state}"
    )


def print_result(document: CalibrateDocument) -> None:
    """The result for a person."""
    lines = console()
    for line in document.lines:
        lines.print(line, markup=False)
    verdict = document.verdict
    lines.print(
        f"{document.key}: {verdict.upper()}", style=_VERDICTS[verdict], markup=False
    )
    for cause in document.quality.causes:
        lines.print(f"  {cause.grade}: {cause.message}", markup=False)
        lines.print(f"    {cause.action}", markup=False)
    if document.placed:
        lines.print(f"written: {document.placed}", markup=False)
    if document.kept:
        lines.print(f"before:  {document.kept}", markup=False)
    if document.report:
        lines.print(f"report:  {document.report}", markup=False)
    lines.print(f"session: {document.session}", markup=False)
    if document.same_numbers is False:
        tell_warning("the stored result of this session has other numbers")
