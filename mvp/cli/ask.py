"""Questions to the person at the terminal; the only place that asks."""

from __future__ import annotations

import sys
from contextlib import suppress
from typing import TYPE_CHECKING

from mvp.cli.output import console
from mvp.errors import UsageError

if TYPE_CHECKING:
    from mvp.cell.session import Motion


def allow_motion(motion: Motion, *, yes: bool) -> bool:
    """Ask before anything real moves.

    Raises:
        UsageError: nobody can be asked.
    """
    if motion.simulated or yes:
        return True
    if not terminal():
        raise UsageError(
            f"the arm of {motion.cell} would move, and nobody can be asked",
            hint="run it on a terminal, or allow it with --yes",
            where=motion.cell,
        )
    models = ", ".join(info.model for info in motion.infos.values())
    first = (
        "drive its axes to their references (those without a switch must stand at "
        "their marks now), then "
        if motion.homes
        else ""
    )
    console().print(
        f"{motion.cell} ({models}) will {first}move to {motion.views} place(s). "
        "Keep clear and keep a hand on the emergency stop.",
        style="bold yellow",
        markup=False,
    )
    return ask("Move now? [y/N] ").strip().lower() in ("y", "yes")


def terminal() -> bool:
    """Whether a person can be asked."""
    return sys.stdin.isatty() and sys.stderr.isatty()


def ask(question: str) -> str:
    """One line of answer; the end of input counts as Ctrl-C.

    What was typed before the question was shown is no answer to it.
    """
    _forget_typed()
    sys.stderr.write(question)
    sys.stderr.flush()
    answer = sys.stdin.readline()
    if not answer:
        raise KeyboardInterrupt
    return answer


def _forget_typed() -> None:
    """Drop lines that wait at the terminal; pipes are left alone."""
    if sys.platform != "win32" and sys.stdin.isatty():
        import termios

        with suppress(OSError, termios.error):
            termios.tcflush(sys.stdin, termios.TCIFLUSH)
