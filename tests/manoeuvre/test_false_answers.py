"""A rudder that is not the one that moved the aircraft: no answer, whatever the fit looks like."""

from __future__ import annotations

import math

import numpy as np
import pytest
from manoeuvre.streams import HZ, TS_S, stream
from scipy.signal import cont2discrete, lfilter

from yawid.answers.run_summary import Manoeuvre
from yawid.blocks import Floats
from yawid.config.run import RunConfig
from yawid.manoeuvre.answered import answer
from yawid.manoeuvre.judge import ManoeuvreSetting

SECONDS = 20.0


def doublet(at_s: float, half_s: float, amplitude: float = 0.2) -> Floats:
    """Half of it to the right, half to the left, then rest"""
    t = np.arange(round(SECONDS * HZ)) / HZ - at_s
    return amplitude * (((t >= 0) & (t < half_s)) * 1.0 - ((t >= half_s) & (t < 2 * half_s)))


def decaying(rudder: Floats, wn: float, zeta: float) -> Floats:
    """The yaw rate (n,) of a lightly damped pair, with noise and a little wind"""
    rng = np.random.default_rng(3)
    b, a, _ = cont2discrete(([0.3 * wn**2, 0.3 * wn**2], [1, 2 * zeta * wn, wn**2]), TS_S)
    y = lfilter(b[0], a, rudder)
    wind = lfilter([1.0], [1.0, -0.95], rng.standard_normal(len(y)))
    return y + 0.002 * rng.standard_normal(len(y)) + 0.02 * y.std() * wind


def told(rudder: Floats, y: Floats, **options: object) -> Manoeuvre:
    setting = ManoeuvreSetting(RunConfig(**options), TS_S, (20.0, 20.0), (3, 1))
    return answer(stream(rudder, y=y), 1, setting)


OWN = doublet(1.2, 1.0)
YAW = decaying(OWN, 1.9, 0.1)


def test_its_own_rudder_answers():
    found = told(OWN, YAW)

    assert found.verdict.usable
    assert found.dutch_roll.wn_rad_s == pytest.approx(1.9, rel=0.05)


@pytest.mark.parametrize(("at_s", "half_s"), [(2.0, 0.8), (0.8, 1.6), (3.0, 1.0)])
def test_another_flights_rudder_does_not(at_s: float, half_s: float):
    """The free decay has the right frequency; a doublet near by passes for what began it"""
    assert not told(doublet(at_s, half_s), YAW).verdict.usable


def test_the_inner_part_of_its_own_rudder_has_no_wrong_answer():
    """A doublet with the same middle, .4 s shorter on both sides, moves the nose at the same time

    K is .3 and the yaw acceleration K wn^2.
    """
    found = told(doublet(1.6, 0.6), YAW)

    numbers = found.answer.physics["K"], found.answer.yaw_acceleration
    for number, true in zip(numbers, (0.3, 0.3 * 1.9**2), strict=True):
        assert not found.verdict.usable or abs(number.value - true) < 2.0 * number.std
    assert not found.verdict.usable or found.dutch_roll.wn_rad_s == pytest.approx(1.9, rel=0.02)


def test_a_rudder_reversed_in_time_does_not():
    assert not told(OWN[::-1].copy(), YAW).verdict.usable


def test_a_yaw_rate_that_is_late_is_named():
    """A third of a period late"""
    late = round(0.33 * 2 * math.pi / 1.9 * HZ)
    y = np.concatenate([np.full(late, YAW[0]), YAW[:-late]])
    reasons = {each.id: each.text for each in told(OWN, y).verdict.reasons}

    assert "s later explains" in reasons["mode_not_driven"]
    assert "clock" not in reasons["mode_not_driven"]


@pytest.mark.parametrize(("stroke_deg", "usable"), [(4.0, True), (1.1, True), (0.6, False)])
def test_a_stroke_has_a_floor_in_deg(stroke_deg: float, usable: bool):
    """Of an unknown travel a part of the largest stroke says nothing"""
    scale = math.radians(stroke_deg) / float(np.ptp(OWN))
    options = {"rudder_unit": "deg", "rudder_stroke_rad": math.radians(stroke_deg)}
    found = told(scale * OWN, YAW, **options)

    assert found.verdict.usable == usable
    texts = [each.text for each in found.verdict.reasons if each.id == "not_excited"]
    assert usable or f"{stroke_deg:.2g} deg" in texts[0]


def test_a_known_travel_has_no_floor():
    scale = math.radians(0.6) / float(np.ptp(OWN))
    assert told(scale * OWN, YAW, rudder_max_deg=1.0).verdict.usable
