from __future__ import annotations

import itertools
import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from drawn import examples
from flightlog import FlightLog, samples_of
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scipy.signal import butter, sosfreqz

from yawid.blocks import AIRSPEED_SHARE, Held, Noted, SampleBlock, strokes
from yawid.channels.conditioning import Notes, butterworth
from yawid.config.run import RunConfig
from yawid.errors import ConfigError


def vfr_hud(airspeed: float, groundspeed: float) -> mavlink.MAVLink_vfr_hud_message:
    return mavlink.MAVLink_vfr_hud_message(airspeed, groundspeed, 0, 50, 100.0, 0.0)


def flight(
    airspeed: float | None = 20.0,
    groundspeed: float = 20.0,
    armed: bool = True,
    gap: tuple[float, float] = (99.0, 99.0),
    mode_at: float = 99.0,
    gust_at: float = 99.0,
    seconds: float = 30.0,
) -> bytes:
    """A weave with bank: r = rudder response + the turn rate of the bank."""
    log = FlightLog()
    for i in range(round(50 * seconds)):
        t = 0.02 * i
        if i % 50 == 0:
            mode = 10 if t >= mode_at else 5
            log.add(10 + t, mavlink.MAVLink_heartbeat_message(1, 3, 128 * armed, mode, 4, 3))
            if airspeed is not None:
                faster = 1.2 if t >= gust_at else 1.0
                log.add(10 + t, vfr_hud(faster * airspeed, groundspeed))
        if gap[0] < t < gap[1]:
            continue
        roll = 0.4 * math.sin(0.8 * t)
        turn = 9.80665 / 20.0 * math.sin(roll)
        log.attitude(10 + t, 0.1 * math.sin(3 * t) + turn, roll=roll)
        log.servos(10 + t + 0.003, [1500, 1500, 1500, round(1500 + 200 * math.sin(3 * t))])
    return log.data


def test_removing_the_turn_leaves_what_the_bank_did_not_make():
    kept = samples_of(flight())
    removed = samples_of(flight(), RunConfig(turn="remove"))

    weave = 0.1 * np.sin(3 * (removed.k * 0.05 - 10.0))
    good = removed.held == 0
    # What is left is the interpolation between messages that are 20 ms apart.
    np.testing.assert_allclose(removed.y[good], weave[good], atol=2e-4)
    assert np.abs(kept.y - weave).max() > 0.15


def test_removing_the_turn_without_an_airspeed_holds_every_sample():
    found = samples_of(flight(airspeed=None), RunConfig(turn="remove"))

    assert set(found.held) == {Held.NO_AIRSPEED}
    assert np.isnan(found.y).all()


@pytest.mark.parametrize(
    ("airspeed", "groundspeed", "armed", "on_ground"),
    [
        (20.0, 20.0, True, False),
        (1.0, 1.0, True, True),
        (63.0, 0.0, False, True),  # VFR_HUD at boot
        (18.0, 2.0, True, False),  # into the wind
        (1.0, 20.0, True, False),  # a blocked pitot tube
        (None, 0.0, False, False),  # nobody tells
    ],
)
def test_on_the_ground_by_both_speeds_and_arming(airspeed, groundspeed, armed, on_ground):
    found = samples_of(flight(airspeed, groundspeed, armed, seconds=10.0))

    assert set(found.held) == {int(Held.ON_GROUND) if on_ground else 0}


def test_the_first_sample_of_another_mode_is_noted():
    found = samples_of(flight(mode_at=15.0))

    changed = np.flatnonzero(found.noted & Noted.MODE_CHANGED)
    assert len(changed) == 1
    assert found.boot_us[changed[0]] == pytest.approx(25e6, abs=0.1e6)


def test_a_rudder_at_its_stop_is_noted_and_still_counts():
    log = FlightLog()
    log.heartbeat(10.0)
    for i in range(500):
        log.attitude(10 + 0.02 * i, 0.1)
        log.servos(10.003 + 0.02 * i, [1500, 1500, 1500, 1900 if i > 250 else 1500])
    found = samples_of(log.data)

    saturated = (found.noted & Noted.SATURATED) != 0
    assert saturated.sum() == pytest.approx(98, abs=4)
    assert not found.held.any()


def noted(found, flag: Noted) -> np.ndarray:
    return (found.noted & flag) != 0


def test_another_airspeed_than_the_last_minutes_is_noted_and_still_counts():
    log = FlightLog()
    for i in range(50 * 120):
        t = 0.02 * i
        if i % 12 == 0:
            log.heartbeat(10 + t)
            speed = 20.0 if t < 60.0 else 21.9 if t < 80.0 else 25.0
            log.add(10 + t, vfr_hud(speed, 20.0))
        log.attitude(10 + t, 0.1)
        log.servos(10.003 + t, [1500] * 4)
    found = samples_of(log.data)

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


def test_a_rudder_at_rest_for_five_seconds_is_noted_not_excited():
    log = FlightLog()
    log.heartbeat(10.0)
    for i in range(50 * 30):
        t = 0.02 * i
        log.attitude(10 + t, 0.1)
        moves = 10.0 <= t < 20.0
        pulse = 1500 + (round(100 * math.sin(3.0 * t)) if moves else i % 5)
        log.servos(10.003 + t, [1500, 1500, 1500, pulse])
    found = samples_of(log.data)

    at_rest = found.boot_us[noted(found, Noted.NOT_EXCITED)] / 1e6 - 10.0
    assert ((at_rest < 10.1) | (at_rest > 24.9)).all()
    assert len(at_rest) == pytest.approx(20 * 15, abs=4)
    assert not found.held.any()


