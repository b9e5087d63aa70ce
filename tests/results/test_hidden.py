"""The cause that a refusal names is the one that was made: each on a case that has nothing else."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from yawid.blocks import Floats
from yawid.config.run import RunConfig
from yawid.estimation.bank import SampleHistory
from yawid.results.hidden import UNSEEN, clock_difference_s, rounding_deg, what_hides

TS_S, WN, ZETA = 0.05, 3.0, 0.2
N = 1200
IN_DEG = RunConfig(rudder_unit="deg", rudder_stroke_rad=math.radians(10.0))


def rudder(seed: int = 1) -> Floats:
    """Pedals that move to a new position every 0.6 s, by up to 3 deg, in rad."""
    levels = np.random.default_rng(seed).uniform(-3.0, 3.0, N // 12 + 1)
    smooth = np.convolve(np.repeat(levels, 12)[: N + 7], np.full(8, 0.125), "valid")
    return np.deg2rad(smooth)


def yawing(u: Floats, noise: float = 0.02) -> Floats:
    b, a, _ = cont2discrete(([WN**2, WN**2], [1, 2 * ZETA * WN, WN**2]), TS_S)
    y = lfilter(b[0], a, u)
    return y + noise * y.std() * np.random.default_rng(2).standard_normal(len(u))


def history(u: Floats, y: Floats, turn: Floats | float = 0.0) -> SampleHistory:
    nothing = np.full(N, np.nan)
    return SampleHistory(
        u=u[:, None], y=y, roll=np.zeros(N), turn_rate=np.broadcast_to(turn, N) + np.zeros(N),
        airspeed=np.full(N, 50.0), aileron=nothing, mode=nothing, y_hat={},
    )  # fmt: skip


def said(u: Floats, y: Floats, turn: Floats | float = 0.0, config: RunConfig = IN_DEG) -> str:
    return what_hides(history(u, y, turn), config, TS_S).text


def gusts(share: float, y: Floats) -> Floats:
    """A yaw rate of its own, as the same mode makes it of noise."""
    _, a, _ = cont2discrete(([1.0], [1, 2 * ZETA * WN, WN**2]), TS_S)
    own = lfilter([1.0], a, np.random.default_rng(5).standard_normal(len(y)))
    return share * y.std() / own.std() * own


@pytest.mark.parametrize("late_s", [0.3, -0.3, 0.6])
def test_clocks_that_differ_are_found_by_how_much(late_s: float):
    u = rudder()
    y = yawing(np.roll(u, round(late_s / TS_S)))
    y += gusts(1.0, y)
    y[:40] = np.nan

    assert clock_difference_s(u, y, TS_S) == pytest.approx(late_s, abs=TS_S)
    when = "later" if late_s > 0.0 else "earlier"
    assert f"{when}: the clocks" in said(u, y)


def test_a_rudder_that_follows_the_yaw_is_not_only_a_matter_of_clocks():
    """An autopilot that is carried along computes its rudder from a yaw rate of gusts"""
    y = gusts(1.0, yawing(rudder()))
    u = -0.2 * np.roll(y, 6) + 0.02 * rudder(4)
    assert "earlier: the clocks" in said(u, y)
    assert "or the rudder reacts to the yaw" in said(u, y)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_one_clock_is_not_called_two_even_in_gusts(seed: int):
    u = rudder(seed)
    clean = yawing(u)
    for y in (clean, clean + gusts(2.0, clean)):
        assert clock_difference_s(u, y, TS_S) == 0.0
        assert said(u, y) == UNSEEN


def test_a_rudder_rounded_to_a_degree_is_told_with_its_step():
    u = rudder()
    y = yawing(u, noise=0.5)
    rounded = np.deg2rad(np.round(np.rad2deg(u)))

    assert rounding_deg(rounded) == 1.0
    assert "rounded to 1 deg" in said(rounded, y)
    assert rounding_deg(u) == 0.0
    assert rounding_deg(np.deg2rad(np.round(np.rad2deg(u) / 0.1) * 0.1)) == 0.0  # fine enough


def test_a_commanded_doublet_of_whole_degrees_is_not_rounded():
    u = np.deg2rad(5.0) * np.repeat([0.0, 1.0, -1.0, 0.0] * 25, 12)
    assert rounding_deg(u) == 0.0


def test_a_turn_that_hides_the_rudder_is_told_with_its_cure():
    u = rudder()
    y = yawing(u)
    turn = 4.0 * y.std() * np.sin(2 * np.pi * np.arange(N) * TS_S / 20.0)

    found = what_hides(history(u, y + turn, turn), IN_DEG, TS_S)
    assert "try --turn remove" in found.text
    assert found.remedy == {"turn": "remove"}
    assert what_hides(history(u, y + turn, turn), IN_DEG, TS_S, is_copy=True).text == UNSEEN
    removed = replace(IN_DEG, turn="remove")
    assert said(u, y + turn, turn, removed) == UNSEEN  # it was tried
    assert said(u, y + gusts(4.0, y), turn) == UNSEEN  # it is none of the turn


def test_too_short_a_record_shows_nothing():
    u, y = np.full((2, N), np.nan)
    u[:30], y[:30] = np.random.default_rng(1).standard_normal((2, 30))
    assert said(u, y) == UNSEEN
