"""Which output is the rudder, and what its pulses mean."""

from __future__ import annotations

import math
import struct
from typing import Any

import numpy as np
import pytest
from flightlog import beat, every, fly, reason_ids, reasons_of, samples_of, summary_of, told
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from yawid.blocks import Held, MessageBlock
from yawid.channels.find_surface import find_surface, no_surface
from yawid.channels.parameters import ParameterTable
from yawid.channels.report import report_of
from yawid.channels.surface import Surface
from yawid.channels.vehicle import Vehicle
from yawid.config.run import RunConfig
from yawid.errors import ConfigError
from yawid.quantities.vehicles import ARDUPILOT, PX4

PLANE, QUADROTOR, TRICOPTER, ROVER, SUBMARINE, GENERIC, TILT_ROTOR = 1, 2, 15, 10, 12, 0, 21
RAW, STATUS, TARGET = "SERVO_OUTPUT_RAW", "ACTUATOR_OUTPUT_STATUS", "ACTUATOR_CONTROL_TARGET"


def table_of(values: dict[str, float]) -> ParameterTable:
    table = ParameterTable()
    table.values = values
    return table


def vehicle(kind: int = PLANE, autopilot: int = ARDUPILOT) -> Vehicle:
    return Vehicle(sysid=1, compid=1, type=kind, autopilot=autopilot, order=0)


def found(
    values: dict[str, float],
    of: Vehicle,
    *heard: str,
    what: str = "rudder",
    selector: str = "auto",
) -> Surface | None:
    return find_surface(what, selector, of, table_of(values), frozenset(heard))


def deflection(surface: Surface, pulses: dict[int, float]) -> float:
    """Return the deflection that outputs (from 1) mean."""
    fields = np.zeros(1, [(f"servo{i}_raw", "u2") for i in range(1, 17)])
    for number, pulse in pulses.items():
        fields[f"servo{number}_raw"] = round(pulse)
    one = np.ones(1, np.uint8)
    return float(surface.deflection(MessageBlock(RAW, one, one, one, one, fields))[0])


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
    travel = {"MIN": low, "TRIM": trim, "MAX": high, "REVERSED": int(reverse), "FUNCTION": 21}
    rudder = found({f"SERVO6_{name}": float(each) for name, each in travel.items()}, vehicle())

    error = abs(deflection(rudder, {6: pulse}) - command)
    assert error <= 0.5 / min(high - trim, trim - low) + 1e-12
    assert all(math.isnan(deflection(rudder, {6: off})) for off in (0, 65535))


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
    functions = {"SERVO2_FUNCTION": 79.0, "SERVO3_FUNCTION": 80.0}
    mixing = {"MIXING_GAIN": gain, "MIXING_OFFSET": float(offset)}

    surface = found(functions | mixing, vehicle())
    value = deflection(surface, {2: 1500 + 400 * left, 3: 1500 + 400 * right})

    if max(abs(left), abs(right)) < 0.99:
        assert value == pytest.approx(rudder, abs=1.0 / (400 * 2 * gain) * 1.01)
    if max(abs(left), abs(right)) > 1.0:
        assert np.isnan(value)


@given(yaw=st.floats(-0.45, 0.45), pitch=st.floats(-0.45, 0.45))
def test_px4s_v_tail_turns_the_nose_right_by_the_left_ruddervator_up(yaw, pitch):
    """PX4's effectiveness, pitch and yaw: left (.5, .5), right (.5, -.5); its inverse mixes."""
    left, right = np.linalg.solve([[0.5, 0.5], [0.5, -0.5]], [pitch, yaw])
    types = {"CA_SV_CS0_TYPE": 7.0, "CA_SV_CS1_TYPE": 8.0}
    functions = {"PWM_MAIN_FUNC2": 201.0, "PWM_MAIN_FUNC3": 202.0}
    travel = {f"PWM_MAIN_{end}{n}": us for n in (2, 3) for end, us in (("MIN", 1e3), ("MAX", 2e3))}

    surface = found(types | functions | travel, vehicle(PLANE, PX4))

    pulses = {2: 1500.0 + 500.0 * left, 3: 1500.0 + 500.0 * right}
    assert deflection(surface, pulses) == pytest.approx(yaw, abs=1.0 / 500.0)


