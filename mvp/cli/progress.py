"""Progress on the terminal; silent where nobody watches."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING

from mvp.cli.output import console

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


@contextmanager
def stages() -> Iterator[Callable[[str], None]]:
    """Yields a function that shows what is being done."""
    if not sys.stderr.isatty():
        yield lambda text: None
        return
    with console().status("starting") as status:
        yield lambda text: status.update(text)
