"""One cell of the matrix: bring the fault about, see what comes of it, get back."""

from __future__ import annotations

import logging
import threading
import time
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING, Any

from mvp.errors import ConnectError, DeviceError, DeviceTimeout, LinkLost
from tools.faults.benches import bench_of
from tools.faults.devices import MAKES
from tools.faults.leaks import Belongings, left_behind
from tools.faults.words import Case

if TYPE_CHECKING:
    from collections.abc import Callable

    from tools.faults.benches import Bench


_LOG = logging.getLogger(__name__)
_HANG_S = 90.0
_BEGIN_S = 30.0
_TRIES = 3
_SETTLE_S = 0.3  # what the far end was sent last has arrived by then
_POLL_S = 0.005


@dataclass(frozen=True)
class Outcome:
    """What came of one cell.

    Attributes:
        error: its type, "none" where it went on rightly.
        seconds: from the fault to the error.
        next_works: whether the next action after the fault was the right one.
        problems: what is not as it must be; empty is good.
        met: whether it came to the fault at all; a computer that is too busy may let
            the simulator miss a deadline before.
    """

    device: str
    fault: str
    error: str
    message: str
    seconds: float
    within_s: float
    next_works: bool
    problems: tuple[str, ...]
    met: bool = True


def trial(device: str, fault: str, case: Case) -> Outcome:
    """Run one cell; again where it did not come to the fault.

    From starting the simulator to looking for what is left behind.
    """
    _warm(device)
    outcome = _once(device, fault, case)
    for _ in range(_TRIES - 1):
        if outcome.met:
            break
        _LOG.warning("%s, %s: never came to the fault", device, fault)
        outcome = _once(device, fault, case)
    return outcome


def _once(device: str, fault: str, case: Case) -> Outcome:
    before = Belongings.now()
    with ExitStack() as stack:
        bench = bench_of(device, case, stack)
        outcome = _Trial(device, fault, case, bench).run()
    left = left_behind(before)
    if left:
        return replace(outcome, problems=(*outcome.problems, f"left behind: {left}"))
    return outcome