ELEVONS = {"SERVO1_FUNCTION": 77.0, "SERVO2_FUNCTION": 78.0}
FLAPERONS = {"SERVO1_FUNCTION": 24.0, "SERVO2_FUNCTION": 25.0}
PX4S = {
    **{f"CA_SV_CS{i}_TYPE": float(kind) for i, kind in enumerate((1, 2, 3, 4))},
    **{"PWM_MAIN_FUNC6": 204.0, "PWM_MAIN_FUNC1": 201.0, "PWM_MAIN_FUNC2": 202.0},
    **{"PWM_MAIN_MIN6": 1100.0, "PWM_MAIN_MAX6": 1900.0, "PWM_MAIN_REV": 32.0},
}
TWO = {
    "CA_SV_CS0_TYPE": 4.0,
    "CA_SV_CS1_TYPE": 4.0,
    "PWM_MAIN_FUNC3": 201.0,
    "PWM_MAIN_FUNC5": 202.0,
}


@pytest.mark.parametrize(
    ("what", "autopilot", "values", "heard", "source", "weights"),
    [
        ("aileron", ARDUPILOT, {"SERVO5_FUNCTION": 4.0}, (), "servo5_raw", [1.0]),
        ("aileron", ARDUPILOT, ELEVONS, (), "servo1_raw", [-1.0, 1.0]),
        ("aileron", ARDUPILOT, FLAPERONS, (), "servo1_raw", [0.5, 0.5]),
        ("rudder", ARDUPILOT, ELEVONS, (), None, []),
        ("rudder", PX4, PX4S, (), f"{RAW}.servo6_raw", [1.0]),
        ("aileron", PX4, PX4S, (), "servo1_raw", [-0.5, 0.5]),
        ("rudder", PX4, TWO, (STATUS,), f"{STATUS}.actuator[2]", [1.0]),
        ("rudder", PX4, TWO, (STATUS, RAW), f"{RAW}.servo3_raw", [1.0]),
        ("rudder", PX4, {}, (TARGET,), f"{TARGET}.controls[2]", [1.0]),
        ("rudder", PX4, {}, (), None, []),
    ],
)
def test_a_surface_is_found_by_what_names_it(what, autopilot, values, heard, source, weights):
    surface = found(values, vehicle(PLANE, autopilot), *heard, what=what)

    assert [part.weight for part in surface.parts if surface] == weights if surface else not weights
    assert (surface is None) == (source is None)
    assert source is None or source in surface.source
    assert values is not TWO or [part.number for part in surface.twins] == [5]
    assert values is not PX4S or what == "aileron" or deflection(surface, {6: 1900}) == -1.0


@pytest.mark.parametrize("selector", ["auto", "control:2", "servo:4", "vtail:1,2", "rc:4"])
@pytest.mark.parametrize("kind", [QUADROTOR, TRICOPTER, ROVER, SUBMARINE])
@pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4])
def test_what_turns_without_a_rudder_has_none_by_any_option(autopilot, kind, selector):
    alike = vehicle(kind, autopilot)

    assert found({}, alike, TARGET, RAW, "RC_CHANNELS", selector=selector) is None
    assert "has no rudder" in no_surface("rudder", alike, ParameterTable()).text
    named = {"SERVO4_FUNCTION": 21.0, "SERVO5_FUNCTION": 33.0}  # a quadplane: Q_MAV_TYPE
    assert autopilot == PX4 or found(named, alike, selector=selector) is not None


def test_control_2_is_a_rudder_by_convention_on_wings_alone():
    by = [
        found({}, vehicle(kind, PX4), TARGET, RAW, selector=selector) is not None
        # What a generic vehicle is, is unknown: its owner may know.
        for kind, selector in ((TILT_ROTOR, "auto"), (GENERIC, "auto"), (GENERIC, "control:2"))
    ]
    assert by == [True, False, True]


