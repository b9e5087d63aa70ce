"""Aircraft whose Dutch roll is slow: their records ring on after the rudder has come to rest."""

import math

import numpy as np
import pytest
from manoeuvre.streams import HZ, TS_S, flown, found_in, rest, stream
from scipy.signal import cont2discrete, lfilter
from yawid.manoeuvres.answer import Fits, ManoeuvreSetting, short_reasons
from yawid.manoeuvres.tries import answer
from yawid.results.judge_estimate import Evidence

from yawid.blocks import Floats, SampleBlock
from yawid.config.run import RunConfig

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
    assert found.found.dutch_roll.wn_rad_s == pytest.approx(WN, rel=0.02)
    assert found.found.dutch_roll.zeta == pytest.approx(ZETA, abs=0.02)
    cut = found_in(doublet(rest_s=5.0))[0]
    assert len(cut) * TS_S * WN / (2.0 * math.pi) < 2.3


def periods_reasons(periods: float, share: float) -> list[str]:
    """What is said of a record of so many periods whose sigma of wn is this part of it."""
    low = 9 * HZ
    samples = doublet().select(slice(low, low + round(periods * 2 * math.pi / WN * HZ)))
    fits = Fits(SETTING, SETTING.config, samples)
    said = short_reasons(fits, fits.history(), evidence(share))
    return [r.text for r in said if "periods" in r.text]


def evidence(share: float) -> Evidence:
    nothing = np.full(2, np.nan)
    return Evidence(
        status=1, updates=100, dutch_roll=np.array([WN, 0.01, ZETA, 0.01]),
        total_std=np.array([share * WN, 0.01]), next_moves=nothing, rate_moves=nothing,
        whiteness_p=0.5, autocorrelation=0.0, spr_margin=1.0, early_response=1.0,
        simulation_pct=90.0, held_back_pct=90.0, before=nothing,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("periods", "share", "refused"),
    [(2.6, 0.029, False), (2.6, 0.031, True), (2.4, 0.01, True), (3.1, 0.09, False)],
)
def test_two_and_a_half_periods_suffice_where_wn_is_surely_known(
    periods: float, share: float, refused: bool
):
    assert bool(periods_reasons(periods, share)) == refused


def test_samples_on_both_sides_of_a_gap_count_together():
    """Two periods, a gap of 1.8 s, and two more: neither side would do alone"""
    whole = doublet()
    first, gap = 9 * HZ, round(1.8 * HZ)
    side = round(2 * 2 * math.pi / WN * HZ)
    u = whole.u[:, 0].copy()
    u[first + side : first + side + gap] = np.nan
    samples = stream(u, y=whole.y).select(slice(first, first + 2 * side + gap))
    fits = Fits(SETTING, SETTING.config, samples)

    said = [each.text for each in short_reasons(fits, fits.history(), evidence(0.09))]
    assert not any("periods" in text for text in said)
    assert answer(samples, 1, SETTING).verdict.usable
