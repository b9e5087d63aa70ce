"""Aircraft whose Dutch roll is slow: their records ring on after the rudder has come to rest."""

import math

import numpy as np
import pytest
from manoeuvre.streams import HZ, TS_S, flown, found_in, rest, stream
from scipy.signal import cont2discrete, lfilter

from yawid.blocks import Floats, SampleBlock
from yawid.config.run import RunConfig
from yawid.manoeuvre.answered import answer
from yawid.manoeuvre.judge import ManoeuvreSetting

WN, ZETA = 1.9, 0.1
"""Those of a jet on approach: a period lasts 3.3 s."""
SETTING = ManoeuvreSetting(RunConfig(), TS_S, (20.0, 20.0), (3, 1))


def yawing(rudder: Floats) -> Floats:
    """The yaw rate (n,) with a little noise."""
    b, a, _ = cont2discrete(([0.3 * WN**2, 0.3 * WN**2], [1, 2 * ZETA * WN, WN**2]), TS_S)
    noise = np.random.default_rng(3).standard_normal(len(rudder))
    return lfilter(b[0], a, rudder) + 0.002 * noise


def doublet(rest_s: float = 30.0) -> SampleBlock:
    """A doublet of 1.4 s in all, between rests."""
    rudder = flown(rest(10), rest(0.7, 0.2), rest(0.7, -0.2), rest(rest_s))
    return stream(rudder, y=yawing(rudder))


def test_a_short_doublet_answers_by_its_free_decay():
    """Until 5 s of rest it had 1 + 1.4 + 5 s: 2.2 periods"""
    (samples,) = found_in(doublet())
    found = answer(samples, 1, SETTING)

    assert len(samples) * TS_S * WN / (2.0 * math.pi) > 3.0
    assert samples.k[-1] < (10 + 1.4 + 15) * HZ
    assert found.verdict.usable
    assert found.dutch_roll.wn_rad_s == pytest.approx(WN, rel=0.02)
    assert found.dutch_roll.zeta == pytest.approx(ZETA, abs=0.02)
    cut = found_in(doublet(rest_s=5.0))[0]
    assert len(cut) * TS_S * WN / (2.0 * math.pi) < 2.3


def test_samples_on_both_sides_of_a_gap_count_together():
    """Two periods, a gap of 1.8 s, and two more: neither side would do alone"""
    whole = doublet()
    first, gap = 9 * HZ, round(1.8 * HZ)
    side = round(2 * 2 * math.pi / WN * HZ)
    u = whole.u[:, 0].copy()
    u[first + side : first + side + gap] = np.nan
    samples = stream(u, y=whole.y).select(slice(first, first + 2 * side + gap))

    assert answer(samples, 1, SETTING).verdict.usable


@pytest.mark.parametrize(("periods", "refused"), [(1.9, True), (2.3, True), (3.2, False)])
def test_a_record_of_too_few_periods_is_refused(periods: float, refused: bool):
    """A drift and a bias make half a wave of anything; 3 suffice, or 2.5 where wn is sure"""
    low = 9 * HZ
    samples = doublet().select(slice(low, low + round(periods * 2 * math.pi / WN * HZ)))

    verdict = answer(samples, 1, SETTING).verdict
    assert any("periods" in reason.text for reason in verdict.fatal) == refused
    assert verdict.usable != refused