def test_the_travel_that_counts_as_rest_does_not_depend_on_the_unit():
    plain, degrees = (samples_of(flight(), RunConfig(rudder_max_deg=d)) for d in (None, 0.5))

    np.testing.assert_array_equal(plain.noted, degrees.noted)
    assert noted(plain, Noted.NOT_EXCITED).sum() < 10


@given(
    u=st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=60),
    window=st.integers(2, 12),
    cut=st.integers(1, 59),
)
def test_the_stroke_is_that_of_the_newest_window_wherever_the_stream_is_cut(u, window, cut):
    values = np.array(u)
    expected = [np.ptp(values[max(0, i + 1 - window) : i + 1]) for i in range(len(u))]

    np.testing.assert_array_equal(strokes(values, window), expected)
    if cut < len(u):
        later = strokes(values[cut:], window, values[:cut])
        np.testing.assert_array_equal(later, expected[cut:])


@cache
def weave() -> SampleBlock:
    return samples_of(flight(seconds=25.0))


@given(cuts=st.lists(st.integers(1, 399), max_size=6, unique=True), seed=st.integers(0, 50))
def test_notes_do_not_depend_on_the_cut_and_a_new_meaning_of_the_rudder_is_new_rest(cuts, seed):
    rng = np.random.default_rng(seed)
    flown = weave()
    columns = [getattr(flown, name)[:400] for name in SampleBlock.__slots__[1:]]
    block = SampleBlock(flown.blocks[0].sample_time_s, *columns)
    u = 0.1 * np.repeat(rng.choice([0.0, 0.0, 1.0], 8), 50)
    block = replace(block, u=u[:, None], airspeed=20.0 + 2.0 * rng.standard_normal(400))
    block = replace(block, held=np.where(rng.random(400) < 0.1, int(Held.GAP), 0))
    whole, parts = Notes(0.1, 1.0), Notes(0.1, 1.0)

    expected = whole.feed_samples(block)
    edges = [0, *sorted(cuts), 400]
    pieces = [parts.feed_samples(block.select(slice(*pair))) for pair in itertools.pairwise(edges)]

    np.testing.assert_array_equal(np.concatenate([p.noted for p in pieces]), expected.noted)
    renamed = replace(block, u=0.0 * block.u + 0.7, epoch=block.epoch + 1)
    used = renamed.held == 0
    assert (whole.feed_samples(renamed).noted[used] & Noted.NOT_EXCITED != 0).all()


def test_a_held_sample_is_neither_noted_nor_counted():
    found = samples_of(flight(airspeed=1.0, groundspeed=1.0))

    assert set(found.held) == {int(Held.ON_GROUND)}
    assert not found.noted.any()


@pytest.mark.parametrize(("high", "rate"), [(5.0, 10.0), (7.0, 10.0), (10.0, 20.0)])
def test_a_band_that_reaches_to_half_the_rate_is_refused(high, rate):
    with pytest.raises(ConfigError, match=f"must end below {rate / 2:g} Hz"):
        butterworth((0.5, high), "bandpass", rate)


@given(low=st.floats(0.05, 1.0), factor=st.floats(1.5, 4.9), rate=st.sampled_from([10.0, 20.0]))
def test_the_band_pass_is_scipys_and_halves_power_at_its_edges(low, factor, rate):
    high = low * factor
    sections = butterworth((low, high), "bandpass", rate)

    np.testing.assert_array_equal(
        sections, butter(2, (low, high), "bandpass", fs=rate, output="sos")
    )
    _, response = sosfreqz(sections, [low, high], fs=rate)
    np.testing.assert_allclose(np.abs(response), math.sqrt(0.5), rtol=1e-6)


def test_inputs_and_output_pass_the_same_filter():
    found = samples_of(flight(), RunConfig(band=(0.2, 3.0), turn="remove"))
    plain = samples_of(flight(), RunConfig(turn="remove"))

    # In band: what is sinusoidal stays so, by the same factor and phase on both.
    late = slice(300, None)
    gain = []
    for name in ("u", "y"):
        a, b = np.ravel(getattr(found, name))[late], np.ravel(getattr(plain, name))[late]
        carrier = np.exp(-1j * 3.0 * plain.k[late] * 0.05)
        window = np.hanning(len(a))
        gain.append((a * carrier * window).sum() / (b * carrier * window).sum())
    assert abs(gain[0] / gain[1] - 1.0) < 1e-3


EVENTFUL = flight(gap=(12.0, 13.5), mode_at=20.0, gust_at=24.0)


@examples(15)
@given(
    cuts=st.lists(st.integers(0, len(EVENTFUL)), max_size=20),
    output=st.sampled_from(["yaw-rate", "yaw"]),
)
def test_conditioned_samples_do_not_depend_on_the_cut(cuts, output):
    config = RunConfig(band=(0.2, 3.0), turn="remove", output=output)
    whole, cut = samples_of(EVENTFUL, config), samples_of(EVENTFUL, config, cuts)

    noted = set(whole.noted & ~int(Noted.GROUND_SPEED))
    assert noted >= {0, Noted.MODE_CHANGED, Noted.AIRSPEED_CHANGED, Noted.NOT_EXCITED}
    for name in ("u", "y", "held", "noted", "turn_rate", "airspeed"):
        np.testing.assert_array_equal(getattr(cut, name), getattr(whole, name), err_msg=name)
