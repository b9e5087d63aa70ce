"""Motions for the corpora without a flight model: hovering, tumbling, parked, rolling.

The rudder moves no aircraft here; lift motors, gusts, engines and wheels do.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scipy.signal import lfilter

from flights.flight import SENSED_MS, Floats
from flights.fly import Made
from flights.moved import by_hand, count, drawn_link, wander
from flights.plan import FOOT, KNOT, STEP_S, FlightPlan
from flights.surgery import Record, edited, join, px4_control, setting, split
from flights.telemetry import telemetry

MANUAL, QSTABILIZE, QHOVER, QLOITER, AUTO = 0, 17, 18, 19, 10
ARMED = mavlink.MAV_MODE_FLAG_SAFETY_ARMED
DISARMED = mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED | mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
LENGTHS_S = (60.0, 80.0, 100.0)
"""Lengths of the logs without excitation in s."""
FIRST_LIFT_MOTOR = 33  # SERVOn_FUNCTION of the first of four


class Played:
    """A replacement of a flight: it has the properties that telemetry reads, computed beforehand.

    ``columns`` are properties (n,) by their names in JSBSim, with a value for each ``step_ms``;
    what lies in between is interpolated. ``aileron`` and ``rudder`` (n,) are the outputs in units,
    which stay for a step. ``noises`` (m, 6) are those of the sensors, each for SENSED_MS.
    """

    def __init__(
        self,
        plan: FlightPlan,
        columns: dict[str, Floats],
        outputs: dict[str, Floats],
        step_ms: int = 1,
        noises: Floats | None = None,
    ) -> None:
        self.plan, self.columns, self.outputs, self.noises = plan, columns, outputs, noises
        columns["attitude/psi-deg"] = np.degrees(columns["attitude/psi-rad"])
        self._step_ms = step_ms
        self.advance_to(0)

    def advance_to(self, ms: int) -> None:
        """Advance to a millisecond after the start."""
        self._at, rest_ms = divmod(ms, self._step_ms)
        self._share, at = rest_ms / self._step_ms, self._at
        self.rudder_us = self.plan.rudder.pulse(float(self.outputs["rudder"][at]))
        self.aileron_us = self.plan.aileron.pulse(float(self.outputs["aileron"][at]))
        noises = self.noises
        self.noise = None if noises is None else noises[ms // SENSED_MS].tolist()

    def __getitem__(self, name: str) -> float:
        """Return the present value of a property by its name in JSBSim."""
        column = self.columns[name]
        here = float(column[self._at])
        return here + self._share * (float(column[self._at + 1]) - here) if self._share else here


def drawn(plan: FlightPlan, columns: dict[str, Floats]) -> Played:
    """Return the flight of a motion whose columns (n,) have a value for each millisecond.

    They are ``r`` and ``p`` in rad/s, ``roll`` and ``pitch`` in rad, airspeed and ground speed in
    m/s, rudder and aileron in units. A column that is not given is 0.
    """
    n = count(plan.seconds)
    zero = np.zeros(n)
    names = ("p", "r", "roll", "pitch", "airspeed", "groundspeed", "rudder", "aileron")
    given = {name: np.asarray(columns.get(name, zero)) for name in names}
    properties = {
        "attitude/phi-rad": given["roll"],
        "attitude/theta-rad": given["pitch"],
        "attitude/psi-rad": np.cumsum(given["r"]) * STEP_S,
        "velocities/p-rad_sec": given["p"],
        "velocities/q-rad_sec": np.gradient(given["pitch"], STEP_S),
        "velocities/r-rad_sec": given["r"],
        "velocities/vc-kts": given["airspeed"] / KNOT,
        "velocities/vg-fps": given["groundspeed"] / FOOT,
        "position/h-sl-ft": np.full(n, 20.0 / FOOT),
        "fcs/throttle-cmd-norm": np.full(n, 0.3),
        "velocities/h-dot-fps": zero,
    }
    return Played(plan, properties, given)


def drawn_log(
    rng: np.random.Generator,
    draw: Callable[[float], dict[str, Floats]],
    lengths_s: Sequence[float] = LENGTHS_S,
    **facts: Any,
) -> Made:
    """Return the log of a motion, with ``facts`` in its truth.

    ``draw`` returns the motion's columns for a length in s.
    """
    seconds = float(rng.choice(lengths_s))
    plan, link = FlightPlan(seconds=seconds, manoeuvre="none"), drawn_link(rng)
    log = join(telemetry(link, drawn(plan, draw(seconds))))
    known: dict[str, Any] = {"aircraft": "drawn", "dutch_roll": None, "severity": 0}
    known |= {"seconds": seconds, "attitude_hz": link.attitude_hz, "servo_hz": link.servo_hz}
    return Made(log, known | {"rate_noise": link.rate_noise, "seed": link.seed} | facts)


def hovering(rng: np.random.Generator, lengths_s: Sequence[float] = LENGTHS_S) -> Made:
    """Hover a quadplane in wind: the rudder moves with the lift motors, which turn the aircraft."""
    wind = float(rng.choice([0.0, 3.0, 8.0, 12.0]))
    made = drawn_log(rng, lambda s: _hover(rng, s, wind), lengths_s, wind_m_s=wind)
    kind = int(rng.choice([mavlink.MAV_TYPE_FIXED_WING, mavlink.MAV_TYPE_VTOL_TILTROTOR]))
    mode = int(rng.choice([QSTABILIZE, QHOVER, QLOITER, AUTO]))
    assert made.truth is not None
    log = on_lift_motors(split(made.log), rng, kind=kind, mode=mode)
    return Made(log, made.truth | {"mode": mode, "mav_type": kind})


def _hover(rng: np.random.Generator, seconds: float, wind: float) -> dict[str, Floats]:
    """Return a hover in gusts: a loop with a wn of 1 to 3 rad/s follows the pilot's headings."""
    n, every = count(seconds), 20
    asked = np.repeat(rng.uniform(-1.0, 1.0, math.ceil(n / 6000)), 6000)[:n:every]
    gust = wander(rng, n, 0.5, 0.15)[::every]
    wn, dt = rng.uniform(1.0, 3.0), every * STEP_S
    r = psi = 0.0
    rates, commands = [], []
    for heading, torque in zip(asked.tolist(), gust.tolist(), strict=True):
        command = float(np.clip(wn * wn * (heading - psi) - 0.6 * wn * r, -1.5, 1.5))
        r += dt * (command - 0.4 * wn * r + torque)
        psi += dt * r
        rates.append(r)
        commands.append(command)
    at, coarse = np.arange(n) / every, np.arange(len(rates))
    roll = wander(rng, n, 0.6, 0.08)
    return {
        "r": np.interp(at, coarse, rates),
        "roll": roll,
        "p": np.gradient(roll, STEP_S),
        "pitch": wander(rng, n, 0.6, 0.06),
        "rudder": 0.5 * np.interp(at, coarse, commands),
        "aileron": -0.8 * roll,
        "airspeed": np.maximum(wind + wander(rng, n, 2.0, 0.7), 0.0),
        "groundspeed": np.abs(wander(rng, n, 4.0, 1.0)),
    }


