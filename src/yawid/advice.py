"""What to record next time, where a log cannot answer: message, rate, manoeuvre, parameter."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from yawid.channels.stage import Channels
from yawid.channels.vehicle import ARDUPILOT, PX4, Vehicle

_MULTIROTORS = frozenset({2, 3, 4, 13, 14, 15})
_ASK_HZ = 25
_PARAMETERS = (
    "download the parameters while recording: SERVOn_FUNCTION, _MIN, _TRIM, _MAX and _REVERSED "
    "say which servo is the rudder, and how far it goes"
)
_ADVICE = {
    "no_vehicle": "record the vehicle's own HEARTBEAT: log on the link to the aircraft itself",
    "no_yaw": f"ask for ATTITUDE (30) at {_ASK_HZ} Hz or more",
    "collinear_inputs": (
        "move the rudder by itself: on ArduPlane KFF_RDDRMIX = 0 for the manoeuvre, or by the "
        "pedals while the stick rests"
    ),
    "not_excited": (
        "fly wings level at a steady airspeed and move the rudder left and right by 10 to 30 % of "
        "its travel: a 3-2-1-1 whose 2 lasts half a Dutch-roll period, or doublets, ten of them"
    ),
    "rudder_assumed": _PARAMETERS,
}


def what_to_record(reasons: Iterable[str], channels: Channels) -> list[str]:
    """Return what to do about each of the reasons of a verdict, in the order given."""
    return list(dict.fromkeys(_advice(reasons, channels)))


def _advice(reasons: Iterable[str], channels: Channels) -> Iterator[str]:
    vehicle = channels.lock.vehicle
    for reason in reasons:
        if reason == "rate_too_low":
            yield _rates(vehicle)
        elif reason == "no_rudder" and vehicle is not None:
            yield from _no_rudder(channels, vehicle)
        elif reason in _ADVICE:
            yield _ADVICE[reason]


def _rates(vehicle: Vehicle | None) -> str:
    autopilot = None if vehicle is None else vehicle.autopilot
    by_hand = "MAV_CMD_SET_MESSAGE_INTERVAL with 40000 us"
    if autopilot == ARDUPILOT:
        by_hand = "SRn_EXTRA1 = 25 and SRn_RC_CHAN = 25 (at most 0.8 of the loop rate)"
    elif autopilot == PX4:
        by_hand = "mavlink stream -d DEVICE -s NAME -r 50 for each"
    return (
        f"ask for ATTITUDE (30) and SERVO_OUTPUT_RAW (36) at {_ASK_HZ} Hz or more: {by_hand}; "
        "the on-board log has better rates still"
    )


def _no_rudder(channels: Channels, vehicle: Vehicle) -> Iterator[str]:
    if channels.surfaces:
        message = channels.surfaces[0].message
        yield f"ask for {message} at {_ASK_HZ} Hz or more: it tells where the rudder is"
    elif vehicle.type in _MULTIROTORS:
        yield f"a {vehicle.type_name} has no rudder to learn from: record an aircraft that has one"
    elif any(channels.parameters.functions().values()):
        yield (
            "if a servo does move a rudder, give it SERVOn_FUNCTION = 21 (V-tail: 79 and 80), or "
            "name it: --rudder servo:N"
        )
    else:
        yield f"record SERVO_OUTPUT_RAW (36) and {_PARAMETERS}; or name it: --rudder servo:N"