class _Trial:
    """The steps of one cell; problems are collected, not raised."""

    def __init__(self, device: str, fault: str, case: Case, bench: Bench) -> None:
        self._device, self._fault, self._case = device, fault, case
        self._bench = bench
        self._problems: list[str] = []
        self._began_s = 0.0
        self._met = True

    def run(self) -> Outcome:
        """Fault, error, way back, next action."""
        steps = {"opening": self._opening, "rest": self._rest, "motion": self._motion}
        driver = self._bench.device()
        try:
            found, seconds = steps[self._case.at](driver)
            self._judge(found, seconds)
            driver = self._after(driver)
            works = self._works_again(driver)
        finally:
            with suppress(DeviceError):
                driver.close()
        return Outcome(
            self._device,
            self._fault,
            type(found).__name__ if isinstance(found, Exception) else "none",
            str(found) if isinstance(found, Exception) else "",
            seconds,
            self._case.within_s,
            works,
            tuple(self._problems),
            self._met,
        )

    # ------------------------------------------------------------ the fault

    def _opening(self, driver: Any) -> tuple[object, float]:
        if self._case.impostor:
            driver = self._bench.misled()
        self._bench.do(self._case.do)
        before = self._motions()
        found = self._timed(driver.open)
        with suppress(DeviceError):
            driver.close()
        self._nothing_new(before)
        return found

    def _rest(self, driver: Any) -> tuple[object, float]:
        self._get_ready(driver)
        self._bench.do(self._case.do)
        before = self._motions()
        found = self._timed(lambda: self._act(driver))
        # The action itself may have begun one: nothing may follow the error.
        if self._case.act == "beyond" and self._motions() != before:
            self._problems.append("something moved")
        self._nothing_new(self._motions())
        return found

    def _motion(self, driver: Any) -> tuple[object, float]:
        self._get_ready(driver)
        begun = self._bench.under_way()
        outcome: list[object] = []
        mover = threading.Thread(
            target=lambda: outcome.append(_result(lambda: self._act(driver))),
            name="mover",
        )
        mover.start()
        _wait_until(lambda: bool(outcome) or begun(), _BEGIN_S)
        if outcome:
            self._met = False
            self._problems.append(f"it ended before the fault: {outcome[0]!r}")
        self._began_s = time.monotonic()
        self._bench.do(self._case.do)
        if self._case.stop:
            driver.stop()
        before = self._motions()
        mover.join(_HANG_S)
        seconds = time.monotonic() - self._began_s
        if mover.is_alive():
            self._problems.append("it hangs")
            return None, seconds
        if isinstance(outcome[0], Exception):
            self._nothing_new(before)
        if self._case.stands:
            self._stands_short()
        return outcome[0], seconds

    def _get_ready(self, driver: Any) -> None:
        """Nothing is wrong yet, so a busy computer is all that can be in the way."""
        for tries_left in reversed(range(_TRIES)):
            try:
                self._bench.make_ready(driver)
                self._bench.go_near(driver)
                return
            except (DeviceTimeout, LinkLost):
                driver.close()
                if not tries_left:
                    raise

    def _act(self, driver: Any) -> object:
        if self._case.act == "home":
            return driver.home(timeout_s=self._case.timeout_s)
        if self._case.act == "beyond":
            return self._bench.go_beyond(driver)
        return self._bench.go_far(driver, self._case.timeout_s)

    def _timed(self, action: Callable[[], object]) -> tuple[object, float]:
        self._began_s = time.monotonic()
        found = _result(action)
        return found, time.monotonic() - self._began_s

    # ------------------------------------------------------------ judging

    def _judge(self, found: object, seconds: float) -> None:
        case = self._case
        wanted = " or ".join(kind.__name__ for kind in case.raises) or "no error"
        if isinstance(found, Exception):
            if not isinstance(found, case.raises):
                self._problems.append(f"{wanted} expected, got {found!r}")
            if not (self._case.stop or getattr(found, "hint", "")):
                self._problems.append(f"no hint: {found!r}")
            code = getattr(found, "code", "")
            if case.code and case.code not in code:
                self._problems.append(f"code {code!r} instead of {case.code!r}")
        elif case.raises and not case.may_go_on:
            self._problems.append(f"{wanted} expected, but it went on")
        if seconds > case.within_s:
            self._problems.append(f"took {seconds:.1f} s of {case.within_s:g} s")

    def _stands_short(self) -> None:
        """The stop has reached the far end, whatever came back."""
        first = self._bench.place()
        time.sleep(_SETTLE_S)
        place = self._bench.place()
        if place != first:
            self._problems.append("it still moves")
        elif self._bench.is_far(place):
            self._problems.append("it went on to its target")

    def _motions(self) -> int:
        return self._bench.motions()

    def _nothing_new(self, before: int) -> None:
        """What was sent last has arrived by now; no motion may have been in it."""
        time.sleep(_SETTLE_S)
        now = self._motions()
        if now != before:
            self._problems.append(f"{now - before} motions were begun afterwards")

    # ------------------------------------------------------------ and back

    def _after(self, driver: Any) -> Any:
        """Take the fault away and disconnect."""
        self._bench.do(self._case.undo)
        try:
            driver.close()
        except DeviceError as error:
            self._problems.append(f"closing raised {error!r}")
        return driver

    def _works_again(self, driver: Any) -> bool:
        """Open, recover, home where needed, and do the next thing rightly."""
        end_s = time.monotonic() + self._case.patience_s
        while True:
            try:
                self._bench.make_ready(driver)
                reached = self._bench.go_near(driver)
                break
            except DeviceError as error:
                passing = isinstance(error, ConnectError | LinkLost | DeviceTimeout)
                if not passing or time.monotonic() > end_s:
                    self._problems.append(f"the next action fails: {error!r}")
                    return False
                _LOG.info("not yet: %s", error)
                time.sleep(0.2)
        if not self._bench.is_near(reached):
            self._problems.append(f"the next action ended elsewhere: {reached}")
            return False
        return True


@cache
def _warm(device: str) -> None:
    """Let a library open what it opens only once in a process."""
    if not MAKES[device].keeps:
        return
    quiet = Case("nothing", "rest", (), _HANG_S)
    with ExitStack() as stack:
        bench = bench_of(device, quiet, stack)
        with bench.device() as driver:
            bench.go_near(driver)


def _result(action: Callable[[], object]) -> object:
    """What it returned, or the exception that it raised."""
    try:
        return action()
    except Exception as error:
        return error


def _wait_until(condition: Callable[[], bool], patience_s: float) -> None:
    """Poll until a condition holds or patience ends."""
    end_s = time.monotonic() + patience_s
    while not condition() and time.monotonic() < end_s:
        time.sleep(_POLL_S)
