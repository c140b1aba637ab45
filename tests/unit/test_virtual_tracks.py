"""Motions that a simulator makes and only reports."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.virtual_tracks import MotorTrack, Track


def test_between_two_reports_it_went_straight() -> None:
    track = Track(np.zeros(2))
    track.report(10.0, np.array([0.0, 0.0]))
    track.report(12.0, np.array([4.0, -2.0]))
    np.testing.assert_allclose(track.at(11.0), [2.0, -1.0])
    np.testing.assert_allclose(track.at(99.0), [4.0, -2.0])
    np.testing.assert_allclose(track.at(0.0), [0.0, 0.0])


def test_it_moves_only_between_places_that_differ() -> None:
    track = Track(np.zeros(1))
    for t_s, place in ((1.0, 0.0), (2.0, 5.0), (3.0, 5.0)):
        track.report(t_s, np.array([place]))
    assert track.moving_between(1.5, 1.6)
    assert track.moving_between(0.5, 1.5)
    assert not track.moving_between(0.2, 0.9)
    assert not track.moving_between(2.1, 2.9)
    assert track.end_s == 2.0


def test_a_report_from_the_past_is_refused() -> None:
    track = Track(np.zeros(1))
    track.report(2.0, np.array([1.0]))
    with pytest.raises(ValueError, match="order of time"):
        track.report(1.0, np.array([1.0]))


def test_old_reports_are_forgotten_and_the_place_is_kept() -> None:
    track = Track(np.zeros(1))
    for k in range(30_000):
        track.report(k * 0.02, np.array([float(k)]))
    assert len(track.times_s) < 30_000
    assert track.at(599.97)[0] == pytest.approx(29_998.5)


def test_the_glass_lags_behind_a_motor_that_turns_back() -> None:
    motor = MotorTrack(backlash=20.0, start=100.0)
    motor.report(1.0, 200.0)  # from below: engaged
    assert motor.glass_at(1.0) == 200.0
    motor.report(2.0, 190.0)  # inside the dead band: the glass stays
    assert motor.glass_at(2.0) == 200.0
    motor.report(3.0, 150.0)
    assert motor.glass_at(3.0) == 170.0
