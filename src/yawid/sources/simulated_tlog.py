"""A simulated flight as the tlog of an ArduPilot plane, in genuine MAVLink frames."""

import struct
from dataclasses import dataclass
from typing import Any

import numpy as np

from yawid.blocks import Floats

START_US = 1_700_000_000_000_000
BOOT_S = 10.0
TRAVEL_US = 400


@dataclass(frozen=True, slots=True)
class SimulatedFlight:
    """A flight: times ``t`` (n,) in s from 0, and rudder ``u`` (n,) in -1..1.

    The yaw rate is in rad/s, yaw and roll are in rad, all (n,). With a roll rate ``p`` in rad/s
    there is an aileron, too, which rests.
    """

    t: Floats
    u: Floats
    yaw_rate: Floats
    yaw: Floats
    roll: Floats
    airspeed_m_s: float
    p: Floats | None = None


def tlog_of(flight: SimulatedFlight) -> bytes:
    """Return the tlog: HEARTBEAT and VFR_HUD each second, parameters, ATTITUDE and servos."""
    from pymavlink.dialects.v20 import ardupilotmega as mavlink

    link = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    records: list[bytes] = []

    def send(t_s: float, message: Any) -> None:
        stamp = START_US + round(1e6 * t_s)
        records.append(struct.pack(">Q", stamp) + message.pack(link))
        link.seq = (link.seq + 1) % 256

    def each_second(t_s: float) -> None:
        send(t_s, mavlink.MAVLink_heartbeat_message(1, 3, 209, 0, 4, 3))
        speed = flight.airspeed_m_s
        send(t_s, mavlink.MAVLink_vfr_hud_message(speed, speed, 0, 50, 100.0, 0.0))

    each_second(BOOT_S)
    for servo, function in ((4, 21), *([(1, 4)] if flight.p is not None else [])):
        travel = ("FUNCTION", function), ("MIN", 1100), ("TRIM", 1500), ("MAX", 1900)
        for name, value in travel:
            named = f"SERVO{servo}_{name}".encode()
            send(BOOT_S, mavlink.MAVLink_param_value_message(named, float(value), 9, 4, 0))
    p = np.zeros(len(flight.t)) if flight.p is None else flight.p
    wrapped = (flight.yaw + np.pi) % (2.0 * np.pi) - np.pi
    seconds = np.floor(flight.t).astype(int)
    for k, t in enumerate((BOOT_S + flight.t).tolist()):
        if k and seconds[k] != seconds[k - 1]:
            each_second(t)
        ms, us = round(1000 * t), round(1e6 * t)
        attitude = (flight.roll[k], 0.0, wrapped[k], p[k], 0.0, flight.yaw_rate[k])
        send(t, mavlink.MAVLink_attitude_message(ms, *map(float, attitude)))
        pulse = round(1500 + TRAVEL_US * float(np.clip(flight.u[k], -1.0, 1.0)))
        send(
            t, mavlink.MAVLink_servo_output_raw_message(us, 0, 1500, 1500, 1500, pulse, 0, 0, 0, 0)
        )
    return b"".join(records)
