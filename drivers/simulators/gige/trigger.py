"""A software trigger that paints first, so that the control channel answers meanwhile.

Aravis' camera has one thread for its control channel and its pictures: while a picture
is being painted it answers nothing, and a client takes a camera that is silent for three
seconds for lost. So the camera's description names another register for the trigger;
what is written there is met by a thread of ours, which paints and then pulls the trigger
that Aravis knows.
"""

from __future__ import annotations

import ctypes
import re
import tempfile
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drivers.simulators.gige.address import CameraProblem

if TYPE_CHECKING:
    from collections.abc import Callable

_TRIGGER, _TRIGGER_OF_ARAVIS = 0x310, 0x30C
_NODE = re.compile(
    rb'(<IntReg Name="TriggerSoftwareCommandRegister".*?<Address>)0x30c(</Address>)',
    re.S,
)
_WATCH_S = 0.01


def description_file(arv: Any, gobject: Any) -> Path:
    """Aravis' description of its camera, with the trigger in a register of ours.

    The caller removes the file once a camera was made from it.

    Raises:
        CameraProblem: this version of Aravis describes its camera in another way.
    """
    description, changes = _NODE.subn(
        rb"\g<1>0x%x\g<2>" % _TRIGGER, _description(arv, gobject), count=1
    )
    if not changes:
        raise CameraProblem("this version of Aravis has another software trigger")
    with tempfile.NamedTemporaryFile(
        prefix="mvp-cell-gige-", suffix=".xml", delete=False
    ) as file:
        file.write(description)
    return Path(file.name)


def _description(arv: Any, gobject: Any) -> bytes:
    """What a camera of the library says of itself."""
    camera = arv.arv_fake_camera_new(b"description")
    size = ctypes.c_size_t()
    text = arv.arv_fake_camera_get_genicam_xml(camera, ctypes.byref(size))
    described = ctypes.string_at(text, size.value)
    gobject.g_object_unref(camera)
    return described


class TriggerWatch:
    """Waits for triggers on a thread of its own.

    Args:
        read, write: registers of the camera; they do nothing while there is none.
        streams: whether the camera is acquiring.
        paint: makes the picture; takes as long as it takes.
        born: counts the cameras, so that no picture for one reaches the next.
    """

    def __init__(
        self,
        read: Callable[[int], int],
        write: Callable[[int, int], None],
        streams: Callable[[], bool],
        paint: Callable[[], bytes],
        born: Callable[[], int],
    ) -> None:
        self._read, self._write = read, write
        self._streams = streams
        self._paint = paint
        self._born = born
        self._ended = threading.Event()
        self._picture: bytes | None = None
        self._thread = threading.Thread(target=self._watch, name="trigger", daemon=True)

    def start(self) -> None:
        """Begin to wait for triggers; safe to repeat."""
        if not self._thread.is_alive() and not self._ended.is_set():
            self._thread.start()

    def end(self) -> None:
        """React to nothing any more; a picture under way is dropped."""
        self._ended.set()

    def take(self) -> bytes | None:
        """The picture of the last trigger, once; nothing when the camera runs free."""
        picture, self._picture = self._picture, None
        return picture

    def _watch(self) -> None:
        while not self._ended.wait(_WATCH_S):
            if self._read(_TRIGGER):
                self._write(_TRIGGER, 0)
                self._answer()

    def _answer(self) -> None:
        """Paint, and let Aravis send it, if there is still somebody who wants it."""
        if not self._streams():
            return
        camera = self._born()
        picture = self._paint()
        if self._born() == camera and self._streams():
            self._picture = picture
            self._write(_TRIGGER_OF_ARAVIS, 1)
