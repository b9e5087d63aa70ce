from __future__ import annotations

import numpy as np
import pytest
from flightlog import FlightLog, samples_of
from hypothesis import given
from hypothesis import strategies as st

from yawid.blocks import Held, MessageBlock
from yawid.channels.mapping import Surface
from yawid.errors import ConfigError
from yawid.run_config import RunConfig


def servo_block(pwm: list[int]) -> MessageBlock:
    fields = np.zeros(len(pwm), [("servo4_raw", "u2"), ("port", "u1"), ("time_usec", "u4")])
    fields["servo4_raw"] = pwm
    n = np.arange(len(pwm))
    sender = np.ones(len(pwm), np.uint8)
    return MessageBlock("SERVO_OUTPUT_RAW", n, n, sender, sender, fields)


@given(
    low=st.integers(800, 1300),
    trim=st.integers(1400, 1600),
    high=st.integers(1700, 2200),
    command=st.floats(-1.0, 1.0),
    reverse=st.booleans(),
)
def test_the_deflection_is_what_ardupilot_turned_into_the_pulse(low, trim, high, command, reverse):
    # SRV_Channel::pwm_from_angle: the slope is MAX - TRIM above trim and TRIM - MIN below.
    value = -command if reverse else command
    pulse = trim + value * ((high - trim) if value > 0 else (trim - low))

    surface = Surface("SERVO_OUTPUT_RAW", 4, "parameter", (low, trim, high), reverse)
    found = surface.deflection(servo_block([round(pulse)]))

    assert abs(found[0] - command) <= 0.5 / min(high - trim, trim - low) + 1e-12


def test_an_output_that_is_off_gives_no_deflection():
    surface = Surface("SERVO_OUTPUT_RAW", 4, "parameter", (1100.0, 1500.0, 1900.0))

    assert np.isnan(surface.deflection(servo_block([0, 65535]))).all()


@pytest.mark.parametrize("text", ["servo:0", "servo:33", "servo", "control:8", "rc:0", "4", ""])
def test_a_selector_that_names_no_channel_is_refused(text):
    with pytest.raises(ConfigError, match="servo:N"):
        RunConfig(rudder=text)


def log_with_parameters(parameters: dict[str, float], pwm: list[int]) -> bytes:
    log = FlightLog()
    log.heartbeat(10.0)
    for name, value in parameters.items():
        log.parameter(10.0, name, value)
    for i in range(400):
        log.attitude(10.0 + 0.02 * i, 0.1)
        log.servos(10.002 + 0.02 * i, pwm)
    return log.data


def test_the_rudder_is_the_servo_whose_function_is_21():
    parameters = {
        "SERVO1_FUNCTION": 4,
        "SERVO6_FUNCTION": 21,
        "SERVO6_MIN": 1000,
        "SERVO6_TRIM": 1400,
        "SERVO6_MAX": 2000,
        "SERVO6_REVERSED": 1,
    }
    found = samples_of(log_with_parameters(parameters, [1500, 0, 0, 0, 0, 1700, 0, 0]))

    surface = found.channels.surfaces[0]
    assert surface.source == "SERVO_OUTPUT_RAW.servo6_raw"
    assert surface.how == "parameter"
    np.testing.assert_allclose(found.u[:, 0], -(1700 - 1400) / 600, rtol=1e-12)


def test_without_any_function_the_stock_channel_is_an_assumption():
    found = samples_of(log_with_parameters({}, [1500, 0, 0, 1700]))

    surface = found.channels.surfaces[0]
    assert (surface.number, surface.how, surface.travel_us) == (4, "assumed", (1100, 1500, 1900))
    np.testing.assert_allclose(found.u[:, 0], 0.5, rtol=1e-12)


def test_functions_that_name_no_rudder_leave_no_rudder():
    parameters = {"SERVO1_FUNCTION": 77, "SERVO2_FUNCTION": 78}
    found = samples_of(log_with_parameters(parameters, [1500, 1500, 0, 1700]))

    assert found.channels.surfaces == ()
    assert len(found) == 0


def test_rudder_and_aileron_come_side_by_side():
    config = RunConfig(inputs=("rudder", "aileron"))
    found = samples_of(log_with_parameters({}, [1300, 0, 0, 1700]), config)

    np.testing.assert_allclose(found.u, np.tile([0.5, -0.5], (len(found), 1)), rtol=1e-12)


def test_a_rudder_counted_to_the_left_and_in_degrees_is_turned_and_scaled():
    config = RunConfig(rudder_sign="nose-left", rudder_max_deg=20.0)
    found = samples_of(log_with_parameters({}, [1500, 0, 0, 1700]), config)

    np.testing.assert_allclose(found.u[:, 0], -0.5 * np.deg2rad(20.0), rtol=1e-12)


def test_a_trim_that_moves_in_flight_counts_from_its_moment():
    log = FlightLog()
    log.heartbeat(10.0)
    log.parameter(10.0, "SERVO4_FUNCTION", 21)
    for name, value in (("MIN", 1100), ("TRIM", 1500), ("MAX", 1900)):
        log.parameter(10.0, f"SERVO4_{name}", value)
    for i in range(800):
        if i == 400:
            log.parameter(10.0 + 0.02 * i, "SERVO4_TRIM", 1520)
        log.attitude(10.0 + 0.02 * i, 0.1)
        log.servos(10.002 + 0.02 * i, [1500, 1500, 1500, 1500])

    found = samples_of(log.data)

    before, after = found.boot_us < 17.8e6, found.boot_us > 18.2e6
    np.testing.assert_allclose(found.u[before, 0], 0.0)
    np.testing.assert_allclose(found.u[after, 0], -20 / 420, rtol=1e-12)
    assert set(found.epoch) == {0}


def test_a_rudder_found_on_another_channel_than_assumed_starts_a_new_epoch():
    log = FlightLog()
    log.heartbeat(10.0)
    for i in range(800):
        if i == 400:
            log.parameter(10.0 + 0.02 * i, "SERVO2_FUNCTION", 21)
        log.attitude(10.0 + 0.02 * i, 0.1)
        log.servos(10.002 + 0.02 * i, [1500, 1700, 1500, 1500])

    found = samples_of(log.data)

    assert set(found.epoch) == {0, 1}
    first = np.flatnonzero(found.epoch == 1)[0]
    assert found.held[first] == Held.RUDDER_CHANGED
    np.testing.assert_allclose(found.u[first + 1 :, 0], 0.5)
