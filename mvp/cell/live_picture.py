"""A live picture: one after the other into a file, or for somebody who looks.

::

    off --to_file, looked_at--> on --end, a failure--> off
"""

from __future__ import annotations

import logging
import threading
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mvp.devices import RealClock
from mvp.errors import DeviceError, MotionStopped, MvpCellError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from mvp.devices import Clock, Frame

_LOG = logging.getLogger(__name__)
_EVERY_S = 0.25
_BREATH_S = 0.05  # between two pictures of a slow camera: others may want one
_LEAVE_S = 15.0  # a simulated camera that draws cannot be interrupted
_STOP_AGAIN_S = 0.05


@dataclass(frozen=True, eq=False)
class Shown:
    """What somebody who looks is shown: a picture, and in words where all stands."""

    frame: Frame
    where: str


class LivePicture:
    """Takes pictures in a thread of its own, which alone waits for the camera.

    A picture that does not come, or a file that cannot be written, ends it; nothing else
    notices.

    Args:
        take: takes a picture; others may do so, too, in their turn.
        save: puts a picture into a file, whole or not at all.
        where: says where arm and lens stand; asked only while somebody looks.
        stop: lets a picture that is waited for end.
        clock: of whoever looks.
        every_s: from one picture to the next, at least.
    """

    def __init__(
        self,
        take: Callable[[], Frame],
        save: Callable[[Path, Frame], None],
        where: Callable[[], str],
        stop: Callable[[], None],
        clock: Clock | None = None,
        every_s: float = _EVERY_S,
    ) -> None:
        self._take = take
        self._save = save
        self._where = where
        self._stop = stop
        self._clock = clock or RealClock()
        self._every_s = every_s
        self._lock = threading.Lock()
        self._ending = threading.Event()
        self._thread: threading.Thread | None = None
        self._file: Path | None = None
        self._looked_at = False
        self._newest: Shown | None = None
        self._failure: MvpCellError | None = None

    @property
    def is_on(self) -> bool:
        """Whether pictures are being taken."""
        with self._lock:
            return self._thread is not None

    @property
    def newest(self) -> Shown | None:
        """The last picture since somebody looks."""
        return self._newest

    def failure(self) -> MvpCellError | None:
        """What has ended it unasked; told once."""
        with self._lock:
            failure, self._failure = self._failure, None
        return failure

    def to_file(self, file: Path) -> Frame:
        """Keep a file up to date from now on; returns the first picture in it.

        Raises:
            DeviceError, OutputError: there is no first picture; it is off, or as before.
        """
        frame = self._take()
        self._save(file, frame)
        self._begin(file)
        return frame

    @contextmanager
    def looked_at(self) -> Iterator[None]:
        """While somebody looks at ``newest``."""
        self._newest, self._looked_at = None, True
        self._begin()
        try:
            yield
        finally:
            self._looked_at = False
            if self._file is None:
                self.end()

    def end(self) -> bool:
        """No more pictures; returns when the camera is free. Whether it was on."""
        with self._lock:
            thread, self._thread = self._thread, None
            self._file = None
            self._ending.set()
        if thread is None:
            return False
        for _ in range(round(_LEAVE_S / _STOP_AGAIN_S)):
            thread.join(_STOP_AGAIN_S)
            if not thread.is_alive():
                return True
            self._let_go()
        _LOG.error("the live picture does not let go of the camera")
        return True

    def _let_go(self) -> None:
        try:
            self._stop()
        except DeviceError as error:
            _LOG.warning("%s", error)

    def _begin(self, file: Path | None = None) -> None:
        with self._lock:
            self._file = file or self._file
            if self._thread is not None:
                return
            self._failure = None
            self._ending = threading.Event()
            self._thread = threading.Thread(
                target=self._run,
                args=(self._ending,),
                name="mvp-cell live picture",
                daemon=True,
            )
            self._thread.start()

    def _run(self, ending: threading.Event) -> None:
        try:
            while not ending.is_set():
                began_s = self._clock.now_s()
                self._next()
                left_s = began_s + self._every_s - self._clock.now_s()
                self._clock.wait(ending, max(left_s, _BREATH_S))
        except MvpCellError as error:
            self._failed(ending, error)
        except Exception as error:
            _LOG.exception("live picture")
            self._failed(ending, MvpCellError(f"this is a bug in mvp-cell: {error!r}"))

    def _next(self) -> None:
        frame = self._take()
        file = self._file
        if file is not None:
            self._save(file, frame)
        if self._looked_at:
            self._newest = Shown(frame, self._where())

    def _failed(self, ending: threading.Event, error: MvpCellError) -> None:
        """Off from now on, and for whoever asks, why."""
        _LOG.info("live picture: %s", error)
        if isinstance(error, MotionStopped):
            error = MvpCellError("it was stopped together with arm and lens")
        with self._lock:
            if ending.is_set():
                return
            ending.set()
            self._thread = self._file = None
            self._failure = error
