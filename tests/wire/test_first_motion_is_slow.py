"""A run's first motion has the reduced speed on the wire, and only that one."""

from __future__ import annotations

import re
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pytest

from mvp.cell.engine import CellDevices, CellEngine
from mvp.devices import RealClock

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from mvp.planning.plan import PlannedView

SHARE = 0.25
HOME = (0.0, -1.57, 1.57, -1.57, -1.57, 0.0)
ASIDE = (0.1, *HOME[1:])
SPEED = 6  # of a motion's values: the six joints, then speed and acceleration


def drives(arm: Any, *places: Sequence[float]) -> None:
    """The views of a run, one after the other, as its engine drives to them."""
    engine = CellEngine(
        CellDevices(arm, cast("Any", None), cast("Any", None), RealClock()),
        arrived=np.full(len(places[0]), 0.1),
        settle_s=(0.0, 0.0),
        start_speed=SHARE,
        preflight=lambda: None,
        route=lambda start, view: [view.joints_rad],
        exposure=cast("Any", None),
        store=cast("Any", None),
        verifier=cast("Any", None),
    )
    for number, place in enumerate(places):
        view = SimpleNamespace(id=f"v{number}", joints_rad=place)
        engine.move(cast("PlannedView", view))


def test_of_a_robot_by_the_speed_that_its_controller_received(ur_bench: Any) -> None:
    bench = ur_bench()
    with bench.arm() as arm:
        arm.move_joints(HOME, timeout_s=60)
        begun_s = bench.now_s()
        drives(arm, ASIDE, HOME, ASIDE)
    first, second, third = (c["values"][SPEED] for c in bench.moves_since(begun_s))
    assert second == third > 0
    assert first == pytest.approx(SHARE * second)


def test_of_a_gantry_by_the_feed_that_was_sent(
    gantry_bench: Callable[..., Any],
) -> None:
    bench = gantry_bench("grblhal")
    arm = bench.homed()
    sent = len(bench.tap.sent)
    drives(arm, bench.far, bench.start, bench.far)
    said = b"".join(bench.tap.sent[sent:])
    feeds = [float(word) for word in re.findall(rb"F([\d.]+)", said)]
    first, second, third = feeds
    assert second == pytest.approx(third, rel=1e-3)
    assert first == pytest.approx(SHARE * second, rel=1e-3)
