"""What is known beside the samples: altitude, and whether the vehicle stands on the ground."""

from __future__ import annotations

import numpy as np
import pytest
from flightlog import FlightLog
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from yawid.blocks import FrameBlock
from yawid.channels.flight_state import FlightState
from yawid.channels.stage import WANTED
from yawid.sources.mavlink.decoder import Decoder

NAN = float("nan")
UNDEFINED, LANDED, IN_AIR, TAKING_OFF = range(4)


NAMES = ("airspeed", "on_ground", "mode", "altitude")


def context_of(*messages: mavlink.MAVLink_message) -> np.ndarray:
    """Return airspeed, on ground, mode and altitude as known after these messages."""
    log, context = FlightLog(), FlightState()
    for message in messages:
        log.add(10.0, message)
    decoder = Decoder(WANTED)
    for frames in (decoder.feed(log.data), decoder.finish()):
        context.observe((frames or FrameBlock({})).messages)
    known = context.at(np.array([len(log.data)]))
    return np.array([known[name][0] for name in NAMES])


def hud(airspeed: float, groundspeed: float, height: float = 100.0) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_vfr_hud_message(airspeed, groundspeed, 0, 50, height, 0.0)


def landed(state: int) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_extended_sys_state_message(0, state)


def test_altitude_is_that_of_the_hud():
    assert context_of(hud(20.0, 20.0, 432.5))[3] == 432.5
    assert np.isnan(context_of(landed(IN_AIR))[3])


@pytest.mark.parametrize(
    ("air", "over_ground", "state", "on_ground"),
    [
        (NAN, NAN, None, NAN),
        (0.0, NAN, None, NAN),
        (20.0, NAN, None, 0.0),
        (NAN, 20.0, None, 0.0),
        (NAN, 0.0, None, NAN),  # into the wind, or parked
        (0.0, NAN, LANDED, 1.0),
        (0.0, NAN, IN_AIR, 0.0),
        (0.0, NAN, TAKING_OFF, 0.0),
        (0.0, NAN, UNDEFINED, NAN),
        (20.0, 20.0, LANDED, 0.0),  # a disarmed autopilot that is carried
        (63.0, 0.0, LANDED, 1.0),
        (0.0, 0.0, IN_AIR, 1.0),  # as before it was asked
    ],
)
def test_nobody_is_airborne_whose_speeds_and_state_do_not_say_so(
    air: float, over_ground: float, state: int | None, on_ground: float
):
    told = [] if state is None else [landed(state)]
    np.testing.assert_equal(context_of(hud(air, over_ground), *told)[1], on_ground)


def test_without_any_message_of_it_nothing_is_known():
    assert np.isnan(context_of()).all()
