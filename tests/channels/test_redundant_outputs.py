"""Two servos of one function: the first is the rudder, the second a witness."""

from __future__ import annotations

import math

import pytest
from drawn import examples
from flightlog import FlightLog, reason_ids, reasons_of, samples_of, summary_of
from hypothesis import given
from hypothesis import strategies as st

from yawid.channels.find_surface import find_surface
from yawid.channels.parameters import ParameterTable
from yawid.channels.vehicle import Vehicle
from yawid.config.run import RunConfig
from yawid.quantities.vehicles import PX4

FUNCTIONS = {"SERVO2_FUNCTION": 21, "SERVO4_FUNCTION": 21, "SERVO4_REVERSED": 1}
FUNCTIONS |= {f"SERVO{n}_{end}": us for n in (2, 4) for end, us in (("MIN", 1100), ("MAX", 1900))}
FUNCTIONS |= {"SERVO2_TRIM": 1500, "SERVO4_TRIM": 1500, "SERVO1_FUNCTION": 4}


def flight(second, seconds: float = 30.0) -> bytes:
    """Rudder on servo 2, and servo 4 as ``second`` makes it of the rudder's -1..1 and the time."""
    log = FlightLog()
    log.heartbeat(10.0)
    for name, value in FUNCTIONS.items():
        log.parameter(10.0, name, value)
    for i in range(round(50 * seconds)):
        t = 0.02 * i
        rudder = 0.5 * math.sin(3.0 * t)
        log.attitude(10.0 + t, 0.1 * math.sin(3.0 * t - 1.0))
        pulse = second(rudder, t)
        log.servos(10.003 + t, [1500, round(1500 + 400 * rudder), 1500, pulse])
    return log.data


def mirrored(rudder: float, t: float) -> int:
    return round(1500 - 400 * rudder)


def test_twins_that_move_alike_are_named_and_need_no_warning():
    summary = summary_of(flight(mirrored))

    rudder = summary["channels"]["rudder"]
    assert rudder["source"] == "SERVO_OUTPUT_RAW.servo2_raw"
    assert rudder["how"] == "parameter; SERVO_OUTPUT_RAW.servo4_raw moves alike"
    assert "rudder_assumed" not in reason_ids(summary)


@pytest.mark.parametrize(
    "second",
    [
        lambda rudder, t: round(1500 + 400 * rudder),  # REVERSED told and not so
        lambda rudder, t: round(1525 - 400 * rudder),  # trimmed otherwise by 6 %
        lambda rudder, t: 1500 if 10.0 < t < 12.0 else mirrored(rudder, t),
    ],
)
def test_twins_that_differ_are_a_warning_that_says_by_how_much(second):
    summary = summary_of(flight(second))

    (text,) = [r["text"] for r in reasons_of(summary) if r["id"] == "rudder_assumed"]
    assert "servo4_raw is also a rudder and differs from SERVO_OUTPUT_RAW.servo2_raw" in text
    assert "moves differently" in summary["channels"]["rudder"]["how"]


@pytest.mark.parametrize(
    "second",
    [
        lambda rudder, t: round(1512 - 400 * rudder),  # trimmed otherwise by 3 %
        lambda rudder, t: 1500 if 10.0 < t < 10.1 else mirrored(rudder, t),
    ],
)
def test_small_or_short_differences_are_none(second):
    assert "rudder_assumed" not in reason_ids(summary_of(flight(second)))


def test_a_twin_that_no_message_tells_is_not_called_alike():
    assert summary_of(flight(lambda rudder, t: 0))["channels"]["rudder"]["how"] == "parameter"


def test_px4s_second_rudder_is_a_twin():
    table = ParameterTable()
    table.values = {"CA_SV_CS0_TYPE": 4.0, "CA_SV_CS1_TYPE": 4.0}
    table.values |= {"PWM_MAIN_FUNC3": 201.0, "PWM_MAIN_FUNC5": 202.0}
    plane = Vehicle(sysid=1, compid=1, type=1, autopilot=PX4, order=0)

    found = find_surface("rudder", "auto", plane, table, frozenset())

    assert [part.number for part in found.parts] == [3]
    assert [part.number for part in found.twins] == [5]


UNLIKE = flight(lambda rudder, t: 1500 if t > 5.0 else mirrored(rudder, t), 8.0)


@examples(10)
@given(cuts=st.lists(st.integers(0, len(UNLIKE)), max_size=20))
def test_the_comparison_does_not_depend_on_the_cut(cuts):
    whole, cut = (samples_of(UNLIKE, RunConfig(), c).channels for c in ((), cuts))
    (surface,) = whole.surfaces

    assert 0.2 < whole.twins.share_apart(surface, surface.twins[0]) < 0.4
    assert cut.twins == whole.twins


def test_aileron_twins_are_compared_too():
    functions = {"SERVO1_FUNCTION": 4, "SERVO6_FUNCTION": 4, "SERVO4_FUNCTION": 21}
    log = FlightLog()
    log.heartbeat(10.0)
    for name, value in functions.items():
        log.parameter(10.0, name, value)
    for i in range(500):
        log.attitude(10.0 + 0.02 * i, 0.1)
        log.servos(10.003 + 0.02 * i, [1600, 1500, 1500, 1500, 1500, 1400])
    summary = summary_of(log.data, RunConfig(inputs=("rudder", "aileron")))

    assert "servo6_raw moves differently" in summary["channels"]["aileron"]["how"]
