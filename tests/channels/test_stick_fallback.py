"""The pilot's stick in place of the rudder: only where nothing better is sent, and said."""

from __future__ import annotations

import math

import numpy as np
import pytest
from flightlog import FlightLog, reason_ids, samples_of, summary_of
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from yawid.blocks import Held
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


@pytest.mark.parametrize("name", ["RC_CHANNELS", "RC_CHANNELS_RAW"])
def test_without_any_output_the_yaw_stick_stands_in_after_five_seconds(name):
    found = samples_of(flight(name=name))

    (surface,) = found.channels.surfaces
    assert surface.source == f"{name}.chan4_raw"
    assert surface.how.startswith("stand-in")
    assert found.boot_us[0] == pytest.approx(15e6, abs=0.1e6)
    np.testing.assert_allclose(
        found.u[:, 0], 0.5 * np.sin(3.0 * (found.boot_us / 1e6 + 0.022)), atol=0.03
    )


def test_a_stand_in_is_said_and_what_is_assumed_of_it_too():
    told = {"RCMAP_YAW": 4, "RC4_MIN": 1100, "RC4_TRIM": 1500, "RC4_MAX": 1900}

    assumed, known = summary_of(flight(seconds=40.0)), summary_of(flight(told, seconds=40.0))

    assert {"channel_stand_in", "rudder_assumed"} <= reason_ids(assumed)
    assert "assumed" in assumed["channels"]["rudder"]["how"]
    assert "channel_stand_in" in reason_ids(known)
    assert "rudder_assumed" not in reason_ids(known)
    assert known["channels"]["rudder"]["how"] == "stand-in: the pilot's stick by RCMAP_YAW"


@pytest.mark.parametrize("reverse", [{"RC6_REVERSED": 1}, {"RC6_REV": -1}])
def test_the_stick_is_the_one_rcmap_names_with_its_own_travel_and_sense(reverse):
    told = {"RCMAP_YAW": 6, "RC6_MIN": 1000, "RC6_TRIM": 1400, "RC6_MAX": 1800} | reverse

    found = samples_of(flight(told))

    assert found.channels.surfaces[0].source == "RC_CHANNELS.chan6_raw"
    np.testing.assert_allclose(found.u[:, 0], -(1600 - 1400) / 400)


def test_the_roll_stick_stands_in_for_the_aileron():
    found = samples_of(flight(), RunConfig(inputs=("rudder", "aileron")))

    assert [s.source for s in found.channels.surfaces] == [
        "RC_CHANNELS.chan4_raw",
        "RC_CHANNELS.chan1_raw",
    ]
    np.testing.assert_allclose(found.u[:, 1], -0.5 * found.u[:, 0], atol=0.005)


@pytest.mark.parametrize(
    "changes",
    [
        {"parameters": {"SERVO1_FUNCTION": 77, "SERVO2_FUNCTION": 78}},
        {"parameters": {"RCMAP_YAW": 0}},
        {"kind": 2},
        {"autopilot": 12},
        {"autopilot": 12, "parameters": {"RC_MAP_YAW": 4, "CA_SV_CS0_TYPE": 1}},
        {"seconds": 4.9},
    ],
    ids=["elevons only", "no stick", "copter", "px4 untold", "px4 without rudder", "too short"],
)
def test_no_stick_stands_in_where_something_else_is_said(changes):
    summary = summary_of(flight(**changes))

    assert "no_rudder" in reason_ids(summary)
    assert not summary["verdict"]["usable"]


def test_px4_names_its_stick_by_its_own_parameter():
    told = {"RC_MAP_YAW": 4, "RC4_MIN": 1000, "RC4_TRIM": 1500, "RC4_MAX": 2000, "RC4_REV": -1}

    found = samples_of(flight(told, autopilot=12))

    assert found.channels.surfaces[0].how == "stand-in: the pilot's stick by RC_MAP_YAW"
    t = found.boot_us / 1e6
    np.testing.assert_allclose(found.u[:, 0], -0.4 * np.sin(3.0 * (t + 0.022)), atol=0.03)


def test_a_stick_that_is_asked_for_is_read_from_the_older_message_where_only_that_comes():
    config = RunConfig(rudder="rc:6")
    raw, full = (samples_of(flight(name=n), config) for n in ("RC_CHANNELS_RAW", "RC_CHANNELS"))

    assert raw.channels.surfaces[0].source == "RC_CHANNELS_RAW.chan6_raw"
    np.testing.assert_allclose(raw.u[:, 0], 0.25)
    assert full.channels.surfaces[0].source == "RC_CHANNELS.chan6_raw"
    assert full.boot_us[0] < 10.2e6  # asked for, it need not wait


def test_a_px4_stick_of_unknown_travel_has_px4s_own():
    known, unknown = {"RC_MAP_YAW": 6, "RC6_MIN": 1000, "RC6_MAX": 2000}, {"RC_MAP_YAW": 6}

    for told in (known, unknown):
        found = samples_of(flight(told, autopilot=12))
        np.testing.assert_allclose(found.u[:, 0], 0.2)
        assert "travel assumed" in found.channels.surfaces[0].how


def test_a_servo_named_but_never_sent_is_stood_in_for():
    found = samples_of(flight({"SERVO4_FUNCTION": 21}))

    assert found.channels.surfaces[0].source == "RC_CHANNELS.chan4_raw"


@pytest.mark.parametrize("servos_at", [0.0, 4.5])
def test_an_output_heard_within_five_seconds_is_the_rudder(servos_at):
    found = samples_of(flight(servos_at=servos_at))

    assert found.channels.surfaces[0].source == "SERVO_OUTPUT_RAW.servo4_raw"
    assert set(found.epoch) == {0}


def test_the_first_output_heard_ends_the_stand_in():
    found = samples_of(flight(servos_at=10.0))

    assert found.channels.surfaces[0].source == "SERVO_OUTPUT_RAW.servo4_raw"
    second = np.flatnonzero(found.epoch == 1)
    assert found.held[second[0]] == Held.RUDDER_CHANGED
    np.testing.assert_allclose(found.u[second[1:], 0], 0.5)


def test_a_reboot_while_waiting_begins_the_wait_anew():
    log = FlightLog()
    log.heartbeat(100.0)
    for i in range(1000):
        t = (100.0 if i < 200 else 1.0 - 4.0) + 0.02 * i
        log.attitude(t, 0.1)
        sticks(log, t + 0.003, ch4=pulse(t))

    found = samples_of(log.data)

    assert found.boot_us.min() == pytest.approx(6e6, abs=0.1e6)


LATE, MIXED = flight(servos_at=9.0, seconds=12.0), FlightLog()
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


@settings(max_examples=15, deadline=None)
@given(name=st.sampled_from(sorted(STREAMS)), cuts=st.lists(st.integers(0, 10**5), max_size=20))
def test_what_a_surface_is_read_from_does_not_depend_on_the_cut(name, cuts):
    data = STREAMS[name]
    inside = [cut % len(data) for cut in cuts]
    whole, cut = samples_of(data), samples_of(data, cuts=inside)

    assert len(whole) > 100
    for column in ("k", "u", "y", "held", "epoch"):
        np.testing.assert_array_equal(getattr(cut, column), getattr(whole, column), err_msg=column)
