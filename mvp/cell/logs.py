"""Log lines as JSON in the run folder."""

from __future__ import annotations

import json
import logging
import traceback
from contextlib import contextmanager, nullcontext
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from mvp.cell.durable import append_whole, output_error

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from io import FileIO
    from pathlib import Path

    from mvp.devices import DeviceInfo
    from mvp.errors import OutputError

_LOG = logging.getLogger(__name__)
_LOGGERS = ("mvp", "drivers", "calibration")


class JsonLines(logging.Formatter):
    """One JSON object per line: time, level, logger, thread, message, traceback."""

    def __init__(self, run_id: str) -> None:
        super().__init__()
        self._run_id = run_id

    def format(self, record: logging.LogRecord) -> str:
        """The line for one record."""
        line: dict[str, object] = {
            "t_utc": datetime.fromtimestamp(record.created, UTC).isoformat(),
            "run": self._run_id,
            "level": record.levelname,
            "logger": record.name,
            "thread": record.threadName,
            "message": record.getMessage(),
        }
        if record.exc_info:
            line["traceback"] = "".join(traceback.format_exception(*record.exc_info))
        return json.dumps(line)


class LogFile(logging.Handler):
    """Appends whole lines to a file; gives up, for good, when the disk takes no more.

    A log that cannot be kept never spoils a run, so nothing is raised; ``error`` says
    what happened.
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path = path
        self._file: FileIO | None = None
        self.error: OutputError | None = None

    def emit(self, record: logging.LogRecord) -> None:
        """Append the line for one record."""
        if self.error is not None:
            return
        line = self.format(record).encode() + b"\n"
        try:
            if self._file is None:
                self._file = self._path.open("ab", buffering=0)
            append_whole(self._file, line)
        except OSError as error:
            self.error = output_error(self._path, error)

    def close(self) -> None:
        """Close the file."""
        with self.lock or nullcontext():
            if self._file is not None:
                self._file.close()
                self._file = None
        super().close()


@contextmanager
def log_to(path: Path, run_id: str) -> Iterator[LogFile]:
    """Send the log of our packages to a file while a run lasts."""
    handler = LogFile(path)
    handler.setFormatter(JsonLines(run_id))
    handler.setLevel(logging.DEBUG)
    levels = {}
    for name in _LOGGERS:
        logger = logging.getLogger(name)
        levels[name] = logger.level
        logger.addHandler(handler)
        logger.setLevel(logging.DEBUG)
    try:
        yield handler
    finally:
        for name in _LOGGERS:
            logger = logging.getLogger(name)
            logger.removeHandler(handler)
            logger.setLevel(levels[name])
        handler.close()


def log_devices(infos: Iterable[DeviceInfo]) -> None:
    """Say who answered, one line a device."""
    for info in infos:
        _LOG.info(
            "%s: %s, %s, serial %s, firmware %s%s",
            info.name,
            info.driver,
            info.model,
            info.serial,
            info.firmware,
            " (simulated)" if info.simulated else "",
        )
