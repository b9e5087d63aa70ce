"""A fixed wing that is fast and has not climbed since it stood still rolls."""

from __future__ import annotations

import numpy as np
from flightlog import FlightLog, samples_of
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from yawid.blocks import Held
from yawid.channels.flight_state import TakeOff

SPEED = np.concatenate([np.zeros(10), np.linspace(2.0, 30.0, 15), np.full(25, 30.0)])
ALTITUDE = np.concatenate([np.full(30, 50.0), 50.0 + 2.0 * np.arange(20)])


def test_a_roll_ends_10_m_above_the_place_where_it_stood():
    np.testing.assert_array_equal(TakeOff().rolls(ALTITUDE, SPEED, SPEED), ALTITUDE < 60.0)


def test_there_is_no_roll_where_it_never_stood_or_the_altitude_is_unknown():
    rest = slice(10, None)
    assert not TakeOff().rolls(ALTITUDE[rest], SPEED[rest], SPEED[rest]).any()
    assert not TakeOff().rolls(np.full(50, np.nan), SPEED, SPEED).any()


@settings(max_examples=50)
@given(
    altitude=st.lists(st.one_of(st.just(np.nan), st.floats(0.0, 30.0)), min_size=1, max_size=40),
    cut=st.integers(0, 40),
)
def test_no_row_depends_on_how_they_were_cut(altitude: list[float], cut: int):
    rows = np.array(altitude)
    speeds = np.abs(np.linspace(-6.0, 6.0, len(rows)))
    whole, parts = TakeOff().rolls(rows, speeds, speeds), TakeOff()
    pieces = [slice(0, cut), slice(cut, None)]
    found = [parts.rolls(rows[p], speeds[p], speeds[p]) for p in pieces if len(rows[p])]
    np.testing.assert_array_equal(np.concatenate(found), whole)


def test_the_samples_of_a_roll_are_held_until_it_has_climbed():
    log = FlightLog()
    log.heartbeat(10.0)
    for i in range(1500):
        t = 10.0 + 0.02 * i
        if i % 10 == 0:
            speed, climb = min(max(4.0 * (t - 14.0), 0.0), 30.0), max(4.0 * (t - 30.0), 0.0)
            log.add(t, mavlink.MAVLink_vfr_hud_message(speed, speed, 0, 50, 100.0 + climb, 0.0))
        log.attitude(t, 0.1)
        log.servos(t + 0.002, [1500, 0, 0, 1700])

    found = samples_of(log.data)

    grounded = found.held & Held.ON_GROUND.value != 0
    assert grounded[(found.boot_us > 11e6) & (found.boot_us < 32e6)].all()
    assert not grounded[found.boot_us > 33e6].any()
