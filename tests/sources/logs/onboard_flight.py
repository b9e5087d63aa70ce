"""One known flight to be logged in several ways: a Dutch roll answering a rudder that jumps."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from flightlog import FlightLog, Samples, samples_from
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scipy.signal import cont2discrete, lfilter

from yawid.blocks import MotionBlock
from yawid.config.run import RunConfig

STEP_S = 0.02
START_S = 20.0
WN, ZETA, GAIN = 4.0, 0.3, 0.8
TRAVEL = (1100, 1500, 1900)


def us(t_s: float) -> int:
    return round(1e6 * t_s)


def columns(reader: Any) -> dict[str, np.ndarray]:
    """Return all messages that the reader of a log yields by name, each with its order."""
    parts: dict[str, list[np.ndarray]] = {}
    for _, frames in reader.read():
        for name, block in (frames.messages if frames else {}).items():
            parts.setdefault(name, []).append(block.fields)
    return {name: np.concatenate(found) for name, found in parts.items()}


def samples_read(reader: Any, config: RunConfig | None = None) -> Samples:
    """Return the samples of the log that a reader reads."""
    return samples_from((frames for _, frames in reader.read()), config)


def lateral_accelerations(reader: Any) -> tuple[list[int], list[float]]:
    """Return times in us and values in m/s^2 of the lateral motion that a log's reader yields."""
    motion = samples_read(reader, RunConfig(lateral="auto")).motion
    rows = MotionBlock.joined(motion).acceleration
    return rows.t_us.tolist(), rows.values[:, 0].tolist()


@dataclass(frozen=True)
class Flight:
    """What was flown at the times ``t`` (n,) in s: rates and angles in rad, rudder in us."""

    t: np.ndarray
    roll: np.ndarray
    pitch: np.ndarray
    yaw: np.ndarray
    rates: np.ndarray
    pwm: np.ndarray


def flown(seconds: float = 60.0, seed: int = 3) -> Flight:
    """Return a flight at 50 Hz; single precision, as logs keep it."""
    rng = np.random.default_rng(seed)
    n = round(seconds / STEP_S)
    rudder = np.repeat(rng.choice([-0.3, 0.0, 0.3], n // 20 + 1), 20)[:n]
    b, a, _ = cont2discrete(([GAIN * WN**2], [1.0, 2.0 * ZETA * WN, WN**2]), STEP_S)
    r = lfilter(b[0], a, rudder)
    t = START_S + STEP_S * np.arange(n)
    roll, pitch = 0.1 * np.sin(0.5 * t), 0.05 * np.cos(0.3 * t)
    yaw = (3.0 + 0.1 * t + np.cumsum(r) * STEP_S + np.pi) % (2.0 * np.pi) - np.pi
    p, q = 0.05 * np.cos(0.5 * t), -0.015 * np.sin(0.3 * t)
    rates = np.column_stack([p, q, r]).astype(np.float32)
    pwm = np.rint(TRAVEL[1] + 400.0 * rudder).astype(int)
    return Flight(t, roll, pitch, yaw, rates, pwm)


@cache
def flight() -> Flight:
    return flown()


def written(folder: Path, data: bytes, name: str = "flight.log") -> Path:
    path = folder / name
    path.write_bytes(data)
    return path


def telemetry_of(
    flight: Flight,
    heartbeat: tuple[int, int],
    parameters: dict[str, float],
    rudder: int,
    groundspeed_m_s: float,
    airspeed_m_s: float = 18.5,
) -> FlightLog:
    """Log a flight as a ground station does; ``heartbeat`` has autopilot and custom mode.

    ``rudder`` is the number of its output.
    """
    autopilot, custom_mode = heartbeat
    log = FlightLog(sysid=7)
    log.add(flight.t[0], mavlink.MAVLink_heartbeat_message(1, autopilot, 128, custom_mode, 4, 3))
    for name, value in parameters.items():
        log.parameter(flight.t[0], name, value)
    for k, t in enumerate(flight.t):
        p, q, r = (float(rate) for rate in flight.rates[k])
        angles = flight.roll[k], flight.pitch[k], flight.yaw[k]
        log.add(t, mavlink.MAVLink_attitude_message(round(1000 * t), *angles, p, q, r))
        log.servos(t + 0.004, [*[1500] * (rudder - 1), flight.pwm[k]])
        if k % 10 == 0:
            hud = mavlink.MAVLink_vfr_hud_message(airspeed_m_s, groundspeed_m_s, 0, 0, 500.0, 0.0)
            log.add(t + 0.005, hud)
    return log
