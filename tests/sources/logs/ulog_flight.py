"""The known flight in a ULog as PX4 writes one, and in the telemetry log beside it."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path

import numpy as np
from flightlog import FlightLog
from sources.logs import onboard_flight
from sources.logs.onboard_flight import Flight, flown, telemetry_of, us
from sources.logs.ulog_writer import ULogFile

from yawid.sources.logs.ulog import UlogReader

READER = UlogReader
UNIX_S = 1_700_000_000
PARAMETERS = {
    "MAV_TYPE": 1,
    "PWM_MAIN_FUNC3": 202,
    "PWM_MAIN_MIN3": 1100,
    "PWM_MAIN_MAX3": 1900,
    "CA_SV_CS1_TYPE": 4,
    "FW_AIRSPD_TRIM": 18.0,
}


def quaternion(roll: float, pitch: float, yaw: float) -> tuple[float, ...]:
    (a, b, c), (x, y, z) = (
        [f(angle / 2) for angle in (roll, pitch, yaw)] for f in (math.cos, math.sin)
    )
    return (
        a * b * c + x * y * z,
        x * b * c - a * y * z,
        a * y * c + x * b * z,
        a * b * z - x * y * c,
    )


def logged(flight: Flight, airspeed_m_s: float = 18.5, **more: float) -> ULogFile:
    log = ULogFile(PARAMETERS | more)
    first = us(flight.t[0])
    log.add("vehicle_status", first - 100, 2, 0, 1, 7)
    for k, t in enumerate(flight.t):
        now = us(t)
        if k % 50 == 0:
            log.sync()
            log.add("vehicle_gps_position", now + 500, us(UNIX_S + t))
            log.add("unrelated_topic", now + 600)
        if k % 5 == 0:
            angles = flight.roll[k], flight.pitch[k], flight.yaw[k]
            log.add("vehicle_attitude", now + 300, now, quaternion(*angles))
        log.add("vehicle_angular_velocity", now + 200, now, list(map(float, flight.rates[k])))
        log.add("actuator_outputs", now + 4000, [1500, 1500, int(flight.pwm[k])], 3)
        if k % 10 == 0:
            log.add("airspeed_validated", now + 5000, airspeed_m_s)
            log.add("vehicle_local_position", now + 5100, 3.0, 4.0, True)
    return log


def telemetry(flight: Flight) -> FlightLog:
    return telemetry_of(flight, (12, 0), PARAMETERS, 3, 5.0)


@cache
def flight() -> Flight:
    return flown()


@cache
def whole() -> bytes:
    return logged(flight()).data


def written(folder: Path, data: bytes, name: str = "flight.ulg") -> Path:
    path = folder / name
    path.write_bytes(data)
    return path


def change(log: ULogFile, t_us: int) -> None:
    """Append a parameter that changes in flight."""
    log.change("PWM_MAIN_MAX3", 2000)
    log.add("actuator_outputs", t_us, [1500])


def columns(path: Path) -> dict[str, np.ndarray]:
    return onboard_flight.columns(UlogReader(path))
