"""The ``mvp-cell`` command: one file per subcommand, one place for errors."""

from __future__ import annotations

import importlib
import os
import signal
import sys
import traceback
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer
from typer.core import TyperCommand

from mvp.cell.interrupts import ENDING, uninterrupted
from mvp.cli.naming import name_cell
from mvp.cli.output import report_error
from mvp.errors import MvpCellError, StoppedByOperator, UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from types import FrameType

_COMMANDS = (
    "run",
    "plan",
    "features",
    "check",
    "home",
    "recover",
    "jog",
    "target",
    "calibrate",
    "export-camera",
    "import-camera",
    "truth",
    "simulate",
    "drivers",
    "devices",
    "init",
    "runs",
    "report",
)

# typer carries its own copy of click from some version on; BadParameter is a
# UsageError is a ClickException in both.
_CLICK_ERROR = cast("type[Exception]", typer.BadParameter.__mro__[2])

# What typer turns Ctrl-C into, silently; no command of ours returns it.
_TYPERS_CTRL_C = 130


def _version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        typer.echo(f"mvp-cell {version('mvp-cell')}")
        raise typer.Exit


def _options(
    debug: Annotated[
        bool, typer.Option("--debug", help="show the traceback of an error")
    ] = False,
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_version, is_eager=True, help="print the version"
        ),
    ] = False,
) -> None:
    """Plan camera pose and lens, take the picture, prove the specification in it.

    Tables and messages go to stderr; stdout carries one JSON document, with --json.
    """


class _Command(TyperCommand):
    """A subcommand whose usage line names an argument as its help does."""

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """``CELL`` where some versions of typer write ``{CELL}``."""
        return [piece.strip("{}") for piece in super().collect_usage_pieces(ctx)]

    def invoke(self, ctx: Any) -> Any:
        """Run it; the hints of its errors name the cell that was given."""
        try:
            return super().invoke(ctx)
        except MvpCellError as error:
            cell = ctx.params.get("cell")
            if isinstance(cell, str):
                name_cell(error, cell)
            raise


def build_app() -> typer.Typer:
    """The command with every subcommand; imports no heavy library."""
    app = typer.Typer(
        name="mvp-cell",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
    )
    app.callback()(_options)
    for name in _COMMANDS:
        place = name.replace("-", "_")
        module = importlib.import_module(f"mvp.cli.{place}")
        app.command(name, cls=_Command)(getattr(module, place))
    return app


def main() -> None:
    """Entry point of the console script."""
    os.environ.setdefault("OPENCV_LOG_LEVEL", "ERROR")
    for number in ENDING:
        # Whoever began us with nohup wants us to outlive the terminal.
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _terminated)
    try:
        code = invoke(sys.argv[1:])
    except KeyboardInterrupt:
        code = StoppedByOperator.exit_code
    # All is said; Ctrl-C while the interpreter ends would change the exit code.
    for number in (signal.SIGINT, *ENDING):
        signal.signal(number, signal.SIG_IGN)
    sys.exit(code)


def _terminated(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def invoke(arguments: Sequence[str]) -> int:
    """Run one command line; returns the exit code and never raises.

    Every error ends here: a message and a hint on stderr, one JSON document on stdout
    with ``--json``, a traceback only with ``--debug``.
    """
    debug = "--debug" in arguments
    as_json = "--json" in arguments
    try:
        return _dispatch(list(arguments))
    except MvpCellError as error:
        with uninterrupted():
            _trace(debug)
            return report_error(error, as_json=as_json)
    except KeyboardInterrupt:
        # Whoever presses it once more shall still read the message.
        with uninterrupted():
            _trace(debug)
            return report_error(_stopped(), as_json=as_json)
    except Exception as error:
        _trace(debug)
        return report_error(_bug(error), as_json=as_json)


def _dispatch(arguments: list[str]) -> int:
    """Hand the line to the command; usage errors come back as ours."""
    command = typer.main.get_command(build_app())
    try:
        result = command.main(arguments, prog_name="mvp-cell", standalone_mode=False)
    except typer.Abort as error:
        raise _stopped() from error
    except _CLICK_ERROR as error:
        message = _click_words(error)
        if type(error).__name__ == "NoArgsIsHelpError":
            typer.echo(message, err=True)
            return UsageError.exit_code
        raise UsageError(
            message, hint=_usage_hint(error), where="command line"
        ) from error
    if result == _TYPERS_CTRL_C:
        raise _stopped()
    return result if isinstance(result, int) else 0


def _stopped() -> StoppedByOperator:
    return StoppedByOperator("stopped by the operator")


def _click_words(error: Exception) -> str:
    words = getattr(error, "format_message", None)
    return str(words()) if callable(words) else str(error)


def _usage_hint(error: object) -> str:
    context = getattr(error, "ctx", None)
    path = context.command_path if context is not None else "mvp-cell"
    return f"`{path} --help` shows what it takes"


def _bug(error: Exception) -> MvpCellError:
    kind = f"{type(error).__name__}: {error}".strip()
    first = kind.splitlines()[0] if kind else type(error).__name__
    return MvpCellError(
        f"this is a bug in mvp-cell: {first}",
        hint="run it again with `mvp-cell --debug ...` and report the traceback",
    )


def _trace(debug: bool) -> None:
    if debug:
        traceback.print_exc()