def on_lift_motors(
    records: list[Record], rng: np.random.Generator, *, kind: int, mode: int
) -> bytes:
    """Change a log into that of a quadplane, carried by lift motors on outputs 5 to 8."""
    motors = [
        mavlink.MAVLink_param_value_message(
            f"SERVO{5 + i}_FUNCTION".encode(), float(FIRST_LIFT_MOTOR + i),
            mavlink.MAV_PARAM_TYPE_INT16, 25, 21 + i,
        )
        for i in range(4)
    ]  # fmt: skip

    def servos(message: Any) -> None:
        yaw = (message.servo4_raw - 1500) / 4.0
        for i, turn in enumerate((1, 1, -1, -1)):
            pulse = 1520 + turn * yaw + rng.normal(0.0, 8.0)
            setattr(message, f"servo{5 + i}_raw", round(float(np.clip(pulse, 1000, 2000))))

    def parameter(message: Any) -> list[Any]:
        return [message, motors.pop(0)] if motors else [message]

    heartbeat = setting(type=kind, custom_mode=mode)
    edits = {"HEARTBEAT": heartbeat, "PARAM_VALUE": parameter, "SERVO_OUTPUT_RAW": servos}
    return join(edited(records, **edits))


def quadrotor(rng: np.random.Generator) -> Made:
    """Hover PX4's quadrotor: its third control is a torque that moves the yaw, not a rudder."""
    made = drawn_log(rng, lambda s: _hover(rng, s, 0.0))

    def servos(message: Any) -> list[Any]:
        roll, yaw = ((p - 1500) / 400.0 for p in (message.servo1_raw, message.servo4_raw))
        return [px4_control(message.time_usec, roll, yaw)]

    heartbeat = setting(type=mavlink.MAV_TYPE_QUADROTOR, autopilot=mavlink.MAV_AUTOPILOT_PX4)
    edits = {"HEARTBEAT": heartbeat, "PARAM_VALUE": lambda _: [], "SERVO_OUTPUT_RAW": servos}
    return Made(join(edited(split(made.log), **edits)), made.truth)


