"""Flights to days, changes, levels, slopes and comparisons, on arrays."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.stats
from checks.judge_trend import PLANS, Plan, draw_history, draw_off, judge_plan

from yawid.trend.best_profile import LEAST_DAYS
from yawid.trend.changes import Fitted, fit_fleets, nights
from yawid.trend.days import DAY_US, HOUR_US, Track, by_day, days_of, solve_tau2, within_tau2
from yawid.trend.levels import level_of, slope_of

N, VEHICLES = 40, 20


def fleet(seed: int, n: int = N, vehicles: int = VEHICLES) -> list[Track]:
    rng = np.random.default_rng(seed)
    return [daily(*draw_history(rng, 0.15, 0.08, n, draw_off(rng, n))) for _ in range(vehicles)]


def daily(value: np.ndarray, sigma: np.ndarray) -> Track:
    """Return the history of flights on one day after the other."""
    return Track(value, sigma, np.arange(len(value)) * DAY_US)


def fit_tracks(tracks: list[Track]) -> list[Fitted]:
    return fit_fleets([tracks])[0]


def changed(track: Track, factor: float, first: int, last: int) -> Track:
    along = np.clip((np.arange(len(track.value)) - first) / (last - first), 0.0, 1.0)
    return daily(track.value * (1.0 + (factor - 1.0) * along), track.sigma)


def found(fits: list[Fitted], p: float) -> list[int]:
    return [i for i, fit in enumerate(fits) if fit.change is not None and fit.change.p <= p]


def test_a_history_without_a_change_has_a_small_p_as_seldom_as_p_says() -> None:
    p = np.array([f.change.p for s in range(30) for f in fit_tracks(fleet(s)) if f.change])

    # Of 600, p says 6 and 0.6 at most; looks is of the far tail, where it is smaller.
    assert len(p) == 600
    assert np.sum(p <= 0.01) <= 13
    assert np.sum(p <= 0.001) <= 3


@pytest.mark.parametrize(("first", "last"), [(19, 20), (4, 34), (0, 39)])
def test_a_step_and_a_slope_are_found_where_they_are(first: int, last: int) -> None:
    tracks = fleet(1)
    tracks[3] = changed(tracks[3], 0.7, first, last)

    fits = fit_tracks(tracks)

    assert found(fits, 1e-4) == [3]
    change = fits[3].change
    assert change.after / change.before == pytest.approx(0.7, abs=0.09)
    assert abs((change.first + change.last) - (first + last)) / 2.0 <= 4.0
    assert change.t < -6.0


def test_outliers_are_no_change_and_have_no_weight() -> None:
    value = 0.15 + 0.01 * np.random.default_rng(3).standard_normal((VEHICLES, N))
    value[5, [7, 21, 22]] = 0.6, 0.5, 0.55
    fits = fit_tracks([daily(each, np.full(N, 0.008)) for each in value])

    assert found(fits, 0.01) == []
    assert list(np.flatnonzero(~level_of(daily(value[5], np.full(N, 0.008)), fits[5], None).kept)
                ) == [7, 21, 22]  # fmt: skip


def test_a_vehicle_that_scatters_thrice_as_much_is_not_called_changed() -> None:
    for seed in range(5):
        tracks = fleet(seed)
        about = tracks[0].value - np.median(tracks[0].value)
        tracks[0] = daily(tracks[0].value + 2.0 * about, tracks[0].sigma)
        assert found(fit_tracks(tracks), 0.01 / 60) == []


def test_neither_unit_nor_sign_of_a_number_matters() -> None:
    tracks = fleet(2)
    tracks[3] = changed(tracks[3], 0.75, 5, 35)
    turned = [daily(-1000.0 * each.value, 1000.0 * each.sigma) for each in tracks]

    for one, other in zip(fit_tracks(tracks), fit_tracks(turned), strict=True):
        assert other.change.t == pytest.approx(-one.change.t)
        assert other.change.after == pytest.approx(-1000.0 * one.change.after)


def test_level_and_slope_are_weighted_least_squares() -> None:
    x = np.arange(10.0)
    std = np.linspace(1.0, 3.0, 10)
    track = daily(5.0 + 0.5 * x, std)
    fit = fit_tracks([track])[0]
    ones = np.ones(10, bool)

    slope = slope_of(x, fit, ones)
    assert slope.value == pytest.approx(0.5)
    w = fit.day_std**-2.0
    mean = np.sum(w * x) / np.sum(w)
    assert slope.std == pytest.approx(np.sum(w * (x - mean) ** 2) ** -0.5)
    assert slope_of(x, fit, x < 2) is None
    level = level_of(track, fit, None)
    assert level.value == pytest.approx(np.average(track.value, weights=fit.std**-2.0))


def test_the_level_after_a_change_is_that_of_its_end() -> None:
    tracks = fleet(4)
    tracks[0] = changed(tracks[0], 0.7, 15, 16)
    fit = fit_tracks(tracks)[0]

    level = level_of(tracks[0], fit, fit.change)

    assert level.value == pytest.approx(0.7 * 0.15, abs=4.0 * level.std)
    assert level.std == pytest.approx(0.08 * 0.7 * 0.15 / 24**0.5, rel=0.6)


def test_flights_of_one_day_that_share_an_offset_are_no_change() -> None:
    plan = Plan(vehicles=2, days=40, most=3, share=1.0)
    assert judge_plan(plan, 60) == (0, 0)


def test_p_is_of_all_nights_and_all_profiles_by_students_t() -> None:
    for fit in fit_tracks(fleet(6)):
        change = fit.change
        looked = (
            2.5 / 0.75 if change.last - change.first >= N / 2 else 25.0 * np.log(N / 8.0) / 0.25
        )
        every_night = 4.0 * (1.0 + np.log(N / 12.0)) ** 2
        one = 2.0 * scipy.stats.t.sf(abs(change.t), fit.dof)
        assert change.p_if_no_season == pytest.approx(min(1.0, every_night * looked * one))
        assert change.p >= change.p_if_no_season


def test_who_looks_every_week_is_not_alarmed_more_often() -> None:
    assert judge_plan(Plan(vehicles=1, days=47, nightly=True), 30, every=7) == (0, 0)


def test_all_nights_to_come_spend_no_more_than_one_look_may() -> None:
    n = range(LEAST_DAYS, 100_000)
    # A look at n days sees what the one before saw, but for one part in n.
    spent = sum(1.0 / each / nights(each) for each in n)
    assert 0.2 < spent < 0.27


def test_fleets_fitted_together_are_as_each_by_itself() -> None:
    both = [fleet(1, n=40, vehicles=4), fleet(2, n=25, vehicles=3)]
    together = fit_fleets(both)
    for tracks, fits in zip(both, together, strict=True):
        for one, other in zip(fits, fit_tracks(tracks), strict=True):
            assert one.change.t == pytest.approx(other.change.t, rel=1e-9)
            assert one.dof == pytest.approx(other.dof)


def test_no_scatter_is_known_better_than_that_of_all_vehicles_together() -> None:
    fits = fit_tracks(fleet(5, n=16, vehicles=3))
    assert max(fit.dof for fit in fits) <= 3 * (16 - 4)


@pytest.mark.long
@pytest.mark.parametrize("name", PLANS)
def test_of_two_thousand_data_sets_one_in_fifty_at_most_is_called_changed(name: str) -> None:
    found, wrong = judge_plan(PLANS[name], 2000)
    assert wrong <= 40
    assert not PLANS[name].falls or found >= 1600


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
    assert list(days.day) == [0, 0, 1, 1]


def test_a_flight_far_off_has_no_weight_where_its_day_has_another() -> None:
    rng = np.random.default_rng(0)
    value, sigma = 1.0 + 0.02 * rng.standard_normal(30), np.full(30, 0.02)
    value[[7, 20]] = 2.0
    date = np.repeat(np.arange(15), 2) * DAY_US + np.tile([0, HOUR_US], 15)
    assert by_day(Track(value, sigma, date), 0.0).value[3] == pytest.approx(value[6])
    assert by_day(daily(value, sigma), 0.0).value[20] == 2.0


def test_tau_within_days_does_not_see_what_a_day_has_in_common() -> None:
    rng = np.random.default_rng(2)
    day = np.repeat(np.arange(3000), 2)
    value = 5.0 * rng.standard_normal(3000)[day] + 2.0 * rng.standard_normal(6000)
    sigma = np.full(6000, 1.0)
    date = day * DAY_US + np.tile([0, HOUR_US], 3000)

    assert within_tau2([Track(value, sigma, date)]) == pytest.approx(3.0, rel=0.15)
    assert within_tau2([daily(value, sigma)]) == 0.0


def test_tau_is_what_makes_half_of_the_squares_lie_below_the_median_of_chi2() -> None:
    rng = np.random.default_rng(0)
    sigma = rng.uniform(0.5, 2.0, 4001)
    r2 = (rng.standard_normal(4001) ** 2) * (sigma**2 + 9.0)

    tau2 = solve_tau2(r2, sigma**2)

    assert tau2 == pytest.approx(9.0, rel=0.1)
    assert np.median(r2 / (sigma**2 + tau2)) == pytest.approx(0.4549364231195724)
    assert solve_tau2(0.05 * r2, sigma**2) == 0.0
