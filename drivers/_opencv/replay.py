"""Pictures of a film or a folder, one after the other, each exposed when it is read."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mvp.errors import ConnectError, LinkLost

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    import cv2
    import numpy as np
    from numpy.typing import NDArray

_PICTURES = frozenset({".png", ".tif", ".tiff", ".bmp", ".pgm", ".jpg", ".jpeg"})


class Replay:
    """The pictures of a film or of a folder (sorted by name), again and again if asked.

    Args:
        path: film or folder.
        loop: start anew after the last picture.
    """

    def __init__(self, path: Path, *, loop: bool, device: str) -> None:
        self._path = path
        self._loop = loop
        self._device = device
        self._pictures: Iterator[NDArray[np.uint8] | NDArray[np.uint16]] | None = None

    def open(self) -> None:
        """Look whether there is a first picture.

        Raises:
            ConnectError: nothing there that OpenCV can read.
        """
        first = self._each()
        if next(first, None) is None:
            raise ConnectError(
                f"{self._path} has no picture that can be read",
                device=self._device,
                hint="give a film, or a folder with "
                + ", ".join(sorted(_PICTURES))
                + " files",
            )
        self._pictures = self._each()

    def close(self) -> None:
        """Forget the place; safe to repeat."""
        self._pictures = None

    def next(self) -> NDArray[np.uint8] | NDArray[np.uint16] | None:
        """The next picture, grey or colour; None after the last one.

        Raises:
            LinkLost: what there was to read is gone; looked for anew at the next call.
        """
        if self._pictures is None:
            return None
        try:
            picture = next(self._pictures, None)
            if picture is not None or not self._loop:
                return picture
            self._pictures = self._each()
            picture = next(self._pictures, None)
        except OSError as error:
            self._pictures = self._each()
            raise self._gone(str(error.strerror or error)) from error
        if picture is None:
            raise self._gone("it has no picture any more")
        return picture

    def _gone(self, why: str) -> LinkLost:
        return LinkLost(
            f"{self._path} cannot be read any more: {why}",
            device=self._device,
            hint="bring the film or the pictures back; it then begins anew",
        )

    def _each(self) -> Iterator[NDArray[np.uint8] | NDArray[np.uint16]]:
        return self._in_folder() if self._path.is_dir() else self._in_film()

    def _in_folder(self) -> Iterator[NDArray[np.uint8] | NDArray[np.uint16]]:
        import cv2
        import numpy as np

        for path in sorted(self._path.iterdir()):
            if path.suffix.lower() in _PICTURES:
                data = np.fromfile(path, np.uint8)
                picture = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
                if picture is not None:
                    yield picture.astype(_depth(picture), copy=False)

    def _in_film(self) -> Iterator[NDArray[np.uint8]]:
        import cv2

        film: cv2.VideoCapture = cv2.VideoCapture(str(self._path), cv2.CAP_FFMPEG)
        try:
            while film.isOpened():
                good, picture = film.read()
                if not good or picture is None:
                    return
                yield picture.astype("uint8", copy=False)
        finally:
            film.release()


def _depth(picture: object) -> str:
    return "uint16" if str(getattr(picture, "dtype", "")) == "uint16" else "uint8"
