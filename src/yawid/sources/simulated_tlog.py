"""A simulated flight as the tlog of an ArduPilot plane, in genuine MAVLink frames."""

import struct
from typing import Any

import numpy as np

from yawid.blocks import Floats

START_US = 1_700_000_000_000_000
BOOT_S = 10.0
TRAVEL_US = 400


def tlog_of(
    t: Floats,
    u: Floats,
    yaw_rate: Floats,
    yaw: Floats,
    roll: Floats,
    speed: float,
    p: Floats | None,
) -> bytes:
    """Return a flight's tlog: HEARTBEAT and VFR_HUD each second, parameters, ATTITUDE and servos.

    Times ``t`` (n,) are in s from 0, the rudder ``u`` (n,) is in -1..1. The yaw rate is in rad/s,
    yaw and roll are in rad, all (n,), and the airspeed is in m/s. With a roll rate ``p`` in rad/s
    there is an aileron, too, which rests.
    """
    from pymavlink.dialects.v20 import ardupilotmega as mavlink

    link = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    records: list[bytes] = []

    def send(t_s: float, message: Any) -> None:
        stamp = START_US + round(1e6 * t_s)
        records.append(struct.pack(">Q", stamp) + message.pack(link))
        link.seq = (link.seq + 1) % 256

    def each_second(t_s: float) -> None:
        send(t_s, mavlink.MAVLink_heartbeat_message(1, 3, 209, 0, 4, 3))
        send(t_s, mavlink.MAVLink_vfr_hud_message(speed, speed, 0, 50, 100.0, 0.0))

    each_second(BOOT_S)
    for servo, function in ((4, 21), *([(1, 4)] if p is not None else [])):
        travel = ("FUNCTION", function), ("MIN", 1100), ("TRIM", 1500), ("MAX", 1900)
        for name, value in travel:
            named = f"SERVO{servo}_{name}".encode()
            send(BOOT_S, mavlink.MAVLink_param_value_message(named, float(value), 9, 4, 0))
    p = np.zeros(len(t)) if p is None else p
    wrapped = (yaw + np.pi) % (2.0 * np.pi) - np.pi
    seconds = np.floor(t).astype(int)
    for k, now_s in enumerate((BOOT_S + t).tolist()):
        if k and seconds[k] != seconds[k - 1]:
            each_second(now_s)
        ms, us = round(1000 * now_s), round(1e6 * now_s)
        attitude = (roll[k], 0.0, wrapped[k], p[k], 0.0, yaw_rate[k])
        send(now_s, mavlink.MAVLink_attitude_message(ms, *map(float, attitude)))
        pulse = round(1500 + TRAVEL_US * float(np.clip(u[k], -1.0, 1.0)))
        servos = us, 0, 1500, 1500, 1500, pulse, 0, 0, 0, 0
        send(now_s, mavlink.MAVLink_servo_output_raw_message(*servos))
    return b"".join(records)
