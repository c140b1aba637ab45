import numpy as np
import pytest

from drivers.virtual_motion import History, Ramp, StepMove, StraightMove


@pytest.mark.parametrize(("speed", "acceleration"), [(0.5, 2.0), (10.0, 0.7)])
def test_a_ramp_keeps_its_speed_and_acceleration_and_arrives(speed, acceleration):
    ramp = Ramp(speed, acceleration)
    t = np.linspace(0, ramp.duration_s, 5001)
    place = np.array([ramp.at(x) for x in t])
    rate = np.gradient(place, t)
    assert place[0] == 0
    assert place[-1] == pytest.approx(1)
    assert rate.max() <= speed * 1.001
    assert np.abs(np.gradient(rate, t))[5:-5].max() <= acceleration * 1.05
    assert (np.diff(place) >= 0).all()


@pytest.mark.parametrize("share", [0.05, 0.4, 0.9])
def test_a_halted_ramp_brakes_and_stays(share):
    free = Ramp(0.5, 2.0)
    halt = share * free.duration_s
    ramp = Ramp(0.5, 2.0, halt_s=halt)
    rate = (free.at(halt + 1e-6) - free.at(halt - 1e-6)) / 2e-6
    end = free.at(halt) + rate**2 / (2 * 2.0)
    assert ramp.at(100.0) == pytest.approx(end, abs=1e-6)
    assert ramp.at(ramp.duration_s) == pytest.approx(ramp.at(100.0))
    assert ramp.at(100.0) <= 1


def test_all_axes_arrive_together_and_the_slowest_sets_the_pace():
    start, target = np.array([0.0, 1.0]), np.array([2.0, 1.1])
    move = StraightMove.limited(
        start, target, speed=np.array([1.0, 1.0]), acceleration=np.array([4.0, 4.0])
    )
    half = move.at(move.duration_s / 2)
    np.testing.assert_allclose(half, (start + target) / 2)
    np.testing.assert_array_equal(move.at(move.duration_s), target)
    assert move.duration_s == pytest.approx(2 + 1 / 4)


def test_history_knows_where_it_was_at_any_moment():
    history = History(np.array([0.0]))
    move = StepMove((0.0, 10.0), 10.0)
    history.begin(move, 5.0)
    history.begin(StepMove((10.0, 0.0), 10.0), 8.0)
    for t, place in ((4.0, 0.0), (5.5, 5.0), (7.0, 10.0), (8.5, 5.0), (20.0, 0.0)):
        assert history.at(t)[0] == pytest.approx(place)
    assert history.moving_between(5.9, 6.5)
    assert not history.moving_between(6.1, 7.9)
    assert history.end_s == pytest.approx(9.0)


def test_a_motor_stops_dead():
    move = StepMove((0.0, 100.0, 50.0), 10.0).halted(12.0)
    assert move.at(30.0)[0] == pytest.approx(80.0)
    assert move.passed(30.0) == [0.0, 100.0, 80.0]
    assert move.duration_s == 12.0
