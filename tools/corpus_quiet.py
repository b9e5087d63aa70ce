"""Logs in which nothing excites the rudder, a dozen ways: none may pass for an answer.

In the air by JSBSim (turns, gusts, mixed and damped rudders, a vibration, an autopilot that is only
a passenger); hovering, tumbling, parked and rolling by simple motions drawn here.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from case_recipes import Made
from corpus_flights import (
    SEED,
    Damper,
    Floats,
    Hands,
    Mixed,
    by_hand,
    drawn_link,
    flown_log,
)
from jsbsim_flight import STEP_S, FlightPlan
from log_surgery import Record, join, rewrite, split
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scipy.signal import lfilter
from telemetry import FOOT, KNOT, Link, telemetry
from trim_tlog import message_id, records

GENTLE = (
    ("c172p", 3000.0, 100.0), ("J3Cub", 2000.0, 60.0), ("T37", 5000.0, 200.0),
    ("t6texan2", 5000.0, 180.0), ("OV10", 5000.0, 160.0), ("c172r", 3000.0, 90.0),
)  # fmt: skip
"""Aircraft, altitude in ft, airspeed in kt."""
LENGTHS_S = (60.0, 80.0, 100.0)
ARMED = mavlink.MAV_MODE_FLAG_SAFETY_ARMED
MANUAL, QSTABILIZE, QHOVER, QLOITER, AUTO = 0, 17, 18, 19, 10
FIRST_LIFT_MOTOR = 33  # SERVOn_FUNCTION of the first of four


def count(seconds: float) -> int:
    """Return how many milliseconds a log of this length has."""
    return round(seconds / STEP_S) + 1


def wander(rng: np.random.Generator, n: int, tau_s: float, std: float) -> Floats:
    """Return noise (n,) by the millisecond that passed two lags of ``tau_s``, scaled to ``std``."""
    every = max(round(0.1 * tau_s / STEP_S), 1)
    white = rng.normal(size=math.ceil(n / every) + 200)
    pole = math.exp(-0.1)
    slow = lfilter([1.0], [1.0, -2.0 * pole, pole * pole], white)[199:]
    # By the process's own deviation: a short piece may move more or less, as chance has it.
    slow *= std * math.sqrt((1.0 - pole**2) ** 3 / (1.0 + pole**2))
    at = np.arange(n) / every
    return np.asarray(np.interp(at, np.arange(len(slow)), slow))


def turns(rng: np.random.Generator, seconds: float) -> Floats:
    """Return a bank in rad (n,): to either side or level for 6 to 18 s, rolled into at 20 deg/s."""
    n = count(seconds)
    bank, at = np.zeros(n), 5000
    while at < n:
        stop = at + int(rng.integers(6_000, 18_000))
        side = float(rng.choice([-1.0, 0.0, 1.0]))
        bank[at:stop] = side * math.radians(rng.uniform(10.0, 35.0))
        at = stop
    return np.asarray(lfilter(np.full(1500, 1.0 / 1500), [1.0], bank))


def drift(rng: np.random.Generator, seconds: float) -> Floats:
    """Return a trim (n,) that wanders within some 2 % of travel in half a minute."""
    return np.clip(wander(rng, count(seconds), 15.0, 0.01), -0.02, 0.02)


def in_the_air(
    rng: np.random.Generator,
    hands: Callable[[float], Hands],
    severities: Sequence[int],
    **told: Any,
) -> Made:
    """Fly one of the gentle aircraft; ``hands`` are told the length of the flight in s."""
    aircraft, altitude_ft, speed_kt = GENTLE[rng.integers(len(GENTLE))]
    seconds = float(rng.choice(LENGTHS_S))
    plan = FlightPlan(
        aircraft=aircraft,
        speed_kt=speed_kt,
        altitude_ft=altitude_ft,
        heading_deg=float(rng.integers(0, 360)),
        seconds=seconds,
        manoeuvre="none",
    )
    severity = int(rng.choice(severities))
    return flown_log(plan, drawn_link(rng), hands(seconds), severity, **told)


def turning(rng: np.random.Generator) -> Made:
    """Fly turns by the aileron alone, the rudder still."""
    return in_the_air(rng, lambda s: Hands(bank=turns(rng, s)), (0, 0, 1, 2))


def gusts(rng: np.random.Generator) -> Made:
    """Fly wings level in turbulence, the rudder still."""
    return in_the_air(rng, lambda s: Hands(), (1, 2, 3, 4))


def drifting(rng: np.random.Generator) -> Made:
    """Fly in turbulence, now and then in turns, the rudder's trim wandering."""

    def hands(seconds: float) -> Hands:
        bank = turns(rng, seconds) if rng.random() < 0.5 else None
        return Hands(rudder=drift(rng, seconds), bank=bank)

    return in_the_air(rng, hands, (0, 1, 2, 3, 4))


