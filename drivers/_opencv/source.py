"""Opening what OpenCV reads from, with time-outs, and proving what was asked of it."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias

from mvp.errors import ConnectError, DeviceFault

if TYPE_CHECKING:
    import cv2

Kind: TypeAlias = Literal["v4l2", "stream", "file", "folder"]
_LOG = logging.getLogger(__name__)
_BY_ID = Path("/dev/v4l/by-id")
_NEWEST_FIRST = 1  # frames that the driver of a USB camera may keep


@dataclass(frozen=True)
class SourceSettings:
    """What to open and how; None leaves a setting as the source has it."""

    source: str
    kind: Kind
    width_px: int | None
    height_px: int | None
    fps: float | None
    fourcc: str
    open_timeout_s: float
    read_timeout_s: float


@dataclass(frozen=True)
class OpenedSource:
    """A capture that delivers, and the size of its pictures."""

    capture: cv2.VideoCapture
    width_px: int
    height_px: int
    backend: str


def kind_of(source: str, folder: Path) -> Kind:
    """What an address means: a device, a URL, a film or a folder of pictures."""
    if "://" in source:
        return "stream"
    path = folder / source
    if path.is_dir():
        return "folder"
    if path.is_file():
        return "file"
    named = source.startswith("/dev/") or source.isdigit()
    return "v4l2" if named or (_BY_ID / source).exists() else "file"


def v4l2_devices() -> tuple[Path, ...]:
    """Cameras that the kernel names by their USB identity."""
    if not _BY_ID.is_dir():
        return ()
    return tuple(sorted(_BY_ID.glob("*-video-index0")))


def open_source(settings: SourceSettings, *, device: str) -> OpenedSource:
    """Open a device or a stream.

    Raises:
        ConnectError: it does not open in time.
        DeviceFault: a setting reads back as something else.
    """
    capture = _opened(settings)
    if not capture.isOpened():
        raise ConnectError(
            f"{settings.source} does not open",
            device=device,
            hint="check address, cable and rights (group video), and that no other "
            "program has it open",
        )
    try:
        if settings.kind == "v4l2":
            _configure(capture, settings, device)
        return _checked(capture, settings, device)
    except BaseException:
        capture.release()
        raise


def _opened(settings: SourceSettings) -> cv2.VideoCapture:
    import cv2

    if settings.kind == "v4l2":
        return cv2.VideoCapture(_node(settings.source), cv2.CAP_V4L2)
    # Decoding in one thread: every further one keeps another frame back.
    return cv2.VideoCapture(
        settings.source,
        cv2.CAP_FFMPEG,
        [
            cv2.CAP_PROP_OPEN_TIMEOUT_MSEC,
            round(settings.open_timeout_s * 1e3),
            cv2.CAP_PROP_READ_TIMEOUT_MSEC,
            round(settings.read_timeout_s * 1e3),
            cv2.CAP_PROP_N_THREADS,
            1,
        ],
    )


def _node(source: str) -> str:
    if source.isdigit():
        return f"/dev/video{source}"
    path = Path(source)
    named = path if path.is_absolute() else _BY_ID / source
    return str(named.resolve())


def _configure(
    capture: cv2.VideoCapture, settings: SourceSettings, device: str
) -> None:
    """Format, size, rate: in this order, since each limits the next."""
    import cv2

    keep_newest(capture, device)
    if settings.fourcc:
        code = cv2.VideoWriter.fourcc(*settings.fourcc)
        prove(capture, cv2.CAP_PROP_FOURCC, code, "pixel format", device)
    for key, value, what in (
        (cv2.CAP_PROP_FRAME_WIDTH, settings.width_px, "width"),
        (cv2.CAP_PROP_FRAME_HEIGHT, settings.height_px, "height"),
        (cv2.CAP_PROP_FPS, settings.fps, "frame rate"),
    ):
        if value is not None:
            prove(capture, key, value, what, device)


def keep_newest(capture: cv2.VideoCapture, device: str) -> None:
    """Ask for a queue of one frame, and say it where that was not taken.

    No fault: the reader hands out no frame that may have waited in a queue, however
    long; a fresh one only takes longer to come.
    """
    import cv2

    capture.set(cv2.CAP_PROP_BUFFERSIZE, _NEWEST_FIRST)
    kept = capture.get(cv2.CAP_PROP_BUFFERSIZE)
    if kept != _NEWEST_FIRST:
        _LOG.warning(
            "%s: the queue of the USB driver reads back as %s instead of %d frame: "
            "a fresh picture takes longer where this computer is busy",
            device,
            f"{kept:g}" if kept > 0 else "unknown",
            _NEWEST_FIRST,
        )


def prove(
    capture: cv2.VideoCapture, key: int, value: float, what: str, device: str
) -> None:
    """Set and read back: that ``set`` says True proves nothing.

    Raises:
        DeviceFault: it reads back as something else.
    """
    capture.set(key, value)
    read = capture.get(key)
    if abs(read - value) > 0.01 * abs(value):
        raise DeviceFault(
            f"{what} reads back as {read:g} instead of {value:g}",
            device=device,
            code="read-back",
            hint="`v4l2-ctl --list-formats-ext --list-ctrls` shows what it can do",
        )


def _checked(
    capture: cv2.VideoCapture, settings: SourceSettings, device: str
) -> OpenedSource:
    """Make sure that pictures come, and that they have the size asked for."""
    good, picture = capture.read()
    if not good or picture is None:
        raise ConnectError(
            f"{settings.source} opens but delivers no picture",
            device=device,
            hint="check that the camera is not busy and that the stream plays",
        )
    height, width = picture.shape[:2]
    for what, asked, got in (
        ("width", settings.width_px, width),
        ("height", settings.height_px, height),
    ):
        if asked is not None and asked != got:
            raise DeviceFault(
                f"pictures have a {what} of {got} px instead of {asked} px",
                device=device,
                code="read-back",
                hint="set the size in the camera, or the size in the cell file",
            )
    return OpenedSource(capture, width, height, capture.getBackendName())