@pytest.mark.parametrize("text", ["servo:0", "servo:33", "servo", "control:8", "rc:0", "4", ""])
def test_a_selector_that_names_no_channel_is_refused(text):
    with pytest.raises(ConfigError, match="servo:N"):
        RunConfig(rudder=text)


def log_of(
    values: dict[str, float],
    pwm: Any = (1500, 1300, 1500, 1700),
    count: int = 1,
    later: dict[str, float] | None = None,
    seconds: float = 8.0,
    **more: Any,
) -> bytes:
    """Return a log of outputs, which may depend on the time, and of parameters.

    ``later`` has those that come in the middle.
    """
    events = [(0.0, told(name, value, count)) for name, value in values.items()]
    events += [(seconds / 2, told(name, value, count)) for name, value in (later or {}).items()]
    outputs = pwm if callable(pwm) else lambda t: list(pwm)
    events += more.pop("messages", [])
    return fly(lambda t: 0.1 * math.sin(3 * t), outputs, seconds, more=events, **more).data


@pytest.mark.parametrize(
    ("values", "count", "config", "u", "reason", "text"),
    [
        ({}, 1, {}, [0.5], "rudder_assumed", ""),
        ({}, 1, {"inputs": ("rudder", "aileron")}, [0.5, 0.0], "rudder_assumed", ""),
        ({}, 1, {"rudder_sign": "nose-left", "rudder_max_deg": 20.0},
         [-0.5 * math.radians(20.0)], "rudder_assumed", ""),
        ({"SERVO2_FUNCTION": 21}, 1, {}, [-0.5], "rudder_assumed", "how far"),
        # An ArduPlane before 3.8: its RC4_REV is the sense of its rudder, and of no newer one.
        ({"RC4_TRIM": 1520, "RC4_REV": -1}, 1, {}, [], "no_rudder", "before 3.8"),
        ({"RC4_TRIM": 1520, "RC4_REV": -1}, 1, {"rudder": "servo:4"}, [0.5], "", ""),
        ({"SERVO1_FUNCTION": 77, "SERVO2_FUNCTION": 78}, 1, {}, [], "no_rudder", ""),
        # A torn download: what is missing may be SERVO4_FUNCTION. Two of two is the whole list.
        ({"SERVO8_FUNCTION": 0, "SERVO9_FUNCTION": 0}, 2, {}, [], "no_rudder", ""),
        ({"SERVO8_FUNCTION": 0, "SERVO9_FUNCTION": 0}, 3, {}, [0.5],
         "rudder_assumed", "1 of its parameters are missing"),
        ({"SERVO1_FUNCTION": 4}, 900, {}, [], "no_rudder", ""),  # the list is on its way
        ({"SERVO4_FUNCTION": 19}, 900, {}, [], "no_rudder", "899 parameters are missing"),
    ],
)  # fmt: skip
def test_the_stock_channel_is_assumed_where_it_may_be_lost_and_said(
    values, count, config, u, reason, text
):
    samples = samples_of(log_of(values, count=count), RunConfig(**config))
    report = report_of(samples.channels)

    said = {each.id: each.text for each in (*report.missing, *report.reasons)}
    assert (len(samples) > 100) == bool(u)
    assert not u or np.allclose(samples.u, u, rtol=1e-12)
    assert text in said[reason] if reason else not {"no_rudder", "rudder_assumed"} & said.keys()


def test_a_trim_that_moves_counts_from_its_moment_and_another_channel_is_a_new_epoch():
    trims = {"SERVO4_FUNCTION": 21, "SERVO4_MIN": 1100, "SERVO4_TRIM": 1500, "SERVO4_MAX": 1900}
    trim = samples_of(log_of(trims, [1500] * 4, later={"SERVO4_TRIM": 1520}))
    other = samples_of(log_of({}, [1500, 1700, 1500, 1500], later={"SERVO2_FUNCTION": 21}))

    before, after = trim.boot_us < 13.8e6, trim.boot_us > 14.2e6
    np.testing.assert_allclose(trim.u[before, 0], 0.0)
    np.testing.assert_allclose(trim.u[after, 0], -20 / 420, rtol=1e-12)
    assert set(trim.epoch) == {0}
    first = np.flatnonzero(other.epoch == 1)[0]
    assert other.held[first] == Held.RUDDER_CHANGED
    np.testing.assert_allclose(other.u[first + 1 :, 0], 0.5)