def mixed(rng: np.random.Generator) -> Made:
    """Fly by an autopilot whose rudder is a share of its aileron, and a little noise."""
    share = round(float(rng.uniform(0.2, 1.0)), 2)
    noise = float(rng.choice([0.0, 0.001, 0.003]))

    def hands(seconds: float) -> Hands:
        rustle = wander(rng, count(seconds), 0.1, noise)
        return Hands(bank=turns(rng, seconds), react=Mixed(share, noise=rustle))

    return in_the_air(rng, hands, (0, 1, 2, 3), share=share, rudder_noise=noise)


def coordinated(rng: np.random.Generator) -> Made:
    """Fly a pilot's coordinated turns: the rudder follows the aileron by 0.1 to 0.3 s."""
    share, lag_s = (round(float(rng.uniform(*ends)), 2) for ends in ((0.2, 0.8), (0.1, 0.3)))

    def hands(seconds: float) -> Hands:
        foot = wander(rng, count(seconds), 0.5, 0.003)
        return Hands(bank=turns(rng, seconds), react=Mixed(share, lag_s, foot))

    return in_the_air(rng, hands, (0, 0, 1, 2), share=share, lag_s=lag_s)


def damped(rng: np.random.Generator) -> Made:
    """Fly in turbulence, every other time in turns; a yaw damper alone moves the rudder."""
    gain = round(float(rng.uniform(0.3, 1.5)), 2)

    def hands(seconds: float) -> Hands:
        bank = turns(rng, seconds) if rng.random() < 0.5 else None
        return Hands(bank=bank, react=Damper(gain))

    return in_the_air(rng, hands, (1, 2, 3, 4), damper=gain)


def vibrating(rng: np.random.Generator) -> Made:
    """Put a line of 2 to 4 Hz on the gyro; the rudder moves by 2 % of travel each way at most."""
    line_hz = round(float(rng.uniform(2.0, 4.0)), 2)
    share = round(float(rng.uniform(0.1, 0.7)), 2)
    foot = float(rng.choice([0.0, 0.01, 0.02]))
    made = in_the_air(
        rng,
        lambda s: Hands(rudder=by_hand(rng, s, foot, 0.8) if foot else drift(rng, s)),
        (1, 2, 3),
        line_hz=line_hz,
        line_share=share,
    )
    return Made(with_line(made.log, line_hz, share, rng), made.truth)


def with_line(log: bytes, line_hz: float, share: float, rng: np.random.Generator) -> bytes:
    """Add a narrow line (0.05 Hz) to the yaw rate of ATTITUDE, then ``share`` of its power."""
    rates = [
        struct.unpack_from("<f", payload.ljust(28, b"\0"), 24)[0]
        for ident, payload, _ in records(log)
        if ident == message_id("ATTITUDE")
    ]
    amplitude = math.sqrt(2.0 * share / (1.0 - share) * float(np.var(rates)))
    phase, before_s = float(rng.uniform(0.0, math.tau)), 0.0
    width = math.sqrt(math.tau * 0.05)  # of the phase's random walk, rad per root of a second

    def change(message: Any) -> list[Any]:
        nonlocal phase, before_s
        if message.get_type() == "ATTITUDE":
            now_s = message.time_boot_ms / 1000.0
            phase += float(rng.normal(0.0, width * math.sqrt(max(now_s - before_s, 0.0))))
            before_s = now_s
            message.yawspeed += amplitude * math.sin(math.tau * line_hz * now_s + phase)
        return [message]

    return join(rewrite(split(log), change))


def lined() -> Made:
    """Fly by hand a Dutch roll near 1.3 rad/s, and put a line of 2.4 Hz on the gyro.

    The line has 17 % of the yaw rate's power and is no mode of the aircraft: 15.1 rad/s is no
    answer.
    """
    rng = np.random.default_rng([SEED, 2])
    plan = FlightPlan(
        aircraft="t6texan2", speed_kt=138.0, altitude_ft=5000.0, seconds=120.0, manoeuvre="none"
    )
    hands = Hands(rudder=by_hand(rng, plan.seconds, amplitude=0.12, unit_s=1.5))
    made = flown_log(plan, Link(attitude_hz=25.0, servo_hz=25.0), hands, group="line", line_hz=2.4)
    return Made(with_line(made.log, 2.4, 0.17, rng), made.truth)


def passenger(rng: np.random.Generator) -> Made:
    """Carry PX4 along: its controls ask for much, its outputs never move; half are disarmed."""
    made = in_the_air(
        rng,
        lambda s: Hands(bank=turns(rng, s), react=Mixed(0.3, 0.2)),
        (0, 1, 2),
    )
    armed, status = bool(rng.random() < 0.5), bool(rng.random() < 0.5)
    log = as_passenger(split(made.log), rng, armed=armed, status=status)
    assert made.truth is not None
    return Made(log, made.truth | {"armed": armed})


