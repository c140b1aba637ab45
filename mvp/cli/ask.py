"""Questions to the person at the terminal; the only place that asks."""

from __future__ import annotations

import sys
from contextlib import suppress
from typing import TYPE_CHECKING

from mvp.cli.output import console
from mvp.devices import cannot_stop
from mvp.errors import UsageError

if TYPE_CHECKING:
    from mvp.cell.session import Motion


def allow_motion(motion: Motion, *, yes: bool) -> bool:
    """Ask before anything real moves.

    Raises:
        UsageError: nobody can be asked.
    """
    if motion.simulated:
        return True
    if yes:
        _refuse_unseen(motion)
        _tell_homing(motion)
        _tell_no_stop(motion)
        _tell_whose_word(motion, whose_word(yes=True))
        return True
    if not terminal():
        raise UsageError(
            f"the arm of {motion.cell} would move, and nobody can be asked",
            hint="run it on a terminal, or allow it with --yes",
            where=motion.cell,
        )
    models = ", ".join(info.model for info in motion.infos.values())
    first = "find its references, then " if motion.homing is not None else ""
    _tell_homing(motion)
    console().print(
        f"{motion.cell} ({models}) will {first}{_errand(motion)}. "
        "Keep clear and keep a hand on the emergency stop.",
        style="bold yellow",
        markup=False,
    )
    _tell_no_stop(motion)
    _tell_whose_word(motion, "whoever answers y")
    return ask("Move now? [y/N] ").strip().lower() in ("y", "yes")


def whose_word(*, yes: bool) -> str:
    """Who allows motion, and answers for what nothing measures; for the record."""
    return "whoever gave --yes" if yes else "the person at the terminal"


def _errand(motion: Motion) -> str:
    if motion.errand:
        return motion.errand
    return "move to 1 place" if motion.views == 1 else f"move to {motion.views} places"


def _tell_homing(motion: Motion) -> None:
    """What moves where before anything else, and what is only believed."""
    if motion.homing is not None:
        console().print(motion.homing.words, style="bold yellow", markup=False)


def _tell_no_stop(motion: Motion) -> None:
    """Which devices go on when they are told to stop."""
    for role, info in motion.infos.items():
        if why := cannot_stop(info):
            console().print(
                f"{role} ({info.model}) cannot be stopped at once: {why}",
                style="bold yellow",
                markup=False,
            )


def _tell_whose_word(motion: Motion, word: str) -> None:
    """What nobody has seen is a person's responsibility, and it is said which."""
    for axis in motion.homing.believed if motion.homing is not None else ():
        console().print(
            f"axis {axis}: nothing measures it; it is so on the word of {word}",
            style="bold yellow",
            markup=False,
        )


def _refuse_unseen(motion: Motion) -> None:
    """``--yes`` says that nothing is in the way; it cannot see where an axis stands.

    Raises:
        UsageError: an axis that nothing measures is counted away from its mark.
    """
    away = motion.homing.away if motion.homing is not None else ()
    if away:
        raise UsageError(
            f"{', '.join(away)} of {motion.cell} are counted away from their marks, and "
            "nothing measures them: a person has to look whether they truly are there",
            hint="run `mvp-cell home CELL` on a terminal, without --yes",
            where=motion.cell,
        )


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
