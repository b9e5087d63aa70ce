from __future__ import annotations

import struct

import numpy as np
import pytest
from flightlog import FlightLog, samples_of, summary_of
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from yawid.blocks import Held, MessageBlock
from yawid.channels.find_surface import find_surface, no_surface
from yawid.channels.parameters import ParameterTable
from yawid.channels.report import report_of
from yawid.channels.surface import Surface, SurfacePart
from yawid.channels.vehicle import Vehicle
from yawid.config.run import RunConfig
from yawid.errors import ConfigError
from yawid.quantities.vehicles import ARDUPILOT, PX4


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

    surface = Surface(
        "SERVO_OUTPUT_RAW", "parameter", (SurfacePart(4, (low, trim, high), reverse),)
    )
    found = surface.deflection(servo_block([round(pulse)]))

    assert abs(found[0] - command) <= 0.5 / min(high - trim, trim - low) + 1e-12


def test_an_output_that_is_off_gives_no_deflection():
    surface = Surface("SERVO_OUTPUT_RAW", "parameter", (SurfacePart(4, (1100.0, 1500.0, 1900.0)),))

    assert np.isnan(surface.deflection(servo_block([0, 65535]))).all()


@pytest.mark.parametrize("text", ["servo:0", "servo:33", "servo", "control:8", "rc:0", "4", ""])
def test_a_selector_that_names_no_channel_is_refused(text):
    with pytest.raises(ConfigError, match="servo:N"):
        RunConfig(rudder=text)


def log_with_parameters(parameters: dict[str, float], pwm: list[int], count: int = 1) -> bytes:
    log = FlightLog()
    log.heartbeat(10.0)
    for name, value in parameters.items():
        log.parameter(10.0, name, value, count)
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
    assert surface.how == "assumed"
    assert surface.parts == (SurfacePart(4, (1100.0, 1500.0, 1900.0)),)
    np.testing.assert_allclose(found.u[:, 0], 0.5, rtol=1e-12)


def test_an_arduplane_before_3_8_has_no_stock_channel_and_is_named():
    """Its RC4_REV is the sense of its rudder, and of no newer one: a sign must not be assumed."""
    parameters = {"RC4_MIN": 1000, "RC4_TRIM": 1520, "RC4_MAX": 1950, "RC4_REV": -1}
    log = log_with_parameters(parameters, [1500, 0, 0, 1700])

    (reason,) = (
        each for each in summary_of(log)["verdict"]["reasons"] if each["id"] == "no_rudder"
    )

    assert "before 3.8" in reason["text"]
    named = samples_of(log, RunConfig(rudder="servo:4"))
    np.testing.assert_allclose(named.u[:, 0], 0.5, rtol=1e-12)


def test_functions_that_name_no_rudder_leave_no_rudder():
    parameters = {"SERVO1_FUNCTION": 77, "SERVO2_FUNCTION": 78}
    found = samples_of(log_with_parameters(parameters, [1500, 1500, 0, 1700]))

    assert found.channels.surfaces == ()
    assert len(found) == 0


@pytest.mark.parametrize("count", [2, 3])
def test_a_list_that_lacks_the_stock_channels_function_leaves_the_stock_channel(count: int):
    # A torn download: what is missing may be SERVO4_FUNCTION. Two of two is the whole list.
    parameters = {"SERVO8_FUNCTION": 0, "SERVO9_FUNCTION": 0}
    found = samples_of(log_with_parameters(parameters, [1500, 0, 0, 1700], count))
    report = report_of(found.channels)

    if count == 2:
        assert found.channels.surfaces == ()
        assert [each.id for each in report.missing] == ["no_rudder"]
    else:
        np.testing.assert_allclose(found.u[:, 0], 0.5, rtol=1e-12)
        (reason,) = report.reasons
        assert reason.id == "rudder_assumed"
        assert "1 of its parameters are missing" in reason.text


def test_nothing_is_assumed_while_the_list_is_on_its_way():
    found = samples_of(log_with_parameters({"SERVO1_FUNCTION": 4}, [1500, 0, 0, 1700], 900))

    assert found.channels.surfaces == ()


def test_a_torn_list_whose_stock_channel_does_something_else_has_no_rudder():
    found = samples_of(log_with_parameters({"SERVO4_FUNCTION": 19}, [1500, 0, 0, 1700], 900))

    assert found.channels.surfaces == ()
    (reason,) = report_of(found.channels).missing
    assert reason.id == "no_rudder"
    assert "899 parameters are missing" in reason.text


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ((0.0,), None),
        ((0.2,), "YAW2SRV_DAMP 0.2"),
        ((0.5, 8.0, 0.0), "YAW2SRV_DAMP 0 to 8"),
    ],
)
def test_the_channels_report_the_gain_of_the_yaw_damper(values: tuple[float, ...], said: str):
    log = FlightLog()
    log.heartbeat(10.0)
    for i in range(400):
        if i % 100 == 0 and values:
            log.parameter(10.0 + 0.02 * i, "YAW2SRV_DAMP", values[0])
            values = values[1:]
        log.attitude(10.0 + 0.02 * i, 0.1)
        log.servos(10.002 + 0.02 * i, [1500, 0, 0, 1700])

    rudder = report_of(samples_of(log.data).channels).channels["rudder"]

    assert rudder.yaw_loop == said
    if said != "YAW2SRV_DAMP 0 to 8":
        assert rudder.yaw_gains is None
        return
    # The first attitude after each of them, at 10, 12 and 14 s.
    assert rudder.yaw_gains is not None
    assert [(each.value, each.boot, each.from_s) for each in rudder.yaw_gains] == [
        (0.5, 1, 10.0), (8.0, 1, 12.0), (0.0, 1, 14.0),
    ]  # fmt: skip


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