def as_passenger(
    flown: list[Record], rng: np.random.Generator, *, armed: bool, status: bool
) -> bytes:
    """Tell a flight as such a PX4 does; outputs as ACTUATOR_OUTPUT_STATUS or SERVO_OUTPUT_RAW.

    The controls would level the wings and damp the yaw; yaw has some of the roll's.
    """
    roll = yaw = 0.0
    gains = rng.uniform([0.6, 0.1, 0.2], [1.5, 0.6, 1.0])

    def change(message: Any) -> list[Any]:
        nonlocal roll, yaw
        kind = message.get_type()
        if kind == "PARAM_VALUE":
            return []
        if kind == "HEARTBEAT" and message.get_srcSystem() == 1:
            message.autopilot = mavlink.MAV_AUTOPILOT_PX4
            message.base_mode |= ARMED
            if not armed:
                message.base_mode ^= ARMED
        elif kind == "ATTITUDE":
            roll = -gains[0] * message.roll - 0.1 * message.rollspeed
            yaw = gains[1] * roll - gains[2] * message.yawspeed + rng.normal(0.0, 0.005)
        elif kind == "SERVO_OUTPUT_RAW":
            controls = [float(np.clip(x, -1.0, 1.0)) for x in (roll, 0.0, yaw)]
            asked = mavlink.MAVLink_actuator_control_target_message(
                message.time_usec, 0, [*controls, 0.5, 0.0, 0.0, 0.0, -1.0]
            )
            return [asked, _still_outputs(message.time_usec, status)]
        return [message]

    return join(rewrite(flown, change))


def _still_outputs(time_us: int, status: bool) -> Any:
    pulses = [1500, 1500, 900, 1500, 900, 900, 900, 900]
    if not status:
        return mavlink.MAVLink_servo_output_raw_message(time_us, 0, *pulses)
    values = [float(pulse) for pulse in pulses] + [0.0] * 24
    return mavlink.MAVLink_actuator_output_status_message(time_us, 8, values)


class Drawn:
    """Stands in for a flight: the properties that telemetry asks for, drawn beforehand.

    Columns (n,) by the millisecond: ``r``, ``p``, ``roll``, ``pitch`` in rad and rad/s, airspeed
    and ground speed in m/s, rudder and aileron in units; what is not given is 0.
    """

    def __init__(self, plan: FlightPlan, columns: dict[str, Floats]) -> None:
        n = count(plan.seconds)
        zero = np.zeros(n)
        given = {name: np.asarray(columns.get(name, zero)) for name in ("p", "r", "roll", "pitch")}
        psi = np.cumsum(given["r"]) * STEP_S
        air, over_ground = columns.get("airspeed", zero), columns.get("groundspeed", zero)
        self._columns = {
            "attitude/phi-rad": given["roll"],
            "attitude/theta-rad": given["pitch"],
            "attitude/psi-rad": psi,
            "attitude/psi-deg": np.degrees(psi),
            "velocities/p-rad_sec": given["p"],
            "velocities/q-rad_sec": np.gradient(given["pitch"], STEP_S),
            "velocities/r-rad_sec": given["r"],
            "velocities/vc-kts": air / KNOT,
            "velocities/vg-fps": over_ground / FOOT,
            "position/h-sl-ft": np.full(n, 20.0 / FOOT),
            "fcs/throttle-cmd-norm": np.full(n, 0.3),
            "velocities/h-dot-fps": zero,
        }
        self._plan, self._ms = plan, 0
        self._rudder, self._aileron = columns.get("rudder", zero), columns.get("aileron", zero)
        self.rudder_us = self.aileron_us = 1500
        self.advance_to(0)

    def advance_to(self, ms: int) -> None:
        """Go on to a millisecond after the start."""
        self._ms = ms
        self.rudder_us = self._plan.rudder.pulse(float(self._rudder[ms]))
        self.aileron_us = self._plan.aileron.pulse(float(self._aileron[ms]))

    def __getitem__(self, name: str) -> float:
        """Return a property of JSBSim's name now."""
        return float(self._columns[name][self._ms])


def told_log(
    rng: np.random.Generator, draw: Callable[[float], dict[str, Floats]], **told: Any
) -> Made:
    """Tell a motion whose columns ``draw`` returns for a length in s."""
    seconds = float(rng.choice(LENGTHS_S))
    plan, link = FlightPlan(seconds=seconds, manoeuvre="none"), drawn_link(rng)
    log = join(telemetry(plan, link, Drawn(plan, draw(seconds))))
    known: dict[str, Any] = {"aircraft": "drawn", "dutch_roll": None, "severity": 0}
    return Made(log, known | _of(link, seconds) | told)


