from __future__ import annotations

import math

import numpy as np
import pytest
from flightlog import FlightLog, samples_of
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scipy.signal import butter, sosfreqz

from yawid.blocks import Held, Noted
from yawid.channels.conditioning import band_pass
from yawid.errors import ConfigError
from yawid.run_config import RunConfig


def vfr_hud(airspeed: float, groundspeed: float) -> mavlink.MAVLink_vfr_hud_message:
    return mavlink.MAVLink_vfr_hud_message(airspeed, groundspeed, 0, 50, 100.0, 0.0)


def flight(
    airspeed: float | None = 20.0,
    groundspeed: float = 20.0,
    armed: bool = True,
    gap: tuple[float, float] = (99.0, 99.0),
    mode_at: float = 99.0,
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
                log.add(10 + t, vfr_hud(airspeed, groundspeed))
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


@given(low=st.floats(0.05, 1.0), factor=st.floats(1.5, 8.0), rate=st.sampled_from([10.0, 20.0]))
def test_the_band_pass_is_scipys_and_halves_power_at_its_edges(low, factor, rate):
    high = low * factor
    if high >= rate / 2:
        with pytest.raises(ConfigError, match="--band"):
            band_pass((low, high), 1 / rate)
        return

    sections = band_pass((low, high), 1 / rate)

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


EVENTFUL = flight(gap=(12.0, 13.5), mode_at=20.0)


@settings(max_examples=15, deadline=None)
@given(
    cuts=st.lists(st.integers(0, len(EVENTFUL)), max_size=20),
    output=st.sampled_from(["yaw-rate", "heading-rate", "yaw"]),
)
def test_conditioned_samples_do_not_depend_on_the_cut(cuts, output):
    config = RunConfig(band=(0.2, 3.0), turn="remove", output=output)
    whole, cut = samples_of(EVENTFUL, config), samples_of(EVENTFUL, config, cuts)

    for name in ("u", "y", "held", "noted", "turn", "airspeed"):
        np.testing.assert_array_equal(getattr(cut, name), getattr(whole, name), err_msg=name)