@pytest.mark.parametrize(
    ("gains", "said"),
    [
        ([], None),
        ([0.0], None),
        ([0.2], "YAW2SRV_DAMP 0.2"),
        ([0.5, 8.0, 0.0], "YAW2SRV_DAMP 0 to 8"),
    ],
)
def test_the_channels_report_the_gain_of_the_yaw_damper(gains: list[float], said: str | None):
    messages = [(2.0 * i, told("YAW2SRV_DAMP", gain)) for i, gain in enumerate(gains)]
    rudder = report_of(samples_of(log_of({}, messages=messages)).channels).channels["rudder"]

    assert rudder.yaw_loop == said
    # The first attitude after each of them.
    times = [(each.value, each.boot, each.from_s) for each in rudder.yaw_gains or ()]
    assert times == ([(0.5, 1, 10.0), (8.0, 1, 12.0), (0.0, 1, 14.0)] if len(gains) > 1 else [])


@pytest.mark.parametrize("value", [0, 1, 4, 204, 1100, -1, -400])
def test_px4s_integer_parameters_are_the_four_bytes_of_their_float(value: int):
    packed = struct.unpack("<f", struct.pack("<i", value))[0]
    # ArduPilot sends an integer type too, and the value as a float.
    messages = [
        (0.0, mavlink.MAVLink_param_value_message(name, number, kind, 1, 0))
        for name, number, kind in ((b"PWM_MAIN_FUNC6", packed, 6), (b"SERVO4_TRIM", 1500.0, 4))
    ]
    samples = samples_of(
        fly(lambda t: 0.1, lambda t: 1500, 0.1, vehicle=beat(1, 12), more=messages).data
    )

    assert samples.channels.parameters.values == {"PWM_MAIN_FUNC6": value, "SERVO4_TRIM": 1500.0}


TWINS = {"SERVO2_FUNCTION": 21, "SERVO4_FUNCTION": 21, "SERVO4_REVERSED": 1, "SERVO1_FUNCTION": 4}
TWINS |= {f"SERVO{n}_{end}": us for n in (2, 4) for end, us in (("MIN", 1100), ("MAX", 1900))}
TWINS |= {"SERVO2_TRIM": 1500, "SERVO4_TRIM": 1500}


@pytest.mark.parametrize(
    ("second", "how"),
    [
        (lambda rudder, t: 1500 - rudder, "alike"),
        (lambda rudder, t: 1512 - rudder, "alike"),  # trimmed otherwise by 3 %
        (lambda rudder, t: 1500 - rudder * (not 4.0 < t < 4.1), "alike"),
        (lambda rudder, t: 1500 + rudder, "differently"),  # REVERSED is set and not so
        (lambda rudder, t: 1525 - rudder, "differently"),  # trimmed otherwise by 6 %
        (lambda rudder, t: 1500 - rudder * (not 4.0 < t < 5.0), "differently"),
        (lambda rudder, t: 0, ""),  # no message has it
    ],
)
def test_a_second_rudder_is_a_witness_and_a_warning_where_it_moves_differently(second, how):
    def outputs(t: float) -> list[int]:
        rudder = round(200 * math.sin(3.0 * t))
        return [1500, 1500 + rudder, 1500, second(rudder, t)]

    summary = summary_of(log_of(TWINS, outputs, seconds=12.0))
    rudder = summary["channels"]["rudder"]
    texts = [each["text"] for each in reasons_of(summary) if each["id"] == "rudder_assumed"]

    assert rudder["source"] == "SERVO_OUTPUT_RAW.servo2_raw"
    assert rudder["how"] == "parameter" or f"servo4_raw moves {how}" in rudder["how"]
    assert (rudder["how"] == "parameter") == (how == "")
    assert [f"servo4_raw is also a rudder and differs from {rudder['source']}" in each
            for each in texts] == [True] * (how == "differently")  # fmt: skip


