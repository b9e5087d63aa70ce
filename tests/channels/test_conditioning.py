"""Turns removed, bands, notes on samples: what is done to the grid before it is learned from."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from flightlog import Samples, beat, every, fly, hud, samples_of
from scipy.signal import butter, sosfilt, sosfreqz

from yawid.blocks import AIRSPEED_SHARE, Held, Noted, SampleBlock
from yawid.channels.conditioning import GridFilter, butterworth
from yawid.config.run import RunConfig
from yawid.errors import ConfigError


@cache
def flight(
    airspeed: float | None = 20.0,
    groundspeed: float = 20.0,
    armed: bool = True,
    mode_at: float = 99.0,
    seconds: float = 30.0,
) -> bytes:
    """A weave with bank: r = rudder response + the turn rate of the bank."""

    def roll(t: float) -> float:
        return 0.4 * math.sin(0.8 * t)

    more = every(1.0, seconds, lambda t: beat(1, 3, 128 * armed, 10 if t >= mode_at else 5))
    if airspeed is not None:
        more += every(1.0, seconds, lambda t: hud(airspeed, groundspeed))
    return fly(
        lambda t: 0.1 * math.sin(3 * t) + 9.80665 / 20.0 * math.sin(roll(t)),
        lambda t: round(1500 + 200 * math.sin(3 * t)),
        seconds,
        roll=roll,
        vehicle=beat(1, 3, 128 * armed, 5),
        more=more,
    ).data


def test_removing_the_turn_leaves_what_the_bank_did_not_make():
    kept = samples_of(flight())
    removed = samples_of(flight(), RunConfig(turn="remove"))

    weave = 0.1 * np.sin(3 * (removed.k * 0.05 - 10.0))
    good = removed.held == 0
    # What is left is the interpolation between messages that are 20 ms apart.
    np.testing.assert_allclose(removed.y[good], weave[good], atol=2e-4)
    assert np.abs(kept.y - weave).max() > 0.15
    unknown = samples_of(flight(airspeed=None), RunConfig(turn="remove"))
    assert set(unknown.held) == {Held.NO_AIRSPEED}
    assert np.isnan(unknown.y).all()


def noted(found: Samples, flag: Noted) -> np.ndarray:
    return (found.noted & flag) != 0


def test_the_first_sample_of_another_mode_is_noted():
    found = samples_of(flight(mode_at=15.0))

    (changed,) = np.flatnonzero(noted(found, Noted.MODE_CHANGED))
    assert found.boot_us[changed] == pytest.approx(25e6, abs=0.1e6)


def test_a_rudder_at_its_stop_or_at_rest_for_five_seconds_is_noted_and_still_counts():
    def pulse(t: float) -> int:
        if 10.0 <= t < 20.0:
            return 1500 + round(100 * math.sin(3.0 * t))
        return 1900 if t >= 28.0 else 1500 + round(50 * t) % 5

    log = fly(lambda t: 0.1, pulse, 30.0).data
    plain, degrees = (samples_of(log, RunConfig(rudder_max_deg=d)) for d in (None, 0.5))

    at_rest = plain.boot_us[noted(plain, Noted.NOT_EXCITED)] / 1e6 - 10.0
    assert ((at_rest < 10.1) | (at_rest > 24.9)).all()
    assert len(at_rest) == pytest.approx(20 * 13, abs=4)
    assert noted(plain, Noted.SATURATED).sum() == pytest.approx(39, abs=2)
    assert not plain.held.any()
    np.testing.assert_array_equal(plain.noted, degrees.noted)


def test_another_airspeed_than_the_last_minutes_is_noted_and_still_counts():
    def speed_at(t: float) -> float:
        return 20.0 if t < 60.0 else 21.9 if t < 80.0 else 25.0

    speeds = every(0.24, 120.0, lambda t: hud(speed_at(t), 20.0))
    found = samples_of(fly(lambda t: 0.1, lambda t: 1500, 120.0, more=speeds).data)

    speed, age = found.airspeed, np.arange(len(found)) * 0.05
    mean = [
        np.average(speed[: i + 1], weights=np.exp(-age[i::-1] / 60.0)) for i in range(len(found))
    ]
    flagged = noted(found, Noted.AIRSPEED_CHANGED)
    assert (flagged == (np.abs(speed / np.array(mean) - 1.0) > AIRSPEED_SHARE)).mean() > 0.999
    first, last = found.boot_us[flagged][[0, -1]] / 1e6 - 10.0
    assert first == pytest.approx(80.2, abs=0.3)
    assert 100.0 < last < 115.0  # by then the faster half minute is half of what is remembered
    assert not found.held.any()


@pytest.mark.parametrize(("high", "rate"), [(5.0, 10.0), (7.0, 10.0), (10.0, 20.0)])
def test_a_band_that_reaches_to_half_the_rate_is_refused(high, rate):
    with pytest.raises(ConfigError, match=f"must end below {rate / 2:g} Hz"):
        butterworth((0.5, high), "bandpass", rate)


def test_inputs_and_output_pass_the_same_filter_which_halves_power_at_its_edges():
    _, response = sosfreqz(butterworth((0.2, 3.0), "bandpass", 20.0), [0.2, 3.0], fs=20.0)
    np.testing.assert_allclose(np.abs(response), math.sqrt(0.5), rtol=1e-6)

    found = samples_of(flight(), RunConfig(band=(0.2, 3.0), turn="remove"))
    plain = samples_of(flight(), RunConfig(turn="remove"))
    # In band: what is sinusoidal stays so, by the same factor and phase on both.
    late = slice(300, None)
    carrier = np.exp(-1j * 3.0 * plain.k[late] * 0.05) * np.hanning(len(plain) - 300)
    gain = [
        (np.ravel(a)[late] * carrier).sum() / (np.ravel(b)[late] * carrier).sum()
        for a, b in ((found.u, plain.u), (found.y, plain.y))
    ]
    assert abs(gain[0] / gain[1] - 1.0) < 1e-3
    assert 0.9 < abs(gain[0]) < 1.01


@pytest.mark.parametrize("servo_s", [0.02, 0.1])
@pytest.mark.parametrize(("band", "least", "most"), [((0.02, 2.5), 0.0, 4e-3), (None, 0.03, 0.04)])
def test_vibration_above_half_the_rate_leaves_no_trace_with_a_band(band, least, most, servo_s):
    def swinging(t: float, vibration: float) -> float:
        return 0.2 * math.sin(2.5 * t) + vibration * math.sin(2.0 * math.pi * 8.3 * t)

    calm, shaken = (
        samples_of(
            fly(
                lambda t, by=by: swinging(t, by),
                lambda t: round(1500 + 200 * math.sin(2.5 * t)),
                90.0,
                servo_s=servo_s,
            ).data,
            RunConfig(rate=10.0, band=band),
        )
        for by in (0.0, 0.05)
    )
    # The band's lower corner takes three quarters of a minute to forget the first sample.
    assert least <= np.std((shaken.y - calm.y)[500:]) <= most


def thinning() -> GridFilter:
    """Return the filter that makes one sample of 0.1 s of five, with a corner of 3 Hz."""
    return GridFilter(butterworth(3.0, "low", 50.0), 5, 0.1)


def fine_block(k: np.ndarray, held_at: int = 0, why: Held = Held.NONE, epoch: int = 0):
    rng = np.random.default_rng(3)
    n, us = len(k), np.rint(k * 20_000).astype(np.int64)
    zero, number = np.zeros(n), np.zeros(n, np.int64)
    u, y = rng.standard_normal((n, 1)), rng.standard_normal(n)
    block = SampleBlock(
        0.02, k, us, us * 1000, us, u, y, *[zero] * 4, *[number] * 3, *[zero] * 7
    )  # fmt: skip
    held = np.where(np.arange(n) == held_at, int(why), 0)
    return replace(block, held=held, epoch=np.full(n, epoch))


def test_u_is_the_mean_and_y_the_value_at_the_instant_of_what_the_low_pass_leaves():
    fine = fine_block(np.arange(7, 407))

    found = thinning().feed_samples(fine)

    sections = butter(2, 3.0, fs=50.0, output="sos")
    u, y = (
        sosfilt(sections, np.concatenate([np.full(1000, signal[0]), signal]))[1000:]
        for signal in (fine.u[:, 0], fine.y)
    )
    assert found.k.tolist() == list(range(2, 81))
    np.testing.assert_allclose(found.u[:, 0], u[3:398].reshape(-1, 5).mean(axis=1), atol=1e-9)
    np.testing.assert_allclose(found.y, y[3:398:5], atol=1e-9)
    assert found.received_us.tolist() == [20_000 * (5 * k + 4) for k in range(2, 81)]


def test_no_sample_is_made_of_two_segments_or_of_two_meanings_of_the_rudder():
    again = fine_block(np.array([*range(10, 15), 14, *range(15, 20)]), 5, Held.REBOOT)
    found = thinning().feed_samples(again)
    assert (found.k.tolist(), found.held.tolist()) == ([2, 2, 3], [0, Held.REBOOT, 0])

    decimator = thinning()
    assert decimator.feed_samples(fine_block(np.arange(10, 13))) is None
    found = decimator.feed_samples(fine_block(np.arange(13, 20), 0, Held.RUDDER_CHANGED, epoch=1))
    assert (found.k.tolist(), found.held.tolist()) == ([2, 3], [Held.RUDDER_CHANGED, 0])
    assert set(found.epoch) == {1}
