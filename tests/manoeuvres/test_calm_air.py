"""Where output error answers a manoeuvre, and where gusts or a rudder that reacts forbid it."""

from __future__ import annotations

import numpy as np
import pytest
from manoeuvre.streams import HZ, TS_S, WN, ZETA, flown, rest, stream, yawing
from scipy.signal import butter, cont2discrete, lfilter
from yawid.manoeuvres.answer import Answered, ManoeuvreSetting
from yawid.manoeuvres.calm_air import apart_reasons, is_calm
from yawid.manoeuvres.tries import answer

import yawid
from yawid.blocks import Floats
from yawid.config.run import RunConfig


def told(rudder: Floats, y: Floats, **options: object) -> Answered:
    setting = ManoeuvreSetting(RunConfig(**options), TS_S, (20.0, 20.0), (3, 1))
    return answer(stream(rudder, y=y), 1, setting)


def pulses(seconds: float, seed: int) -> Floats:
    signs = np.random.default_rng(seed).choice([-0.2, 0.2], size=round(seconds * HZ / 6) + 1)
    return np.repeat(signs, 6)[: round(seconds * HZ)]


def gusts(n: int, strength: float) -> Floats:
    """What gusts do: they pass through the aircraft's own mode"""
    b, a, _ = cont2discrete(([WN], [1.0, 0.6 * WN, WN**2]), TS_S)
    x = lfilter(b[0], a, np.random.default_rng(4).standard_normal(n))
    return strength * x / x.std()


RUDDER = flown(rest(1), pulses(30, 1), rest(5))
CALM = yawing(RUDDER, noise=0.004)


def test_in_calm_air_it_answers_and_the_others_are_shown():
    found = told(RUDDER, CALM).found

    assert found.verdict.method == "oe"
    assert list(found.estimates) == ["oe", "rml", "els"]
    assert found.verdict.usable
    assert found.dutch_roll.wn_rad_s == pytest.approx(WN, rel=0.01)
    assert found.estimates["oe"].theta["c1"] == 0.0
    assert found.estimates["oe"].fit.simulation_pct > 90.0


@pytest.mark.parametrize(("share", "method"), [(0.02, "oe"), (0.5, "rml")])
def test_gusts_forbid_it(share: float, method: str):
    y = CALM + gusts(len(CALM), share * CALM.std())
    assert told(RUDDER, y).found.verdict.method == method


def test_a_rudder_that_reacts_forbids_it():
    """Gusts as light as those above, that a damper answers: the loop is closed by iteration"""
    gust = gusts(len(CALM), 0.1 * CALM.std())
    own = 0.25 * RUDDER
    rudder = own
    for _ in range(30):
        y = yawing(rudder, noise=0.0) + gust
        rudder = own + np.concatenate([[0.0], -1.2 * y[:-1]])
    assert told(rudder, y).found.verdict.method == "rml"


def test_a_slow_drift_forbids_it_and_noise_of_that_size_does_not():
    """It lies far below the mode, where gusts are looked for; a free run takes it for the rudder's

    Output error would be 1.8 % off in wn and .027 in zeta.
    """
    white = np.random.default_rng(7).standard_normal(len(CALM))
    drift = lfilter(*butter(2, 0.2 / (HZ / 2)), white)
    t = 10.0 + TS_S * np.arange(len(CALM))
    for x, share, method in ((drift, 0.4, "rml"), (white, 0.2, "oe")):
        y = CALM + share * CALM.std() * x / x.std()
        record = {"t": t, "rudder": RUDDER, "r [rad/s]": y, "airspeed [m/s EAS]": 20.0 + 0.0 * t}
        run = yawid.replay(record, rudder_unit="half-travel", rudder_is="commanded")
        [found] = run.summary.manoeuvres
        assert found.verdict.usable
        assert found.verdict.method == method
        assert found.dutch_roll.wn_rad_s == pytest.approx(WN, rel=0.01)
        assert found.dutch_roll.zeta == pytest.approx(ZETA, abs=0.01)


@pytest.mark.parametrize(("share", "calm"), [(0.01, True), (0.1, False)])
def test_a_residual_of_a_hundredth_may_resemble_the_rudder(share: float, calm: bool):
    """The residual is the rudder of 0.15 s later: all of the rudder follows it"""
    left = share * CALM.std() / RUDDER.std() * np.roll(RUDDER, -round(0.15 / TS_S) - 1)

    assert is_calm(left, left, RUDDER, CALM, WN, TS_S) is calm


def test_els_alone_is_els():
    found = told(RUDDER, CALM, method="els", also="none").found
    assert list(found.estimates) == ["els"]


@pytest.mark.parametrize(("other", "refused"), [(6.7, False), (6.8, True), (5.2, True)])
def test_it_may_be_12_percent_from_maximum_likelihood(other: float, refused: bool):
    reasons = list(apart_reasons(6.0, other))

    assert [each.id for each in reasons] == ["not_converged"] * refused
    assert not refused or f"6 rad/s by OE and {other:g} by RML" in reasons[0].text


def test_without_maximum_likelihood_there_is_nothing_to_compare():
    assert not list(apart_reasons(6.0, float("nan")))
