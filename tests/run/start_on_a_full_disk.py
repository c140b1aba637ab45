"""Run the command line; the disk is full from the moment a certain file is opened.

``limit`` sets this process a limit on the size of files, a few bytes behind the end of
the file that is opened: the system then writes these bytes and refuses the rest. A path
instead is a file that takes up all the room that is left on its disk.
"""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from pathlib import Path

from mvp.cli.main import invoke

_FEW_BYTES = 37
_BLOCKS = (b"\0" * (1 << 20), b"\0" * 4096)


class Filler:
    """Waits for the n-th time that a file of some name is opened for writing."""

    def __init__(self, how: str, name: str, count: int) -> None:
        self._how, self._name, self._left = how, name, count

    def __call__(self, event: str, arguments: tuple[object, ...]) -> None:
        if event != "open" or not self._left:
            return
        path, mode, _ = arguments
        if not isinstance(path, str) or not isinstance(mode, str):
            return
        # A name with a star is that of a file which is named after something else.
        if not Path(path).match(self._name) or not set(mode) & set("wax+"):
            return
        self._left -= 1
        if not self._left:
            self._fill(path)

    def _fill(self, path: str) -> None:
        if self._how == "limit":
            import resource

            size = os.stat(path).st_size if os.path.exists(path) else 0
            _, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
            resource.setrlimit(resource.RLIMIT_FSIZE, (size + _FEW_BYTES, hard))
            return
        _take_up(Path(self._how))


def _take_up(ballast: Path) -> None:
    """Write until the disk takes no more."""
    with ballast.open("ab", buffering=0) as file:
        for block in _BLOCKS:
            with suppress(OSError):
                while file.write(block) == len(block):
                    pass


def main(how: str, name: str, count: str, *words: str) -> int:
    sys.addaudithook(Filler(how, name, int(count)))
    return invoke(words)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
