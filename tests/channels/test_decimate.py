"""The low-pass before the grid: vibration the grid cannot tell must not fold into it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from flightlog import FlightLog, fly, samples_of
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import butter, sosfilt

from yawid.blocks import Held, SampleBlock
from yawid.channels.conditioning import GridFilter, butterworth, finer_by
from yawid.config.run import RunConfig

BAND = RunConfig(rate=10.0, band=(0.02, 2.5))
COLUMNS = ("k", "boot_us", "unix_ns", "received_us", "u", "y", "yaw", "roll", "noted", "held")


def swinging(t: float) -> float:
    return 0.2 * math.sin(2.5 * t)


def vibrating(t: float) -> float:
    return swinging(t) + 0.05 * math.sin(2.0 * math.pi * 8.3 * t)


def pulse(t: float) -> int:
    return round(1500 + 200 * math.sin(2.5 * t))


@pytest.mark.parametrize("servo_s", [0.02, 0.1])
@pytest.mark.parametrize(("config", "least", "most"), [(BAND, 0.0, 4e-3), (None, 0.03, 0.04)])
def test_vibration_above_half_the_rate_leaves_no_trace_with_a_band(config, least, most, servo_s):
    config = config or RunConfig(rate=10.0)
    logs = (fly(y, pulse, 90.0, servo_s=servo_s) for y in (swinging, vibrating))
    calm, shaken = (samples_of(log.data, config) for log in logs)

    # The band's lower corner takes three quarters of a minute to forget the first sample.
    difference = np.std((shaken.y - calm.y)[500:])

    assert least <= difference <= most


def eventful() -> bytes:
    """A gap, a rudder that is off, a trim told in flight, a rudder renamed and a reboot."""
    log = fly(vibrating, pulse, 12.0, skip=lambda t: 4.0 < t < 5.5)
    log.parameter(22.0, "SERVO4_FUNCTION", 21)
    more = fly(vibrating, lambda t: 0 if 3.0 < t < 3.6 else pulse(t), 8.0, start_s=22.0)
    named = FlightLog()
    named.parameter(30.0, "SERVO4_FUNCTION", 0)
    named.parameter(30.0, "SERVO3_FUNCTION", 21)
    last = fly(vibrating, pulse, 8.0, start_s=30.01)
    again = fly(vibrating, pulse, 8.0, start_s=2.0)
    return log.data + more.data + named.data + last.data + again.data


EVENTFUL = eventful()


@given(cuts=st.lists(st.integers(0, len(EVENTFUL)), max_size=30))
def test_thinned_samples_do_not_depend_on_the_cut(cuts):
    whole, cut = samples_of(EVENTFUL, BAND), samples_of(EVENTFUL, BAND, cuts)

    assert set(whole.epoch) == {0, 1}
    for name in (*COLUMNS, "epoch"):
        np.testing.assert_array_equal(getattr(cut, name), getattr(whole, name), err_msg=name)


def test_the_samples_are_those_of_the_grid_without_a_band_held_for_the_same_reasons():
    thinned, plain = (samples_of(EVENTFUL, c) for c in (BAND, RunConfig(rate=10.0)))

    assert thinned.blocks[0].sample_time_s == plain.blocks[0].sample_time_s == 0.1
    for epoch in (0, 1):
        used = [
            {*zip(s.k[good], s.boot_us[good], strict=True)}
            for s in (thinned, plain)
            for good in [(s.held == 0) & (s.epoch == epoch)]
        ]
        # At each break a sample of which a part is missing may be lost, none is invented.
        assert used[0] <= used[1]
        assert len(used[1] - used[0]) <= 5
    assert set(thinned.held) == set(plain.held)
    assert Held.GAP in thinned.held
    assert (np.diff(thinned.unix_ns) >= 0).all()
    np.testing.assert_allclose(
        thinned.boot_us, np.rint(thinned.k * 1e5), rtol=0.0, atol=0.0, strict=False
    )


def thinning() -> GridFilter:
    """Return the filter that makes one sample of 0.1 s of five, with a corner of 3 Hz."""
    return GridFilter(butterworth(3.0, "low", 50.0), 5, 0.1)


def fine_block(n: int, sample_time_s: float, first: int = 0) -> SampleBlock:
    rng = np.random.default_rng(3)
    k = first + np.arange(n)
    us = np.rint(k * 1e6 * sample_time_s).astype(np.int64)
    zero, number = np.zeros(n), np.zeros(n, np.int64)
    u, y = rng.standard_normal((n, 1)), rng.standard_normal(n)
    return SampleBlock(
        sample_time_s, k, us, us * 1000, us, u, y, *[zero] * 4, *[number] * 3, *[zero] * 7
    )


def test_u_is_the_mean_and_y_the_value_at_the_instant_of_what_the_low_pass_leaves():
    fine = fine_block(400, 0.02, first=7)

    found = thinning().feed_samples(fine)

    sections = butter(2, 3.0, fs=50.0, output="sos")
    start = [np.ones(1000) * signal[0] for signal in (fine.u[:, 0], fine.y)]
    u, y = (
        sosfilt(sections, np.concatenate([rest, signal]))[1000:]
        for rest, signal in zip(start, (fine.u[:, 0], fine.y), strict=True)
    )
    assert found.k.tolist() == list(range(2, 81))
    np.testing.assert_allclose(found.u[:, 0], u[3:398].reshape(-1, 5).mean(axis=1), atol=1e-9)
    np.testing.assert_allclose(found.y, y[3:398:5], atol=1e-9)
    assert found.received_us.tolist() == [20_000 * (5 * k + 4) for k in range(2, 81)]


def numbered(k: list[int], held_at: int, why: Held, epoch: int = 0) -> SampleBlock:
    block = fine_block(len(k), 0.02)
    held = np.zeros(len(k), np.int64)
    held[held_at] = int(why)
    return replace(block, k=np.array(k), held=held, epoch=np.full(len(k), epoch))


def test_a_segment_that_begins_anew_within_a_sample_spoils_no_complete_one():
    fine = numbered([*range(10, 15), 14, *range(15, 20)], held_at=5, why=Held.REBOOT)

    found = thinning().feed_samples(fine)

    assert found.k.tolist() == [2, 2, 3]
    assert found.held.tolist() == [0, Held.REBOOT, 0]


def test_no_sample_is_made_of_two_meanings_of_the_rudder():
    decimator = thinning()
    before = numbered([10, 11, 12], held_at=0, why=Held.NONE)
    after = numbered([13, 14, *range(15, 20)], held_at=0, why=Held.RUDDER_CHANGED, epoch=1)

    assert decimator.feed_samples(before) is None
    found = decimator.feed_samples(after)

    assert found.k.tolist() == [2, 3]
    assert found.held.tolist() == [Held.RUDDER_CHANGED, 0]
    assert set(found.epoch) == {1}


@pytest.mark.parametrize(
    ("sample_time_s", "interval_us", "count"),
    [(0.1, 20_000, 5), (0.1, 19_900, 5), (0.05, 20_000, 3), (0.1, 100_000, 1), (0.1, 200_000, 1)],
)
def test_the_fine_grid_is_as_fine_as_the_messages(sample_time_s, interval_us, count):
    assert finer_by(sample_time_s, interval_us) == count
