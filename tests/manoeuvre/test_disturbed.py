"""Manoeuvres in gusts, drift, turns and vibration: the answer is right by its sigma, or none."""

from __future__ import annotations

import numpy as np
import pytest
from manoeuvre.streams import HZ, TS_S, WN, ZETA, flown, rest, stream, yawing
from manoeuvre.test_answered import told
from manoeuvre.test_feedback import doublets
from manoeuvre.test_feedback import flown as with_damper
from scipy.signal import butter, cont2discrete, lfilter

from yawid.answers.run_summary import DutchRoll
from yawid.blocks import Floats


def pulses(seconds: float, rows: int, seed: int) -> Floats:
    """Pulses of so many samples that go either way, between rests"""
    signs = np.random.default_rng(seed).choice([-0.2, 0.2], size=round(seconds * HZ / rows) + 1)
    return flown(rest(1), np.repeat(signs, rows)[: round(seconds * HZ)], rest(5))


RUDDER = pulses(30.0, 6, 1)
CALM = yawing(RUDDER, noise=0.004)
SLOW = pulses(40.0, 16, 1)


def gusts(share: float) -> Floats:
    """What gusts do: they pass through the aircraft's own mode"""
    b, a, _ = cont2discrete(([WN], [1.0, 2.0 * ZETA * WN, WN**2]), TS_S)
    x = lfilter(b[0], a, np.random.default_rng(4).standard_normal(len(CALM)))
    return share * CALM.std() * x / x.std()


def slow(share: float, corner_hz: float, seed: int, n: int) -> Floats:
    """A drift below the mode, of this share of the calm yaw rate"""
    white = np.random.default_rng(seed).standard_normal(n + 400)
    x = lfilter(*butter(2, corner_hz / (HZ / 2)), white)[400:]
    return share * CALM.std() * x / x.std()


def vibrating(rudder: Floats, noise: float = 0.0, seed: int = 1) -> Floats:
    """A line at 6 Hz as large as the yaw rate, whose phase drifts as a motor's does"""
    t = np.arange(len(rudder)) * TS_S
    drift = 0.09 * np.cumsum(np.random.default_rng(3).standard_normal(len(t)))
    gyro = noise * np.random.default_rng(seed).standard_normal(len(t))
    return yawing(rudder, noise=0.002) + 0.2 * np.sin(37.7 * t + drift) + gyro


def assert_within(roll: DutchRoll, sigmas: float = 2.0) -> None:
    assert abs(roll.wn_rad_s - WN) < sigmas * roll.wn_std
    assert abs(roll.zeta - ZETA) < sigmas * roll.zeta_std


@pytest.mark.parametrize("share", [0.0, 0.02, 0.1, 0.5])
def test_in_gusts_sigma_grows_with_them(share: float):
    roll = told(stream(RUDDER, y=CALM + gusts(share))).dutch_roll

    assert_within(roll)
    assert (roll.wn_std > 0.03 * WN) == (share > 0.3)


@pytest.mark.parametrize("drift", [True, False])
def test_a_drift_or_noise_of_a_fifth_of_the_yaw_rate_moves_nothing(drift: bool):
    """Of a free run of the model, a drift made wn 1.8 % and zeta .027 wrong"""
    white = 0.2 * CALM.std() * np.random.default_rng(7).standard_normal(len(CALM))
    found = told(stream(RUDDER, y=CALM + (slow(0.4, 0.2, 7, len(CALM)) if drift else white)))

    assert found.verdict.usable
    assert found.dutch_roll.wn_rad_s == pytest.approx(WN, rel=0.01)
    assert found.dutch_roll.zeta == pytest.approx(ZETA, abs=0.01)


def test_a_vibration_above_the_mode_is_not_taken_for_it():
    found = told(stream(SLOW, y=vibrating(SLOW)))

    assert found.verdict.usable
    assert found.dutch_roll.wn_rad_s == pytest.approx(WN, rel=0.02)
    assert found.dutch_roll.zeta == pytest.approx(ZETA, abs=0.02)


@pytest.mark.parametrize(("noise", "seed"), [(0.15, 9), (0.165, 15), (0.165, 16), (0.18, 8)])
def test_in_vibration_and_noise_the_answer_is_right_or_none(noise: float, seed: int):
    found = told(stream(SLOW, y=vibrating(SLOW, noise, seed)))

    assert found.dutch_roll is None or found.dutch_roll.wn_rad_s == pytest.approx(WN, rel=0.1)
    if found.verdict.usable:
        assert_within(found.dutch_roll)


def test_turns_as_large_as_the_yaw_are_removed_where_asked():
    turn = slow(0.15 / CALM.std(), 0.15, 2, len(SLOW))
    found = told(stream(SLOW, y=yawing(SLOW, noise=0.002) + turn, turn=turn))
    removed = told(stream(SLOW, y=yawing(SLOW, noise=0.002), turn=turn), turn="remove")

    assert found.dutch_roll is not None
    assert_within(found.dutch_roll)
    assert removed.verdict.usable
    assert removed.dutch_roll.wn_rad_s == pytest.approx(WN, rel=0.02)


@pytest.mark.parametrize("seed", [100, 101, 102])
def test_a_rudder_that_does_nothing_stays_refused(seed: int):
    """A line, turns and gusts, none of them the rudder's: none of them is a Dutch roll"""
    foreign = pulses(40.0, 16, seed)
    turn = slow(0.15 / CALM.std(), 0.15, 2, len(SLOW))
    for y, bank in ((vibrating(SLOW), 0.0), (yawing(SLOW, noise=0.002) + turn, turn)):
        assert not told(stream(foreign, y=y, turn=bank)).verdict.usable


@pytest.mark.parametrize(
    ("gain", "reasons"), [(0.2, []), (0.6, ["closed_loop"]), (1.5, ["mode_not_driven"])]
)
def test_a_rudder_that_mostly_feeds_back_the_yaw_rate_is_warned_of_and_then_refused(
    gain: float, reasons: list[str]
):
    """Near the mode that part is .33, .81 and 1.3 of the whole rudder"""
    rudder, rate, _ = with_damper(gain, doublets(4), 0.002)
    found = told(stream(rudder, y=rate))

    assert [each.id for each in found.verdict.reasons] == reasons
