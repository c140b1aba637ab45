"""Log lines as JSON in the run folder."""

from __future__ import annotations

import json
import logging
import traceback
from contextlib import contextmanager
from datetime import UTC, datetime
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    from mvp.devices import DeviceInfo

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


@contextmanager
def log_to(path: Path, run_id: str) -> Iterator[None]:
    """Send the log of our packages to a file while a run lasts."""
    handler = logging.FileHandler(path, encoding="utf-8", delay=True)
    handler.setFormatter(JsonLines(run_id))
    handler.setLevel(logging.DEBUG)
    levels = {}
    for name in _LOGGERS:
        logger = logging.getLogger(name)
        levels[name] = logger.level
        logger.addHandler(handler)
        logger.setLevel(logging.DEBUG)
    try:
        yield
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