def mixed(left: float, right: float) -> list[int]:
    """Pulses of servo 2 (left) and 3 (right) for outputs on -1..1 with the stock travel."""
    return [1500, round(1500 + 400 * left), round(1500 + 400 * right), 1500]


@given(
    rudder=st.floats(-0.9, 0.9),
    elevator=st.floats(-0.9, 0.9),
    gain=st.floats(0.3, 0.55),
    offset=st.integers(-30, 30),
)
def test_a_v_tail_is_unmixed_as_ardupilot_mixed_it(rudder, elevator, gain, offset):
    # channel_function_mixer of ArduPlane/servos.cpp: offset < 0 scales the elevator.
    e = elevator * (1.0 - offset / 100.0 if offset < 0 else 1.0)
    r = rudder * (1.0 + offset / 100.0 if offset > 0 else 1.0)
    left, right = (e + r) * gain, (e - r) * gain
    table = ParameterTable()
    table.values = {
        "SERVO2_FUNCTION": 79.0,
        "SERVO3_FUNCTION": 80.0,
        "MIXING_GAIN": gain,
        "MIXING_OFFSET": float(offset),
    }
    found = find_surface("rudder", "auto", PLANE, table, frozenset())
    pulses = mixed(left, right)
    fields = np.zeros(1, [(f"servo{i}_raw", "u2") for i in range(1, 17)])
    for i, pulse in enumerate(pulses):
        fields[f"servo{i + 1}_raw"] = pulse
    one = np.ones(1, np.uint8)
    block = MessageBlock("SERVO_OUTPUT_RAW", one, one, one, one, fields)

    value = found.deflection(block)[0]

    if max(abs(left), abs(right)) < 0.99:
        assert value == pytest.approx(rudder, abs=1.0 / (400 * 2 * gain) * 1.01)
    if max(abs(left), abs(right)) > 1.0:
        assert np.isnan(value)


PLANE = Vehicle(sysid=1, compid=1, type=1, autopilot=ARDUPILOT, order=0)
PX4_PLANE = Vehicle(sysid=1, compid=1, type=1, autopilot=PX4, order=0)


@pytest.mark.parametrize(
    ("functions", "weights"),
    [
        ({"SERVO5_FUNCTION": 4.0}, [(5, 1.0)]),
        ({"SERVO1_FUNCTION": 77.0, "SERVO2_FUNCTION": 78.0}, [(1, -1.0), (2, 1.0)]),
        ({"SERVO1_FUNCTION": 24.0, "SERVO2_FUNCTION": 25.0}, [(1, 0.5), (2, 0.5)]),
        ({"SERVO1_FUNCTION": 4.0, "SERVO7_FUNCTION": 4.0}, [(1, 1.0)]),
    ],
)
def test_the_aileron_is_found_as_ailerons_elevons_or_flaperons(functions, weights):
    table = ParameterTable()
    table.values = functions

    found = find_surface("aileron", "auto", PLANE, table, frozenset())

    assert [(part.number, part.weight) for part in found.parts] == weights


def test_px4_names_its_rudder_by_output_function_and_surface_type():
    table = ParameterTable()
    table.values = {
        "CA_SV_CS0_TYPE": 1.0,
        "CA_SV_CS1_TYPE": 2.0,
        "CA_SV_CS2_TYPE": 3.0,
        "CA_SV_CS3_TYPE": 4.0,
        "PWM_MAIN_FUNC6": 204.0,
        "PWM_MAIN_FUNC1": 201.0,
        "PWM_MAIN_FUNC2": 202.0,
        "PWM_MAIN_MIN6": 1100.0,
        "PWM_MAIN_MAX6": 1900.0,
        "PWM_MAIN_REV": 32.0,
    }
    rudder = find_surface("rudder", "auto", PX4_PLANE, table, frozenset())
    aileron = find_surface("aileron", "auto", PX4_PLANE, table, frozenset())

    assert rudder.parts == (SurfacePart(6, (1100.0, 1500.0, 1900.0), reversed=True),)
    assert [(part.number, part.weight) for part in aileron.parts] == [(1, -0.5), (2, 0.5)]


