"""A jet on approach, whose Dutch roll of 1.9 rad/s rings on after the rudder has come to rest."""

from __future__ import annotations

import math

import numpy as np
import pytest
from manoeuvre.streams import HZ, flown, rest, stream
from manoeuvre.streams import yawing as by_eq_23
from manoeuvre.test_answered import told
from scipy.signal import lfilter

from yawid.blocks import Floats, SampleBlock

WN, ZETA = 1.9, 0.1
PERIOD = 2.0 * math.pi / WN * HZ
"""In samples: it lasts 3.3 s."""


def yawing(rudder: Floats, wind: float = 0.0) -> Floats:
    """The yaw rate (n,), K .3, with a little noise and a share of wind"""
    y = by_eq_23(rudder, wn=WN, zeta=ZETA, lead_s=1.0, noise=0.002, seed=3)
    blown = lfilter(
        [1.0], [1.0, -0.95], np.random.default_rng(3).standard_normal((2, len(rudder)))[1]
    )
    return y + wind * y.std() * blown


def doublet(half_s: float, begin_s: float = 10.0, rest_s: float = 30.0) -> Floats:
    return flown(rest(begin_s), rest(half_s, 0.2), rest(half_s, -0.2), rest(rest_s))


def short(rest_s: float = 30.0) -> SampleBlock:
    """A doublet of 1.4 s in all, between rests."""
    rudder = doublet(0.7, rest_s=rest_s)
    return stream(rudder, y=yawing(rudder))


@pytest.mark.parametrize(
    ("periods", "lost", "refused"),
    [(1.9, 0.0, True), (2.3, 0.0, True), (3.2, 0.0, False), (4.0 + 1.8 * HZ / PERIOD, 1.8, False)],
)
def test_a_record_of_too_few_periods_is_refused(periods: float, lost: float, refused: bool):
    """A drift and a bias make half a wave of anything; 3 suffice, or 2.5 where wn is sure

    Samples on both sides of a gap count together: neither side of two periods would do alone.
    """
    whole, first, gap = short(), 9 * HZ, round(9 * HZ + 2.0 * PERIOD)
    u = whole.u[:, 0].copy()
    u[gap : gap + round(lost * HZ)] = np.nan
    samples = stream(u, y=whole.y).select(slice(first, first + round(periods * PERIOD)))

    verdict = told(samples).verdict
    assert any("periods" in reason.text for reason in verdict.fatal) == refused
    assert verdict.usable != refused


OWN = doublet(1.0, 1.2, 16.8)
YAW = yawing(OWN, 0.02)


def test_the_inner_part_of_its_own_rudder_has_no_wrong_answer():
    """A doublet with the same middle, .4 s shorter on both sides, moves the nose at the same time

    K is .3 and the yaw acceleration K wn^2.
    """
    found = told(stream(doublet(0.6, 1.6, 17.2), y=YAW))

    numbers = found.answer.physics["K"], found.answer.yaw_acceleration
    for number, true in zip(numbers, (0.3, 0.3 * WN**2), strict=True):
        assert not found.verdict.usable or abs(number.value - true) < 2.0 * number.std
    assert not found.verdict.usable or found.dutch_roll.wn_rad_s == pytest.approx(WN, rel=0.02)


def test_a_yaw_rate_that_is_late_is_named():
    """A third of a period late"""
    late = round(0.33 * PERIOD)
    y = np.concatenate([np.full(late, YAW[0]), YAW[:-late]])
    reasons = {each.id: each.text for each in told(stream(OWN, y=y)).verdict.reasons}

    assert "s later explains" in reasons["mode_not_driven"]
    assert "clock" not in reasons["mode_not_driven"]


@pytest.mark.parametrize(
    ("stroke_deg", "options", "usable"),
    [
        (4.0, {"rudder_unit": "deg"}, True),
        (1.1, {"rudder_unit": "deg"}, True),
        (0.6, {"rudder_unit": "deg"}, False),
        (0.6, {"rudder_max_deg": 1.0}, True),
    ],
)
def test_a_stroke_has_a_floor_in_deg_unless_the_travel_is_known(
    stroke_deg: float, options: dict[str, object], usable: bool
):
    """Of an unknown travel a part of the largest stroke says nothing"""
    stroke = math.radians(stroke_deg)
    options |= {} if "rudder_max_deg" in options else {"rudder_stroke_rad": stroke}
    found = told(stream(stroke / float(np.ptp(OWN)) * OWN, y=YAW), **options)

    assert found.verdict.usable == usable
    texts = [each.text for each in found.verdict.reasons if each.id == "not_excited"]
    assert usable or f"{stroke_deg:.2g} deg" in texts[0]
