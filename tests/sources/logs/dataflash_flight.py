"""The known flight as ArduPlane logs it on board, and the telemetry log beside it."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path

import numpy as np
from flightlog import FlightLog
from sources.logs import onboard_flight
from sources.logs.dataflash_writer import DataflashLog
from sources.logs.onboard_flight import TRAVEL, Flight, flown, telemetry_of, us

from yawid.sources.logs.dataflash import DataflashReader

READER = DataflashReader
GPS_WEEK, GPS_MS = 2200, 345_600_000
UNIX_S = 315_964_800 + GPS_WEEK * 604_800 + GPS_MS / 1000 - 18
"""Unix time of the first fix, at the first instant of the flight."""
PARAMETERS = {
    "SYSID_THISMAV": 7,
    "SERVO4_FUNCTION": 21,
    "SERVO4_MIN": TRAVEL[0],
    "SERVO4_TRIM": TRAVEL[1],
    "SERVO4_MAX": TRAVEL[2],
}


def logged(
    flight: Flight, *, rates: str = "IMU", units: bool = True, airspeed_m_s: float = 18.5
) -> DataflashLog:
    """Log a flight as ArduPlane does, parameters within the first seconds."""
    log = DataflashLog(units=units)
    first = us(flight.t[0])
    log.add("MSG", first - 50, "ArduPlane V4.5.7 (abcdef01)")
    log.add("MODE", first - 40, 5, 5, 0)
    log.add("ARM", first - 30, 1, 0, 0, 0)
    pending = list(PARAMETERS.items())
    for k, t in enumerate(flight.t):
        now = us(t)
        if k % 5 == 0:
            yaw = math.degrees(flight.yaw[k]) % 360.0
            roll, pitch = math.degrees(flight.roll[k]), math.degrees(flight.pitch[k])
            log.add("ATT", now, 0, roll, 0, pitch, 0, yaw, 0, 0, 3)
        p, q, r = (float(rate) for rate in flight.rates[k])
        if rates == "RATE":
            p, q, r = (math.degrees(rate) for rate in (p, q, r))
            log.add("RATE", now, 0, p, 0, 0, q, 0, 0, r, 0)
        elif rates == "IMU":
            log.add("IMU", now, 0, p, q, r)
            log.add("IMU", now, 1, 9.0, 9.0, 9.0)
        log.add("RCOU", now + 4000, 1500, 1500, 1500, flight.pwm[k])
        if k % 10 == 0:
            log.add("CTUN", now + 5000, 0, 0, 0, 0, 30, 0, 30, airspeed_m_s)
            log.add("GPS", now + 6000, 0, 3, GPS_MS + 20 * k, GPS_WEEK, 12, 0.8, 0, 0, 500, 17.25)
        if pending and k % 7 == 3:
            log.add("PARM", now + 7000, *pending.pop(0), 0)
    return log


def telemetry(flight: Flight) -> FlightLog:
    """Log the same flight as a ground station does."""
    return telemetry_of(flight, (3, 5), PARAMETERS, 4, 17.25)


@cache
def flight() -> Flight:
    return flown()


@cache
def with_imu() -> DataflashLog:
    return logged(flight())


def whole() -> bytes:
    return with_imu().data


def written(folder: Path, data: bytes, name: str = "flight.bin") -> Path:
    path = folder / name
    path.write_bytes(data)
    return path


def change(log: DataflashLog, t_us: int) -> None:
    """Append a parameter that changes in flight."""
    log.add("PARM", t_us, "SERVO4_TRIM", 2000, 0)
    log.add("RCOU", t_us + 10_000, 1500)


def columns(path: Path) -> dict[str, np.ndarray]:
    return onboard_flight.columns(DataflashReader(path))
