"""After a stop: what was seen to stand, and what may still be moving and until when."""

from __future__ import annotations

import logging
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import TYPE_CHECKING

from mvp.cell.interrupts import uninterrupted
from mvp.errors import DeviceError, LimitError, MvpCellError, StoppedByOperator

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from mvp.cell.engine import CellDevices
    from mvp.devices import Arm, Lens

_LOG = logging.getLogger(__name__)
_MOVING = ("arm", "lens")
_LOOK_S = 3.0  # every stop path of every driver is through by then, or it is lost
_LOOK_EVERY_S = 0.1


def until(what: str, timeout_s: float) -> str:
    """A motion with the time of day at which it is over in any case."""
    end = datetime.now() + timedelta(seconds=timeout_s)
    return f"{what}, until {end:%H:%M:%S} at the latest"


@dataclass(frozen=True)
class Rest:
    """What was seen after everything had been told to stop.

    Attributes:
        standing: roles that were seen to stand.
        doubts: by role, why it is not known whether it stands.
    """

    standing: tuple[str, ...]
    doubts: Mapping[str, str]

    @property
    def stands(self) -> str:
        """``arm and lens``; empty when none was seen to stand."""
        return " and ".join(self.standing)

    def may_still_move(self, motion: str) -> str:
        """What is left of a motion that was under way, such as ``the arm on its way``.

        Empty once the device was seen to stand.
        """
        for role in self.standing:
            if motion.startswith(f"the {role}"):
                return ""
        for role, why in self.doubts.items():
            if motion.startswith(f"the {role}"):
                return f"{motion} ({why})"
        return motion


def seen_at_rest(devices: CellDevices) -> Rest:
    """Ask arm and lens, for some seconds at most, whether they stand. Raises nothing."""
    with ThreadPoolExecutor(len(_MOVING)) as pool:
        asked = [pool.submit(_doubt, getattr(devices, role)) for role in _MOVING]
        doubts = dict(zip(_MOVING, (one.result() for one in asked), strict=True))
    for role, why in doubts.items():
        _LOG.info("%s: %s", role, f"not seen to stand: {why}" if why else "stands")
    return Rest(
        tuple(role for role, why in doubts.items() if not why),
        {role: why for role, why in doubts.items() if why},
    )


def _doubt(device: Arm | Lens) -> str:
    """Why it is not known to stand; empty when it was seen to."""
    end_s = time.monotonic() + _LOOK_S
    while True:
        try:
            if device.state().standing:
                return ""
        except DeviceError as error:
            return f"it cannot be asked: {error.detail}"
        except Exception as error:
            _LOG.exception("%s: cannot be asked whether it stands", device.name)
            return f"it cannot be asked: {error}"
        if time.monotonic() > end_s:
            return "it was still moving when it was last asked"
        time.sleep(_LOOK_EVERY_S)


class UnderWay:
    """The motion that was commanded last and has not been confirmed."""

    def __init__(self) -> None:
        self.text = ""

    @contextmanager
    def moving(self, what: str, timeout_s: float) -> Iterator[None]:
        """Around one motion; it stays under way when that fails, unless refused."""
        self.text = until(what, timeout_s)
        try:
            yield
        except LimitError:
            self.text = ""
            raise
        self.text = ""


@contextmanager
def stopped_on_error(
    devices: CellDevices, under_way: UnderWay, tell: Callable[[str], None]
) -> Iterator[None]:
    """Whatever ends a motion early: stop all, look what stands, and let the error say it.

    Args:
        devices: open.
        under_way: what is being moved.
        tell: told that it is being looked.

    Raises:
        StoppedByOperator: for Ctrl-C.
        MvpCellError: what ended it, with ``may_still_move`` and ``stands``.
    """
    try:
        yield
    except BaseException as error:
        with uninterrupted():
            devices.stop()
            told = _told(error)
            if told is not None and (under_way.text or isinstance(error, DeviceError)):
                _look(devices, under_way.text, told, tell)
        if told is None or told is error:
            raise
        raise told from error


def _told(error: BaseException) -> MvpCellError | None:
    """The error as a person gets it; None for what is none of ours."""
    if isinstance(error, KeyboardInterrupt):
        return StoppedByOperator("stopped by the operator")
    if isinstance(error, MvpCellError):
        return error
    return None


def _look(
    devices: CellDevices, motion: str, told: MvpCellError, tell: Callable[[str], None]
) -> None:
    if isinstance(told, LimitError) and not motion:
        return  # refused: nothing has moved
    tell("all told to stop; looking whether arm and lens stand")
    rest = seen_at_rest(devices)
    told.stands = rest.stands
    told.may_still_move = rest.may_still_move(motion)