@given(yaw=st.floats(-0.45, 0.45), pitch=st.floats(-0.45, 0.45))
def test_px4s_v_tail_turns_the_nose_right_by_the_left_ruddervator_up(yaw, pitch):
    """PX4's effectiveness, pitch and yaw: left (.5, .5), right (.5, -.5); its inverse mixes."""
    left, right = np.linalg.solve([[0.5, 0.5], [0.5, -0.5]], [pitch, yaw])
    table = ParameterTable()
    table.values = {
        "CA_SV_CS0_TYPE": 7.0,
        "CA_SV_CS1_TYPE": 8.0,
        "PWM_MAIN_FUNC2": 201.0,
        "PWM_MAIN_FUNC3": 202.0,
        **{
            f"PWM_MAIN_{end}{n}": pwm
            for n in (2, 3)
            for end, pwm in (("MIN", 1000.0), ("MAX", 2000.0))
        },
    }
    fields = np.zeros(1, [(f"servo{i}_raw", "u2") for i in range(1, 17)])
    for number, value in ((2, left), (3, right)):
        fields[f"servo{number}_raw"] = round(1500.0 + 500.0 * value)
    one = np.ones(1, np.uint8)

    found = find_surface("rudder", "auto", PX4_PLANE, table, frozenset())

    block = MessageBlock("SERVO_OUTPUT_RAW", one, one, one, one, fields)
    assert found.deflection(block)[0] == pytest.approx(yaw, abs=1.0 / 500.0)


def test_px4_outputs_are_taken_from_the_message_that_is_sent():
    table = ParameterTable()
    table.values = {"CA_SV_CS0_TYPE": 4.0, "PWM_MAIN_FUNC2": 201.0}
    status = frozenset({"ACTUATOR_OUTPUT_STATUS"})

    assert find_surface("rudder", "auto", PX4_PLANE, table, status).message == min(status)
    found = find_surface("rudder", "auto", PX4_PLANE, table, status | {"SERVO_OUTPUT_RAW"})
    assert found.source == "SERVO_OUTPUT_RAW.servo2_raw"


def test_without_named_outputs_px4_has_its_control_group():
    heard = frozenset({"ACTUATOR_CONTROL_TARGET"})

    found = find_surface("rudder", "auto", PX4_PLANE, ParameterTable(), heard)

    assert found.source == "ACTUATOR_CONTROL_TARGET.controls[2]"
    assert find_surface("rudder", "auto", PX4_PLANE, ParameterTable(), frozenset()) is None


QUADROTOR, TRICOPTER, ROVER, SUBMARINE, GENERIC, TILT_ROTOR = 2, 15, 10, 12, 0, 21
CONTROLS = frozenset({"ACTUATOR_CONTROL_TARGET", "SERVO_OUTPUT_RAW", "RC_CHANNELS"})


def vehicle(kind: int, autopilot: int) -> Vehicle:
    return Vehicle(sysid=1, compid=1, type=kind, autopilot=autopilot, order=0)


@pytest.mark.parametrize("selector", ["auto", "control:2", "servo:4", "vtail:1,2", "rc:4"])
@pytest.mark.parametrize("kind", [QUADROTOR, TRICOPTER, ROVER, SUBMARINE])
@pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4])
def test_what_turns_without_a_rudder_has_none_by_any_option(autopilot, kind, selector):
    alike = vehicle(kind, autopilot)

    assert find_surface("rudder", selector, alike, ParameterTable(), CONTROLS) is None
    assert "has no rudder" in no_surface("rudder", alike, ParameterTable()).text


def test_a_quadrotor_whose_parameters_name_a_rudder_has_one():
    table = ParameterTable()  # a quadplane that calls itself a quadrotor (Q_MAV_TYPE)
    table.values = {"SERVO4_FUNCTION": 21.0, "SERVO5_FUNCTION": 33.0}

    for selector in ("auto", "servo:4"):
        found = find_surface("rudder", selector, vehicle(QUADROTOR, ARDUPILOT), table, CONTROLS)
        assert found.source == "SERVO_OUTPUT_RAW.servo4_raw"


def test_control_2_is_a_rudder_by_convention_on_wings_alone():
    def by(kind: int, selector: str) -> bool:
        found = find_surface("rudder", selector, vehicle(kind, PX4), ParameterTable(), CONTROLS)
        return found is not None

    assert by(TILT_ROTOR, "auto")
    # Nothing says what a generic vehicle is: its owner may.
    assert not by(GENERIC, "auto")
    assert by(GENERIC, "control:2")


@pytest.mark.parametrize("value", [0, 1, 4, 204, 1100, -1, -400])
def test_px4s_integer_parameters_are_the_four_bytes_of_their_float(value: int):
    told = struct.unpack("<f", struct.pack("<i", value))[0]
    log = FlightLog()
    log.heartbeat(1.0, autopilot=12)
    log.add(1.0, mavlink.MAVLink_param_value_message(b"PWM_MAIN_FUNC6", told, 6, 1, 0))
    # ArduPilot tells an integer type too, and the value as a float.
    log.add(1.0, mavlink.MAVLink_param_value_message(b"SERVO4_TRIM", 1500.0, 4, 1, 0))

    found = samples_of(log.data)

    assert found.channels.parameters.values == {"PWM_MAIN_FUNC6": value, "SERVO4_TRIM": 1500.0}
