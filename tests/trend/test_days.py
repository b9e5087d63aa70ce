"""Flights to days, on arrays."""

from __future__ import annotations

import numpy as np
import pytest

from yawid.trend.days import DAY_US, HOUR_US, Track, by_day, days_of, solve_tau2, within_tau2


def test_a_day_ends_with_a_night_whatever_the_clock_says() -> None:
    hours = [0, 3, 8, 20, 21, 48]  # the second day begins after twelve hours without a flight
    assert list(days_of(np.array(hours) * HOUR_US)) == [0, 0, 0, 1, 1, 2]
    # An afternoon in California: midnight UTC is no night.
    assert list(days_of(20 * HOUR_US + np.arange(8) * HOUR_US)) == [0] * 8


def test_who_never_sleeps_has_days_of_18_hours() -> None:
    day = days_of(np.arange(60, dtype=np.int64) * HOUR_US)
    assert list(np.bincount(day)) == [19, 19, 19, 3]


def test_a_days_number_is_the_weighted_mean_of_its_flights() -> None:
    sigma = np.array([1.0, 2.0, 1.0, 3.0])
    value = np.array([10.0, 11.0, 9.0, 12.0])
    track = Track(value, sigma, np.array([0, 1, 30, 31]) * HOUR_US)

    days = by_day(track, within2=3.0)

    for d, rows in enumerate((slice(0, 2), slice(2, 4))):
        w = 1.0 / (sigma[rows] ** 2 + 3.0)
        assert days.value[d] == pytest.approx(np.average(value[rows], weights=w))
        assert days.sigma[d] == pytest.approx(w.sum() ** -0.5)
    assert (list(days.first), list(days.last)) == ([0, 2], [1, 3])


def test_a_flight_far_off_has_no_weight_where_its_day_has_another() -> None:
    rng = np.random.default_rng(0)
    value, sigma = 1.0 + 0.02 * rng.standard_normal(30), np.full(30, 0.02)
    value[[7, 20]] = 2.0
    date = np.repeat(np.arange(15), 2) * DAY_US + np.tile([0, HOUR_US], 15)
    assert by_day(Track(value, sigma, date), 0.0).value[3] == pytest.approx(value[6])
    assert by_day(Track(value, sigma), 0.0).value[20] == 2.0


def test_tau_within_days_does_not_see_what_a_day_has_in_common() -> None:
    rng = np.random.default_rng(2)
    day = np.repeat(np.arange(3000), 2)
    value = 5.0 * rng.standard_normal(3000)[day] + 2.0 * rng.standard_normal(6000)
    sigma = np.full(6000, 1.0)
    date = day * DAY_US + np.tile([0, HOUR_US], 3000)

    assert within_tau2([Track(value, sigma, date)]) == pytest.approx(3.0, rel=0.15)
    assert within_tau2([Track(value, sigma)]) == 0.0


def test_tau_is_what_makes_half_of_the_squares_lie_below_the_median_of_chi2() -> None:
    rng = np.random.default_rng(0)
    sigma = rng.uniform(0.5, 2.0, 4001)
    r2 = (rng.standard_normal(4001) ** 2) * (sigma**2 + 9.0)

    tau2 = solve_tau2(r2, sigma**2)

    assert tau2 == pytest.approx(9.0, rel=0.1)
    assert np.median(r2 / (sigma**2 + tau2)) == pytest.approx(0.4549364231195724)
    assert solve_tau2(0.05 * r2, sigma**2) == 0.0
