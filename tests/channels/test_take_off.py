"""An aircraft that was on the ground rolls until it has banked or climbed."""

from __future__ import annotations

import numpy as np
from flightlog import FlightLog, samples_of
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from yawid.blocks import Held
from yawid.channels.flight_state import TakeOff

GROUND = np.repeat([1.0, 0.0], [10, 40])
LEVEL, ALTITUDE = np.full(50, 0.02), np.full(50, 50.0)


def test_a_roll_ends_with_5_degrees_or_5_m():
    climbs = ALTITUDE + np.maximum(np.arange(50) - 29, 0)  # 5 m at row 34
    banks = np.where(np.arange(50) == 40, LEVEL + np.radians(5.1), LEVEL)  # and level again

    np.testing.assert_array_equal(TakeOff().rolls(GROUND, LEVEL, climbs), np.arange(50) < 34)
    np.testing.assert_array_equal(TakeOff().rolls(GROUND, banks, ALTITUDE), np.arange(50) < 40)


def test_there_is_no_roll_where_it_never_stood_or_what_would_show_it_is_unknown():
    unknown = np.full(50, np.nan)

    assert not TakeOff().rolls(GROUND[10:], LEVEL[10:], ALTITUDE[10:]).any()
    np.testing.assert_array_equal(TakeOff().rolls(GROUND, unknown, ALTITUDE), GROUND)
    np.testing.assert_array_equal(TakeOff().rolls(GROUND, LEVEL, unknown), GROUND)
    np.testing.assert_array_equal(TakeOff().rolls(unknown, LEVEL, ALTITUDE), unknown)


@given(
    rows=st.lists(
        st.tuples(
            st.sampled_from([0.0, 1.0, np.nan]),
            st.sampled_from([0.0, 0.05, 0.1, np.nan]),
            st.sampled_from([0.0, 3.0, 6.0, np.nan]),
        ),
        min_size=1,
        max_size=20,
    ),
    cut=st.integers(0, 20),
)
def test_no_row_depends_on_how_they_were_cut(rows: list[tuple[float, float, float]], cut: int):
    columns, parts = np.array(rows).T, TakeOff()
    pieces = [parts.rolls(*columns[:, :cut]), parts.rolls(*columns[:, cut:])]
    np.testing.assert_array_equal(np.concatenate(pieces), TakeOff().rolls(*columns))


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
    assert grounded[(found.boot_us > 11e6) & (found.boot_us < 31e6)].all()
    assert not grounded[found.boot_us > 32e6].any()
