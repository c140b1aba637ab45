"""The terminal of ``mvp-cell jog``: the position while something moves, a live picture."""

from __future__ import annotations

import select
import sys
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from typing import TYPE_CHECKING

from mvp.cell.beside import call_beside
from mvp.cell.interrupts import uninterrupted
from mvp.cell.jog_words import Live
from mvp.cell.live_position import LivePosition
from mvp.cli.ask import terminal
from mvp.cli.keys import leaving
from mvp.cli.output import console, tell_warning
from mvp.cli.picture import fitted, grey_blocks
from mvp.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rich.console import RenderableType

    from mvp.cell.jog_job import Jogger
    from mvp.cell.jog_words import JogCommand
    from mvp.cell.live_picture import LivePicture, Shown

_PROMPT = "jog> "
_LOOK_S = 0.1
_NEWS_S = 0.3
_LEAVE = "Enter or q: back to jogging"


def carry_out(jogger: Jogger, command: JogCommand, *, follow: bool) -> str:
    """One command beside this thread, which draws and stays free for Ctrl-C.

    Args:
        jogger: carries it out.
        command: what to do.
        follow: show where what moves is; for a terminal only.

    Raises:
        KeyboardInterrupt: after the devices were told to stop.
        Whatever ``Jogger.do`` raises.
    """
    if command == Live() and terminal():
        return _watched(jogger)
    do, stop = partial(jogger.do, command), jogger.devices.stop
    if not follow:
        return call_beside(do, stop)
    with LivePosition(jogger.following()) as position, _in_place() as draw:

        def look() -> None:
            draw(position.text)

        def end() -> None:
            position.end()
            stop()

        return call_beside(do, end, look)


@contextmanager
def _in_place() -> Iterator[Callable[[str], None]]:
    """Yields what draws a text where it drew the last one; nothing is left of it."""
    from rich.live import Live as Drawing
    from rich.text import Text

    drawing = Drawing(
        console=console(),
        auto_refresh=False,
        transient=True,
        redirect_stdout=False,
        redirect_stderr=False,
    )

    def draw(text: str) -> None:
        # A terminal that takes no more text is no reason to stop a motion.
        with suppress(OSError):
            if text and not drawing.is_started:
                drawing.start()
            if drawing.is_started:
                # What others print begins a line of its own.
                drawing.update(Text(f"{text}\n", style="dim"), refresh=True)

    try:
        yield draw
    finally:
        with uninterrupted(), suppress(OSError):
            drawing.stop()


def _watched(jogger: Jogger) -> str:
    """Picture and place on the whole terminal until the person leaves; moves nothing.

    Raises:
        UsageError: this terminal cannot draw.
        MvpCellError: there is no picture.
    """
    from rich.console import Console
    from rich.control import Control

    say = Console(stderr=True, highlight=False)
    if not say.is_terminal or say.is_dumb_terminal:
        raise UsageError(
            "this terminal cannot draw a picture in place",
            hint="let it be kept in a file: live picture.png",
        )
    shown: Shown | None = None
    with ExitStack() as stack:
        left = stack.enter_context(leaving())
        stack.enter_context(jogger.live.looked_at())
        screen = stack.enter_context(say.screen())
        say.control(Control.home())
        screen.update(_waiting())
        while not left(_LOOK_S) and jogger.live.is_on:
            newest = jogger.live.newest
            if newest is not None and newest is not shown:
                shown = newest
                say.control(Control.home())
                screen.update(_page(shown, say.width, say.height))
    return shown.where if shown is not None else "no picture came"


def _waiting() -> RenderableType:
    from rich.text import Text

    return Text(f"waiting for a picture ...\n{_LEAVE}")


def _page(shown: Shown, width: int, height: int) -> RenderableType:
    """A screenful: as much of the picture as there is room for, words below."""
    from rich.console import Group
    from rich.text import Text

    words = Text(f"{shown.where}\n{_LEAVE}", no_wrap=True, overflow="crop")
    room = height - shown.where.count("\n") - 2
    blocks = grey_blocks(
        shown.frame, *fitted(shown.frame.pixels.shape, width - 1, room)
    )
    return Group(blocks, words)


def tell_news(live: LivePicture) -> None:
    """Why the live picture has ended, if it has; said once."""
    failure = live.failure()
    if failure is not None:
        tell_warning(
            f"the live picture has ended: {failure.message}", hint=failure.hint
        )


def asked(live: LivePicture) -> Iterator[str]:
    """Lines typed at the prompt, until the end of input."""
    sys.stderr.write("help lists the words, quit ends\n")
    while line := _line(live):
        if line.strip():
            yield line


def _line(live: LivePicture) -> str:
    """One line; that a live picture has ended is told before it is typed."""
    _prompt()
    if sys.platform != "win32" and _ends_before_a_line(live):
        sys.stderr.write("\n")
        tell_news(live)
        _prompt()
    return sys.stdin.readline()


def _ends_before_a_line(live: LivePicture) -> bool:
    was_on = live.is_on
    while live.is_on:
        if select.select([sys.stdin], [], [], _NEWS_S)[0]:
            return False
    return was_on


def _prompt() -> None:
    sys.stderr.write(_PROMPT)
    sys.stderr.flush()
