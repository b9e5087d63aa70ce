"""The pilot's stick in place of the rudder: only where --rudder rc:N names it, and said."""

from __future__ import annotations

import math

import numpy as np
import pytest
from drawn import examples
from flightlog import FlightLog, reason_ids, samples_of, summary_of
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from yawid.config.run import RunConfig


def pulse(t: float, amplitude: float = 200.0) -> int:
    return round(1500 + amplitude * math.sin(3.0 * t))


def sticks(log: FlightLog, t: float, name: str = "RC_CHANNELS", **channels: int) -> None:
    """Append the sticks, 1500 but for those named ``ch4=...``."""
    values = [channels.get(f"ch{i}", 1500) for i in range(1, 19)]
    ms = round(1000 * t)
    if name == "RC_CHANNELS":
        log.add(t, mavlink.MAVLink_rc_channels_message(ms, 18, *values, 255))
    else:
        log.add(t, mavlink.MAVLink_rc_channels_raw_message(ms, 0, *values[:8], 255))


def flight(
    parameters: dict[str, float] | None = None,
    *,
    autopilot: int = 3,
    kind: int = 1,
    name: str = "RC_CHANNELS",
    servos_at: float = 99.0,
    seconds: float = 15.0,
) -> bytes:
    """Attitude and sticks at 50 Hz: the yaw stick is channel 4, the roll stick channel 1."""
    log = FlightLog()
    log.heartbeat(10.0, kind, autopilot)
    for parameter, value in (parameters or {}).items():
        log.parameter(10.0, parameter, value)
    for i in range(round(50 * seconds)):
        t = 10.0 + 0.02 * i
        log.attitude(t, 0.1 * math.sin(3.0 * t - 1.0))
        sticks(log, t + 0.003, name, ch4=pulse(t), ch1=pulse(t, -100.0), ch6=1600)
        if t - 10.0 >= servos_at:
            log.servos(t + 0.005, [1500, 1500, 1500, 1700])
    return log.data


@pytest.mark.parametrize("kind", [1, 20])
@pytest.mark.parametrize("told", [{}, {"SERVO4_FUNCTION": 21.0}])
def test_sticks_without_any_output_are_no_rudder_and_the_refusal_names_the_option(told, kind):
    found = summary_of(flight(told, kind=kind, seconds=40.0))

    [refusal] = [r for r in found["verdict"]["reasons"] if r["id"] == "no_rudder"]
    assert not found["verdict"]["usable"]
    assert "--rudder rc:N" in refusal["remedy"] or kind == 20


def test_a_named_stick_is_read_with_its_own_travel_and_sense_and_said():
    told = {"RC6_MIN": 1000, "RC6_TRIM": 1400, "RC6_MAX": 1800, "RC6_REVERSED": 1}

    found = samples_of(flight(told), RunConfig(rudder="rc:6"))
    plain = summary_of(flight(seconds=40.0), RunConfig(rudder="rc:4"))

    assert found.channels.surfaces[0].source == "RC_CHANNELS.chan6_raw"
    np.testing.assert_allclose(found.u[:, 0], -(1600 - 1400) / 400)
    assert "channel_stand_in" in reason_ids(plain)
    assert plain["channels"]["rudder"]["source"] == "RC_CHANNELS.chan4_raw"


@pytest.mark.parametrize("told", [{}, {"RC6_MIN": 1000.0, "RC6_MAX": 2000.0}])
def test_a_px4_stick_has_px4s_travel_where_its_own_is_unknown_and_is_reversed_by_minus_1(told):
    found = samples_of(flight(told, autopilot=12), RunConfig(rudder="rc:6"))
    turned = samples_of(flight(told | {"RC6_REV": -1.0}, autopilot=12), RunConfig(rudder="rc:6"))

    np.testing.assert_allclose(found.u[:, 0], 0.2)
    np.testing.assert_allclose(turned.u[:, 0], -0.2)


def test_a_stick_is_read_from_the_older_message_where_only_that_comes():
    config = RunConfig(rudder="rc:6")
    raw, full = (samples_of(flight(name=n), config) for n in ("RC_CHANNELS_RAW", "RC_CHANNELS"))

    assert raw.channels.surfaces[0].source == "RC_CHANNELS_RAW.chan6_raw"
    np.testing.assert_allclose(raw.u[:, 0], 0.25)
    assert full.channels.surfaces[0].source == "RC_CHANNELS.chan6_raw"
    assert full.boot_us[0] < 10.2e6


@pytest.mark.parametrize("servos_at", [0.0, 4.5, 10.0])
def test_the_servo_is_the_rudder_from_its_first_message_on(servos_at):
    found = samples_of(flight(servos_at=servos_at))

    assert found.channels.surfaces[0].source == "SERVO_OUTPUT_RAW.servo4_raw"
    assert found.boot_us[0] == pytest.approx(1e6 * (10.0 + servos_at), abs=0.1e6)
    assert set(found.epoch) == {0}
    np.testing.assert_allclose(found.u[:, 0], 0.5)


LATE, MIXED = flight(servos_at=9.0, seconds=17.0), FlightLog()
MIXED.heartbeat(10.0, autopilot=12)
for name, value in {"CA_SV_CS0_TYPE": 4.0, "PWM_MAIN_FUNC1": 201.0}.items():
    MIXED.parameter(10.0, name, value)
for i in range(500):
    MIXED.attitude(10.0 + 0.02 * i, 0.1)
    us = round(1e6 * (10.0 + 0.02 * i))
    values = [1500.0 + i % 7] * 32
    MIXED.add(10.0 + 0.02 * i, mavlink.MAVLink_actuator_output_status_message(us, 8, values))
    if i > 100:
        MIXED.servos(10.001 + 0.02 * i, [1600] * 4)

STREAMS = {"servos late": LATE, "two outputs": MIXED.data}


@examples(15)
@given(name=st.sampled_from(sorted(STREAMS)), cuts=st.lists(st.integers(0, 10**5), max_size=20))
def test_what_a_surface_is_read_from_does_not_depend_on_the_cut(name, cuts):
    data = STREAMS[name]
    inside = [cut % len(data) for cut in cuts]
    whole, cut = samples_of(data), samples_of(data, cuts=inside)

    assert len(whole) > 100
    for column in ("k", "u", "y", "held", "epoch"):
        np.testing.assert_array_equal(getattr(cut, column), getattr(whole, column), err_msg=column)