def test_aileron_twins_are_compared_too():
    functions = {"SERVO1_FUNCTION": 4, "SERVO6_FUNCTION": 4, "SERVO4_FUNCTION": 21}
    log = log_of(functions, [1600, 1500, 1500, 1500, 1500, 1400])
    summary = summary_of(log, RunConfig(inputs=("rudder", "aileron"), manoeuvres="off"))

    assert "servo6_raw moves differently" in summary["channels"]["aileron"]["how"]


def sticks(values: dict[str, float], *, name: str = "RC_CHANNELS", servos_at: float = 99.0,
           seconds: float = 15.0, **more: Any) -> bytes:  # fmt: skip
    """Return a log of sticks at 50 Hz: yaw is channel 4; outputs come from ``servos_at`` on."""

    def one(t: float) -> Any:
        ms, yaw = round(1000 * (10.0 + t)), round(1500 + 200 * math.sin(3.0 * t))
        eight = [1500, 1500, 1500, yaw, 1500, 1600, 1500, 1500]
        if name == "RC_CHANNELS":
            return mavlink.MAVLink_rc_channels_message(ms, 18, *eight, *[1500] * 10, 255)
        return mavlink.MAVLink_rc_channels_raw_message(ms, 0, *eight, 255)

    first = log_of(values, servo_s=99.0, seconds=min(servos_at, seconds),
                   messages=every(0.02, seconds, one), **more)  # fmt: skip
    rest = max(seconds - servos_at, 0.0)
    return first + fly(lambda t: 0.1, lambda t: 1700, rest, start_s=10.0 + servos_at).data


TRAVEL = {"RC6_MIN": 1000, "RC6_TRIM": 1400, "RC6_MAX": 1800, "RC6_REVERSED": 1}


@pytest.mark.parametrize(
    ("values", "name", "autopilot", "u"),
    [
        (TRAVEL, "RC_CHANNELS", ARDUPILOT, -0.5),
        ({}, "RC_CHANNELS_RAW", ARDUPILOT, 0.25),
        ({}, "RC_CHANNELS", PX4, 0.2),
        ({"RC6_MIN": 1000.0, "RC6_MAX": 2000.0, "RC6_REV": -1.0}, "RC_CHANNELS", PX4, -0.2),
    ],
)
def test_a_named_stick_is_read_with_its_own_travel_and_sense(values, name, autopilot, u):
    log = sticks(values, name=name, vehicle=beat(1, autopilot))
    samples = samples_of(log, RunConfig(rudder="rc:6"))

    assert samples.channels.surfaces[0].source == f"{name}.chan6_raw"
    np.testing.assert_allclose(samples.u[:, 0], u)


@pytest.mark.parametrize("kind", [PLANE, TILT_ROTOR])
def test_a_stick_is_a_rudder_only_where_it_is_named_and_that_is_said(kind: int):
    log = sticks({"SERVO4_FUNCTION": 21.0}, seconds=40.0, vehicle=beat(kind))
    refused, named = (
        summary_of(log, RunConfig(rudder=rudder, manoeuvres="off")) for rudder in ("auto", "rc:4")
    )

    [refusal] = [each for each in reasons_of(refused) if each["id"] == "no_rudder"]
    assert "--rudder rc:N" in refusal["remedy"] or kind != PLANE
    assert "channel_stand_in" in reason_ids(named)
    assert named["channels"]["rudder"]["source"] == "RC_CHANNELS.chan4_raw"


@pytest.mark.parametrize("servos_at", [0.0, 4.5, 10.0])
def test_the_servo_is_the_rudder_from_its_first_message_on(servos_at: float):
    samples = samples_of(sticks({}, servos_at=servos_at))

    assert samples.channels.surfaces[0].source == "SERVO_OUTPUT_RAW.servo4_raw"
    assert samples.boot_us[0] == pytest.approx(1e6 * (10.0 + servos_at), abs=0.1e6)
    assert set(samples.epoch) == {0}
    np.testing.assert_allclose(samples.u[:, 0], 0.5)
