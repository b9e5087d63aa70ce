"""Further tries where the first one is refused: a band, the turn removed, the user's word."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from manoeuvre.streams import HZ, TS_S, WN, ZETA, flown, rest, stream, yawing
from manoeuvres.test_answer import told
from scipy.signal import butter, lfilter
from yawid.manoeuvres.answer import Answered

import yawid
from yawid.blocks import Floats, SampleBlock
from yawid.estimation.grids import Narrow, narrowed
from yawid.results.judge_samples import narrower


def pulses(seed: int) -> Floats:
    """Pulses of 0.8 s that go either way, between rests"""
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], size=51)
    return flown(rest(1), 0.2 * np.repeat(signs, 16)[: 40 * HZ], rest(5))


RUDDER = pulses(1)


def with_line(rad_s: float = 37.7) -> SampleBlock:
    """A vibration that the model takes for the Dutch roll: its phase drifts as a motor's does"""
    t = np.arange(len(RUDDER)) * TS_S
    drift = 0.09 * np.cumsum(np.random.default_rng(3).standard_normal(len(t)))
    y = yawing(RUDDER, noise=0.002) + 0.2 * np.sin(rad_s * t + drift)
    return stream(RUDDER, y=y)


def in_turns() -> SampleBlock:
    """Turns as large as the yaw: less correlated with it than what always removes them"""
    white = np.random.default_rng(2).standard_normal(len(RUDDER) + 400)
    turn = lfilter(*butter(2, 0.15 / (HZ / 2)), white)[400:]
    turn *= 0.15 / turn.std()
    return stream(RUDDER, y=yawing(RUDDER, noise=0.002) + turn, turn=turn)


@cache
def of_the_line() -> Answered:
    return told(with_line())


def assert_right(found: Answered) -> None:
    assert found.verdict.usable
    roll = found.found.dutch_roll
    assert roll.wn_rad_s == pytest.approx(WN, rel=0.02)
    assert roll.zeta == pytest.approx(ZETA, abs=0.02)


def test_below_a_vibration_the_second_try_finds_the_dutch_roll():
    found = of_the_line()

    assert_right(found)
    first, second = found.found.tries
    assert (first.answers, second.answers) == (False, True)
    assert "mode_not_driven" in first.reasons
    assert second.reasons == []
    low, high = second.band_hz
    assert low < WN / (2.0 * np.pi) < high < 37.7 / (2.0 * np.pi)
    # The grid is so coarse that the vibration lies above half its rate.
    sample_time_s = found.found.answer.sample_time_s
    assert sample_time_s == pytest.approx(2 * TS_S)
    assert sample_time_s > np.pi / 37.7
    assert found.found.orders == second.orders


def test_without_the_turn_the_second_try_finds_the_dutch_roll():
    found = told(in_turns())

    assert_right(found)
    assert [each.turn for each in found.found.tries] == ["keep", "remove"]
    assert found.found.tries[0].reasons == ["poor_fit"]
    assert found.found.turn_removed


@pytest.mark.parametrize("options", [
    {"turn": "keep", "given": ("turn",)},
    {"rate": 20.0},
    {"band": (0.2, 9.0)},
])  # fmt: skip
def test_what_was_given_binds(options: dict[str, object]):
    samples = in_turns() if "turn" in options else with_line()
    found = told(samples, **options)

    assert not found.verdict.usable
    assert found.found.tries is None


@pytest.mark.long
def test_orders_that_were_given_bind_in_a_band_too():
    found = told(with_line(), given=("orders",)).found

    assert {str(each.orders) for each in found.tries} == {"3,3,2,1"}


def test_an_answer_by_the_first_try_has_no_tries():
    assert told(stream(RUDDER, y=yawing(RUDDER, noise=0.002))).found.tries is None


def test_a_try_gives_the_same_to_the_bit_again():
    assert told(with_line()).found == of_the_line().found


def test_a_rudder_that_does_nothing_stays_refused_whatever_is_tried():
    """A line, turns and gusts, none of them the rudder's: no try may make a Dutch roll of them"""
    for seed in range(2):
        for samples in (with_line(), in_turns()):
            foreign = stream(pulses(100 + seed), y=samples.y, turn=samples.turn_rate)
            assert not told(foreign).verdict.usable


@pytest.mark.parametrize(("noise", "seed", "usable"), [
    (0.15, 2, True), (0.18, 8, False), (0.18, 10, False), (0.2, 10, False),
])  # fmt: skip
def test_a_second_try_that_would_pass_as_a_first_is_refused(noise: float, seed: int, usable: bool):
    """By the band, below a vibration: sigma is .56 of a first try's limit where it is usable

    Else it is .91, .92 and .95 of that. Two tries, each with half of the probability of error,
    have .88 of it each.
    """
    t = np.arange(len(RUDDER)) * TS_S
    drift = 0.09 * np.cumsum(np.random.default_rng(3).standard_normal(len(t)))
    gyro = noise * np.random.default_rng(seed).standard_normal(len(t))
    y = yawing(RUDDER, noise=0.0) + 0.2 * np.sin(37.7 * t + drift) + gyro
    record = {"t": t, "rudder": RUDDER, "r [rad/s]": y, "airspeed [m/s EAS]": 20.0 + 0.0 * t}
    run = yawid.replay(record, rudder_unit="half-travel", rudder_is="commanded")

    [found] = run.summary.manoeuvres
    assert found.verdict.usable is usable
    assert [each.answers for each in found.tries] == [not usable, usable]
    assert found.tries[1].reasons == ([] if usable else ["not_converged"])


@pytest.mark.parametrize(("tries", "sigmas"), [(1, 2.0), (2, 2.2776), (3, 2.4284), (4, 2.5310)])
def test_the_limits_of_sigma_shrink_with_the_number_of_tries(tries: int, sigmas: float):
    """The two sigmas of a normal variable, at 4.55 % over the number of tries (tables)"""
    assert narrower(tries) == pytest.approx(2.0 / sigmas, rel=1e-4)


def gains(hz: float, u: Floats, how: Narrow) -> float:
    left, _ = narrowed(u[:, None], u, TS_S, how)
    return float(np.ptp(left[len(left) // 2 :]) / np.ptp(u))


def test_a_band_halves_the_power_at_its_corners_and_keeps_what_lies_between():
    """Butterworth of second order: 1 / sqrt(1 + (f / corner)^4)"""
    t, how = np.arange(80_000) * TS_S, Narrow((0.1, 1.0), 2)
    for hz, gain in ((0.1, 0.707), (0.05, 0.243), (0.3, 0.99), (1.0, 0.707), (2.0, 0.22)):
        assert gains(hz, np.sin(2.0 * np.pi * hz * t), how) == pytest.approx(gain, abs=0.04)


def test_a_gap_begins_the_filter_again_and_holds_only_its_own_samples():
    y = np.ones(400)
    y[100:110] = np.nan
    u, left = narrowed(np.ones((400, 1)), y, TS_S, Narrow((0.1, 1.0), 4))

    assert left.shape == (100,)
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(left)), [25, 26, 27])
    np.testing.assert_allclose(left[np.isfinite(left)], 0.0, atol=1e-9)
    np.testing.assert_array_equal(np.isnan(u[:, 0]), np.isnan(left))
