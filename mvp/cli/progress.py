"""Progress for people: one line for each phase, its details where somebody watches."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING

from mvp.cell.progress import unheard
from mvp.cli.output import console

if TYPE_CHECKING:
    from collections.abc import Iterator

    from mvp.cell.progress import Tell


def phase(text: str) -> None:
    """Say what is being done from now on."""
    console().print(f"{text} ...", style="dim", markup=False)


@contextmanager
def stages(name: str = "planning") -> Iterator[Tell]:
    """One phase; yields a function that shows its details on a terminal."""
    if not sys.stderr.isatty():
        phase(name)
        yield unheard
        return
    with console().status(name) as status:
        yield lambda text: status.update(f"{name}: {text}")