def _of(link: Link, seconds: float) -> dict[str, float]:
    names = ("attitude_hz", "servo_hz", "rate_noise", "seed")
    return {"seconds": seconds} | {name: getattr(link, name) for name in names}


def hovering(rng: np.random.Generator) -> Made:
    """Hover a quadplane in wind: the rudder moves with the lift motors, which do the work."""
    wind = float(rng.choice([0.0, 3.0, 8.0, 12.0]))
    drawn = told_log(rng, lambda s: _hover(rng, s, wind), wind_m_s=wind)
    kind = int(rng.choice([mavlink.MAV_TYPE_FIXED_WING, mavlink.MAV_TYPE_VTOL_TILTROTOR]))
    mode = int(rng.choice([QSTABILIZE, QHOVER, QLOITER, AUTO]))
    assert drawn.truth is not None
    log = on_lift_motors(split(drawn.log), rng, kind=kind, mode=mode)
    return Made(log, drawn.truth | {"mode": mode, "mav_type": kind})


def _hover(rng: np.random.Generator, seconds: float, wind: float) -> dict[str, Floats]:
    """Return a hover: the pilot asks for headings, a loop of 1 to 3 rad/s follows in gusts."""
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


def on_lift_motors(told: list[Record], rng: np.random.Generator, *, kind: int, mode: int) -> bytes:
    """Tell a log as a quadplane's whose four lift motors, outputs 5 to 8, carry it."""
    motors = [
        mavlink.MAVLink_param_value_message(
            f"SERVO{5 + i}_FUNCTION".encode(), float(FIRST_LIFT_MOTOR + i),
            mavlink.MAV_PARAM_TYPE_INT16, 25, 21 + i,
        )
        for i in range(4)
    ]  # fmt: skip

    def change(message: Any) -> list[Any]:
        name = message.get_type()
        if name == "HEARTBEAT" and message.get_srcSystem() == 1:
            message.type, message.custom_mode = kind, mode
        elif name == "SERVO_OUTPUT_RAW":
            yaw = (message.servo4_raw - 1500) / 4.0
            for i, turn in enumerate((1, 1, -1, -1)):
                pulse = 1520 + turn * yaw + rng.normal(0.0, 8.0)
                setattr(message, f"servo{5 + i}_raw", round(float(np.clip(pulse, 1000, 2000))))
        elif name == "PARAM_VALUE" and motors:
            return [message, motors.pop(0)]
        return [message]

    return join(rewrite(told, change))


def tumbling(rng: np.random.Generator) -> Made:
    """Tumble, rolling over and over; the controller's rudder fights the rates."""
    return told_log(rng, lambda s: _tumble(rng, s))


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


def parked(rng: np.random.Generator) -> Made:
    """Stand with the engine running: the pilot checks the rudder, the gyro has the vibration."""
    line_hz, wind = float(rng.uniform(1.0, 9.0)), float(rng.choice([0.0, 2.0, 9.0]))

    def draw(seconds: float) -> dict[str, Floats]:
        columns, t = _standing(rng, seconds, wind), np.arange(count(seconds)) * STEP_S
        shake = np.sin(math.tau * line_hz * t + wander(rng, len(t), 5.0, 1.0))
        return columns | {"r": columns["r"] + rng.uniform(0.002, 0.01) * shake}

    return told_log(rng, draw, line_hz=round(line_hz, 2), wind_m_s=wind)


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
    """Stand disarmed, the sticks tried; some airspeed sensors say anything."""
    wind = float(rng.choice([0.0, 3.0, 63.0]))
    made = told_log(rng, lambda s: _standing(rng, s, wind), wind_m_s=wind)

    def change(message: Any) -> list[Any]:
        if message.get_type() == "HEARTBEAT" and message.get_srcSystem() == 1:
            message.base_mode, message.custom_mode = message.base_mode & ~ARMED, MANUAL
        return [message]

    return Made(join(rewrite(split(made.log), change)), made.truth)


def taxiing(rng: np.random.Generator) -> Made:
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

    return told_log(rng, draw, speed_m_s=round(speed, 2))


KINDS: dict[str, Callable[[np.random.Generator], Made]] = {
    "turns": turning,
    "gusts": gusts,
    "drift": drifting,
    "mixed": mixed,
    "coordinated": coordinated,
    "damper": damped,
    "vibration": vibrating,
    "passenger": passenger,
    "hover": hovering,
    "tumble": tumbling,
    "parked": parked,
    "disarmed": disarmed,
    "taxi": taxiing,
}


def unexcited(number: int) -> Made:
    """Return log ``number`` of the unexcited corpus; the kinds come in turn."""
    group = list(KINDS)[number % len(KINDS)]
    rng = np.random.default_rng([SEED, 1, number])
    made = KINDS[group](rng)
    assert made.truth is not None
    return Made(made.log, made.truth | {"group": group})
