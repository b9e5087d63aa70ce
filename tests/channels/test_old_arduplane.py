"""ArduPlane before 3.8: RCn_ is what SERVOn_ became, and a stick's number is its output's."""

from __future__ import annotations

import numpy as np
import pytest
from flightlog import FlightLog, reason_ids, samples_of, summary_of

from yawid.channels.find_surface import find_surface, no_surface
from yawid.channels.parameters import ParameterTable
from yawid.channels.surface import SurfacePart
from yawid.channels.vehicle import Vehicle
from yawid.config.run import RunConfig
from yawid.quantities.vehicles import ARDUPILOT, PX4

RUDDER = {"RC4_MIN": 1000.0, "RC4_TRIM": 1520.0, "RC4_MAX": 1950.0, "RC4_REV": -1.0}
AILERON = {"RC1_MIN": 1050.0, "RC1_TRIM": 1490.0, "RC1_MAX": 1900.0, "RC1_REV": 1.0}
OLD = RUDDER | AILERON | {"RC5_FUNCTION": 0.0, "RCMAP_YAW": 4.0}
STOCK = (1100.0, 1500.0, 1900.0)


def found(
    parameters: dict[str, float],
    what: str = "rudder",
    selector: str = "auto",
    kind: int = 1,
    autopilot: int = ARDUPILOT,
):
    table = ParameterTable()
    table.values = dict(parameters)
    vehicle = Vehicle(sysid=1, compid=1, type=kind, autopilot=autopilot, order=0)
    return find_surface(what, selector, vehicle, table, frozenset()), (vehicle, table)


def test_rudder_and_aileron_have_sense_and_travel_of_their_sticks():
    rudder, _ = found(OLD)
    aileron, _ = found(OLD, "aileron")

    assert rudder.parts == (SurfacePart(4, (1000.0, 1520.0, 1950.0), reversed=True),)
    assert aileron.parts == (SurfacePart(1, (1050.0, 1490.0, 1900.0)),)
    assert rudder.how == "parameter"


def test_the_yaw_stick_may_be_another_and_a_second_rudder_has_its_function():
    rudder, _ = found(OLD | {"RCMAP_YAW": 6.0, "RC8_FUNCTION": 21.0})

    assert rudder.source == "SERVO_OUTPUT_RAW.servo6_raw"
    assert rudder.how == "parameter, travel assumed"
    assert [twin.number for twin in rudder.twins] == [8]


@pytest.mark.parametrize("selector", ["servo:4", "vtail:4,1"])
def test_an_output_named_by_an_option_has_it_too(selector: str):
    rudder, _ = found(OLD, selector=selector)
    assert rudder.parts[0].travel_us == (1000.0, 1520.0, 1950.0)
    assert rudder.parts[0].reversed


@pytest.mark.parametrize(
    "newer",
    [
        {"SERVO4_FUNCTION": 21.0},
        {"SERVO1_TRIM": 1500.0},
        {"SERVO_RATE": 50.0},  # is none of an output
    ],
)
def test_where_a_servo_has_parameters_of_its_own_the_sticks_are_sticks_alone(newer):
    rudder, _ = found(OLD | newer)
    is_newer = "SERVO_RATE" not in newer
    assert (rudder.parts[0].travel_us == STOCK) == is_newer


def test_a_newer_log_that_tells_its_sticks_alone_is_no_old_one():
    sticks = {name.replace("_REV", "_REVERSED"): value for name, value in OLD.items()}
    rudder, _ = found(sticks)
    assert (rudder.parts[0].travel_us, rudder.how) == (STOCK, "assumed")


def test_neither_an_old_copter_nor_px4_is_an_old_plane():
    assert found(OLD, kind=2)[0] is None
    px4, _ = found(OLD, selector="servo:4", autopilot=PX4)
    assert (px4.parts[0].travel_us, px4.parts[0].reversed) == (STOCK, False)


def test_a_tail_that_the_old_mixer_mixes_is_refused_with_the_way_out():
    rudder, known = found(OLD | {"VTAIL_OUTPUT": 1.0})

    assert rudder is None
    assert "VTAIL_OUTPUT" in no_surface("rudder", *known).text
    assert found(OLD | {"ELEVON_OUTPUT": 1.0}, "aileron")[0] is None


def flight(parameters: dict[str, float]) -> bytes:
    log = FlightLog()
    log.heartbeat(9.0)
    for name, value in parameters.items():
        log.parameter(9.1, name, value)
    for i in range(1000):
        t = 10.0 + 0.02 * i
        log.attitude(t, 0.1 * np.sin(t))
        log.servos(t + 0.01, [1490, 1500, 1500, 1780 if i // 50 % 2 else 1260])
    return log.data


def test_sign_and_unit_of_an_old_log_are_those_of_its_sticks():
    u = samples_of(flight(OLD), RunConfig()).u[:, 0]
    # Reversed: 1780 is 260 of 430 us above the trim, 1260 half of the travel below.
    assert np.nanmin(u) == pytest.approx(-260.0 / 430.0)
    assert np.nanmax(u) == pytest.approx(0.5)
    assert "rudder_assumed" not in reason_ids(summary_of(flight(OLD)))


def test_an_old_log_does_not_depend_on_the_cut():
    data = flight(OLD)
    whole, cut = samples_of(data), samples_of(data, cuts=range(0, len(data), 1511))
    np.testing.assert_array_equal(cut.u, whole.u)
    np.testing.assert_array_equal(cut.epoch, whole.epoch)
