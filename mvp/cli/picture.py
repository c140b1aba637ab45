"""A camera's picture, in a terminal and in a file."""

from __future__ import annotations

import threading
from contextlib import suppress
from functools import lru_cache
from typing import TYPE_CHECKING

from mvp.errors import OutputError

if TYPE_CHECKING:
    from pathlib import Path

    from rich.console import Console
    from rich.segment import Segments
    from rich.style import Style

    from mvp.devices import Frame
    from mvp.geometry import FloatArray

_HALF = "\u2580"  # the upper half of a character: two rows of pixels in a line of text


def fitted(
    shape: tuple[int, int], columns: int, lines: int | None = None
) -> tuple[int, int]:
    """Columns and lines of text for a picture of (rows, columns) px, undistorted.

    Args:
        shape: of the picture.
        columns: at most so many.
        lines: at most so many; None: as many as it takes.
    """
    rows, wide = shape
    width = max(columns, 2)
    height = max(round(width * rows / wide / 2), 1)
    if lines is not None and height > max(lines, 1):
        height = max(lines, 1)
        width = max(round(2 * height * wide / rows), 2)
    return width, height


def grey_blocks(frame: Frame, width: int, height: int) -> Segments:
    """The picture in ``height`` lines of ``width`` grey characters."""
    import cv2
    import numpy as np
    from rich.segment import Segment, Segments

    size = (width, 2 * height)
    small = cv2.resize(frame.pixels, size, interpolation=cv2.INTER_AREA)
    grey: FloatArray = small.astype(np.float64) * 255 / frame.full_scale
    rows = grey.round().astype(int).tolist()
    found: list[Segment] = []
    for above, below in zip(rows[0::2], rows[1::2], strict=True):
        pairs = zip(above, below, strict=True)
        found += [Segment(_HALF, _shade(top, bottom)) for top, bottom in pairs]
        found.append(Segment.line())
    return Segments(found)


@lru_cache(maxsize=1 << 16)
def _shade(top: int, bottom: int) -> Style:
    from rich.color import Color
    from rich.style import Style

    return Style(
        color=Color.from_rgb(top, top, top),
        bgcolor=Color.from_rgb(bottom, bottom, bottom),
    )


def show_picture(frame: Frame, say: Console) -> None:
    """The picture below what was printed last, as wide as the terminal."""
    width, height = fitted(frame.pixels.shape, max(min(say.width - 1, 160), 20))
    say.print(grey_blocks(frame, width, height), end="")


def save_picture(path: Path, frame: Frame) -> None:
    """The picture as it is, lossless; whoever reads the file finds a whole picture.

    Raises:
        OutputError: it cannot be written; the file is as before.
    """
    import cv2

    done, data = cv2.imencode(".png", frame.pixels)
    if not done:
        raise OutputError(
            f"{path}: the picture cannot be made a PNG",
            hint="a PNG holds 8 or 16 bit grey: check the camera's pixel format",
            where=str(path),
        )
    # A name of one's own: the live picture may be written to the same file.
    partial = path.with_name(f".{path.name}.{threading.get_ident()}.part")
    try:
        partial.write_bytes(data.tobytes())
        partial.replace(path)
    except OSError as error:
        with suppress(OSError):
            partial.unlink(missing_ok=True)
        raise OutputError(
            f"{path}: {error.strerror or error}",
            hint="name a file in a folder that can be written",
            where=str(path),
        ) from error