def tumbling(rng: np.random.Generator, lengths_s: Sequence[float] = LENGTHS_S) -> Made:
    """Tumble, rolling all the time; the controller moves the rudder against the rates."""
    return drawn_log(rng, lambda s: _tumble(rng, s), lengths_s)


def _tumble(rng: np.random.Generator, seconds: float) -> dict[str, Floats]:
    n = count(seconds)
    p, r = wander(rng, n, 0.4, 1.5), wander(rng, n, 0.3, 0.8)
    roll = math.pi + np.cumsum(p + 0.5) * STEP_S
    fought = -rng.uniform(0.2, 0.6) * r - rng.uniform(0.0, 0.2) * p
    delay = int(rng.integers(20, 80))
    return {
        "r": r,
        "p": p,
        "roll": np.remainder(roll + math.pi, math.tau) - math.pi,
        "pitch": np.clip(wander(rng, n, 1.0, 0.7), -1.5, 1.5),
        "rudder": np.concatenate([np.zeros(delay), fought[:-delay]]),
        "aileron": -0.3 * p,
        "airspeed": 14.0 + wander(rng, n, 3.0, 3.0),
        "groundspeed": 12.0 + wander(rng, n, 3.0, 2.0),
    }


def parked(rng: np.random.Generator, lengths_s: Sequence[float] = LENGTHS_S) -> Made:
    """Stand with the engine running: the pilot checks the rudder, the gyro has a vibration."""
    line_hz, wind = float(rng.uniform(1.0, 9.0)), float(rng.choice([0.0, 2.0, 9.0]))

    def draw(seconds: float) -> dict[str, Floats]:
        columns, t = _standing(rng, seconds, wind), np.arange(count(seconds)) * STEP_S
        shake = np.sin(math.tau * line_hz * t + wander(rng, len(t), 5.0, 1.0))
        return columns | {"r": columns["r"] + rng.uniform(0.002, 0.01) * shake}

    return drawn_log(rng, draw, lengths_s, line_hz=round(line_hz, 2), wind_m_s=wind)


def _standing(rng: np.random.Generator, seconds: float, wind: float) -> dict[str, Floats]:
    n = count(seconds)
    reach, tempo = float(rng.uniform(0.3, 1.0)), float(rng.uniform(0.5, 1.5))
    return {
        "r": wander(rng, n, 0.05, 0.003),
        "roll": wander(rng, n, 0.3, 0.002),
        "rudder": by_hand(rng, seconds, reach, tempo),
        "aileron": by_hand(rng, seconds, 0.5, 1.0),
        "airspeed": np.abs(wind + wander(rng, n, 2.0, 0.5)),
        "groundspeed": np.abs(wander(rng, n, 5.0, 0.05)),
    }


def disarmed(rng: np.random.Generator) -> Made:
    """Stand disarmed while the pilot tries the sticks; some airspeeds are absurd."""
    wind = float(rng.choice([0.0, 3.0, 63.0]))
    made = drawn_log(rng, lambda s: _standing(rng, s, wind), wind_m_s=wind)
    heartbeat = setting(base_mode=DISARMED, custom_mode=MANUAL)
    return Made(join(edited(split(made.log), HEARTBEAT=heartbeat)), made.truth)


def taxiing(rng: np.random.Generator, lengths_s: Sequence[float] = LENGTHS_S) -> Made:
    """Roll at 1 to 4.5 m/s in little wind, steered by the nose wheel on the rudder pedals."""
    speed = float(rng.uniform(1.5, 4.0))

    def draw(seconds: float) -> dict[str, Floats]:
        n = count(seconds)
        rolling = np.clip(speed + wander(rng, n, 5.0, 0.5), 0.5, 4.5)
        rudder = by_hand(rng, seconds, float(rng.uniform(0.2, 0.6)), 1.0)
        pole = math.exp(-STEP_S / 0.15)
        steered = lfilter([1.0 - pole], [1.0, -pole], rudder)
        r = rolling / 2.0 * np.tan(0.3 * steered) + wander(rng, n, 0.1, 0.01)
        air = np.clip(rolling + wander(rng, n, 3.0, 0.4), 0.0, 4.9)
        roll = wander(rng, n, 0.2, 0.005)
        return {"r": r, "roll": roll, "rudder": rudder, "airspeed": air, "groundspeed": rolling}

    return drawn_log(rng, draw, lengths_s, speed_m_s=round(speed, 2))
