"""What to record next time, where a log cannot answer: message, rate, manoeuvre, parameter."""

from collections.abc import Iterable, Iterator

from yawid.channels.stage import Channels
from yawid.channels.vehicle import WITHOUT_RUDDER, Vehicle
from yawid.results.reasons import ASK_HZ, KINDS, PARAMETERS, PARAMETERS_ON
from yawid.sources.mavlink.enums import ARDUPILOT


def what_to_record(reasons: Iterable[str], channels: Channels) -> list[str]:
    """Return what to do about each of the reasons of a verdict, in the order given."""
    return list(dict.fromkeys(_advice(reasons, channels)))


def _advice(reasons: Iterable[str], channels: Channels) -> Iterator[str]:
    vehicle = channels.lock.vehicle
    for reason in reasons:
        if reason == "no_rudder" and vehicle is not None:
            yield _no_rudder(channels, vehicle)
        elif text := KINDS[reason].to_record(None if vehicle is None else vehicle.autopilot):
            yield text


def _no_rudder(channels: Channels, vehicle: Vehicle) -> str:
    """Say what names a rudder; it depends on what the log holds instead."""
    if channels.surfaces:
        message = channels.surfaces[0].message
        return f"ask for {message} at {ASK_HZ} Hz or more: it tells where the rudder is"
    if vehicle.type in WITHOUT_RUDDER:
        return f"a {vehicle.type_name} has no rudder to learn from: record an aircraft that has one"
    if vehicle.autopilot == ARDUPILOT and any(channels.parameters.functions().values()):
        return (
            "if a servo does move a rudder, give it SERVOn_FUNCTION = 21 (V-tail: 79 and 80), or "
            "name it: --rudder servo:N"
        )
    parameters = PARAMETERS_ON.get(vehicle.autopilot, PARAMETERS)
    return f"record SERVO_OUTPUT_RAW (36) and {parameters}; or name it: --rudder servo:N"
