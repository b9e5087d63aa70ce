"""Logs of which none may have a usable answer: without excitation by the rudder, or misled.

What each kind draws is in quiet.toml. Those in the air are flown by JSBSim (turns, gusts,
mixed and damped rudders, a vibration, an autopilot that does not control the aircraft). The others
are simple motions without a flight model, in which the rudder moves no aircraft: lift motors,
gusts, engines and wheels do. A misled log has a rudder that is not the one that moved the aircraft:
that of another flight, its own reversed in time, or its own late. A yaw rate that decays freely has
the right frequency whatever the rudder did, so what is judged is the verdict.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scipy.signal import lfilter

from flights.flight import Hands
from flights.fly import Made, fly
from flights.moved import CHOSEN, SEED, Damper, Draw, Mixed, by_hand, drawn_link, excited, wander
from flights.plan import FOOT, KNOT, STEP_S, FlightPlan, Floats, Place, count, plan_at
from flights.surgery import (
    Record,
    edited,
    join,
    messages,
    px4_control,
    px4_controls,
    setting,
    split,
)
from flights.telemetry import ARMED, DISARMED, Played, telemetry

GENTLE = (
    ("c172p", 3000.0, 100.0), ("J3Cub", 2000.0, 60.0), ("T37", 5000.0, 200.0),
    ("t6texan2", 5000.0, 180.0), ("OV10", 5000.0, 160.0), ("c172r", 3000.0, 90.0),
)  # fmt: skip
GENTLY = Draw(SEED, GENTLE)
"""The places and the seed of the flights on which limits are chosen."""
RANGES: dict[str, dict[str, Any]] = tomllib.loads(
    Path(__file__).with_name("quiet.toml").read_text(encoding="utf-8")
)
KINDS = tuple(RANGES)
LENGTHS_S = (60.0, 80.0, 100.0)
"""Lengths of the logs without excitation in s."""
MANUAL, QSTABILIZE, QHOVER, QLOITER, AUTO = 0, 17, 18, 19, 10
FIRST_LIFT_MOTOR = 33  # SERVOn_FUNCTION of the first of four
ALL_DIGITS = 17
Facts = dict[str, Any]


def unexcited(number: int, draw: Draw = GENTLY) -> Made:
    """Return log ``number`` of the corpus without excitation; the kinds come in turn."""
    rng = np.random.default_rng([draw.seed, 1, number])
    return quiet(KINDS[number % len(KINDS)], rng, draw.places)


def quiet(
    group: str,
    rng: np.random.Generator,
    places: Sequence[Place] = (),
    lengths_s: Sequence[float] | None = None,
) -> Made:
    """Return a log of a kind; those in the air are flown at one of the places."""
    facts = {name: drawn(rng, of) for name, of in RANGES[group].items() if name != "severity"}
    place = places[int(rng.integers(len(places)))] if "severity" in RANGES[group] else None
    seconds = float(rng.choice(LENGTHS_S if lengths_s is None else lengths_s))
    if place:
        heading_deg = float(rng.integers(0, 360))
        plan = plan_at(place, heading_deg=heading_deg, seconds=seconds, manoeuvre="none")
        severity = int(rng.choice(RANGES[group]["severity"]))
        link = drawn_link(rng)
        made = fly(plan, link, hands(group, rng, seconds, facts), severity, **facts)
    else:
        link = drawn_link(rng)
        log = join(telemetry(link, played(seconds, motion(group, rng, seconds, facts))))
        known: Facts = {"aircraft": "drawn", "dutch_roll": None, "severity": 0, "seconds": seconds}
        known |= {"attitude_hz": link.attitude_hz, "servo_hz": link.servo_hz, "seed": link.seed}
        made = Made(log, known | {"rate_noise": link.rate_noise} | facts)
    log, more = changed(group, rng, made.log, facts)
    assert made.truth is not None
    return Made(log, made.truth | more | {"group": group})


def drawn(rng: np.random.Generator, of: Any) -> float:
    """Return a number of a list, or between ``low`` and ``high``, with so many ``digits``."""
    if isinstance(of, list):
        return float(rng.choice(of))
    return round(float(rng.uniform(of["low"], of["high"])), int(of.get("digits", ALL_DIGITS)))


def hands(group: str, rng: np.random.Generator, seconds: float, facts: Facts) -> Hands:
    """Return what moves the controls of a flight.

    In turns of the aileron alone and in turbulence the rudder does not move. Its trim wanders; it
    is a share of the aileron (mixed), also behind a pilot's lag (coordinated, passenger); a yaw
    damper moves it; or it moves by at most 2 % of travel (vibration).
    """
    n = count(seconds)
    match group:
        case "turns":
            return Hands(bank=turns(rng, seconds))
        case "drift":
            bank = turns(rng, seconds) if rng.random() < 0.5 else None
            return Hands(rudder=drift(rng, seconds), bank=bank)
        case "mixed":
            rustle = wander(rng, n, 0.1, facts["rudder_noise"])
            return Hands(bank=turns(rng, seconds), react=Mixed(facts["share"], noise=rustle))
        case "coordinated":
            foot = wander(rng, n, 0.5, 0.003)
            pedals = Mixed(facts["share"], facts["lag_s"], foot)
            return Hands(bank=turns(rng, seconds), react=pedals)
        case "damper":
            bank = turns(rng, seconds) if rng.random() < 0.5 else None
            return Hands(bank=bank, react=Damper(facts["damper"]))
        case "vibration":
            foot = facts["foot"]
            return Hands(by_hand(rng, seconds, foot, 0.8) if foot else drift(rng, seconds))
        case "passenger":
            return Hands(bank=turns(rng, seconds), react=Mixed(0.3, 0.2))
    return Hands()


def turns(rng: np.random.Generator, seconds: float) -> Floats:
    """Return a bank in rad (n,): left, right or level for 6 to 18 s, reached within 1.5 s."""
    n = count(seconds)
    bank, at = np.zeros(n), 5000
    while at < n:
        stop = at + int(rng.integers(6_000, 18_000))
        side = float(rng.choice([-1.0, 0.0, 1.0]))
        bank[at:stop] = side * math.radians(rng.uniform(10.0, 35.0))
        at = stop
    return np.asarray(lfilter(np.full(1500, 1.0 / 1500), [1.0], bank))


def drift(rng: np.random.Generator, seconds: float) -> Floats:
    """Return a trim (n,) that wanders by at most 2 % of travel over half a minute."""
    return np.clip(wander(rng, count(seconds), 15.0, 0.01), -0.02, 0.02)


def played(seconds: float, columns: dict[str, Floats]) -> Played:
    """Return the flight of a motion whose columns (n,) have a value for each millisecond.

    They are ``r`` and ``p`` in rad/s, ``roll`` and ``pitch`` in rad, airspeed and ground speed in
    m/s, rudder and aileron in units. A column that is not given is 0.
    """
    zero = np.zeros(count(seconds))
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
        "position/h-sl-ft": zero + 20.0 / FOOT,
        "fcs/throttle-cmd-norm": zero + 0.3,
        "velocities/h-dot-fps": zero,
    }
    return Played(FlightPlan(seconds=seconds, manoeuvre="none"), properties, given)


def motion(group: str, rng: np.random.Generator, seconds: float, facts: Facts) -> dict[str, Floats]:
    """Return the columns of a motion: those of :func:`played`."""
    n = count(seconds)
    match group:
        case "hover" | "quadrotor":
            return _hover(rng, seconds, facts.get("wind_m_s", 0.0))
        case "tumble":
            return _tumble(rng, n)
        case "taxi":
            return _taxi(rng, seconds, facts["speed_m_s"])
    reach, tempo = float(rng.uniform(0.3, 1.0)), float(rng.uniform(0.5, 1.5))
    standing = {
        "r": wander(rng, n, 0.05, 0.003),
        "roll": wander(rng, n, 0.3, 0.002),
        "rudder": by_hand(rng, seconds, reach, tempo),
        "aileron": by_hand(rng, seconds, 0.5, 1.0),
        "airspeed": np.abs(facts["wind_m_s"] + wander(rng, n, 2.0, 0.5)),
        "groundspeed": np.abs(wander(rng, n, 5.0, 0.05)),
    }
    if group == "parked":  # with its engine running
        phase = math.tau * facts["line_hz"] * np.arange(n) * STEP_S + wander(rng, n, 5.0, 1.0)
        standing["r"] = standing["r"] + rng.uniform(0.002, 0.01) * np.sin(phase)
    return standing


def _hover(rng: np.random.Generator, seconds: float, wind: float) -> dict[str, Floats]:
    """Return a hover in gusts: a loop with a wn of 1 to 3 rad/s follows the pilot's headings."""
    n, every = count(seconds), 20
    asked = np.repeat(rng.uniform(-1.0, 1.0, math.ceil(n / 6000)), 6000)[:n:every]
    gust = wander(rng, n, 0.5, 0.15)[::every]
    wn, dt = rng.uniform(1.0, 3.0), every * STEP_S
    r = psi = 0.0
    found = []
    for heading, torque in zip(asked.tolist(), gust.tolist(), strict=True):
        command = float(np.clip(wn * wn * (heading - psi) - 0.6 * wn * r, -1.5, 1.5))
        r += dt * (command - 0.4 * wn * r + torque)
        psi += dt * r
        found.append((r, command))
    rates, commands = np.array(found).T
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


def _tumble(rng: np.random.Generator, n: int) -> dict[str, Floats]:
    """Return a tumble, rolling all the time; the controller moves the rudder against the rates."""
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


def _taxi(rng: np.random.Generator, seconds: float, speed: float) -> dict[str, Floats]:
    """Return a roll at 1 to 4.5 m/s in little wind, steered by a nose wheel on the pedals."""
    n = count(seconds)
    rolling = np.clip(speed + wander(rng, n, 5.0, 0.5), 0.5, 4.5)
    rudder = by_hand(rng, seconds, float(rng.uniform(0.2, 0.6)), 1.0)
    pole = math.exp(-STEP_S / 0.15)
    steered = lfilter([1.0 - pole], [1.0, -pole], rudder)
    return {
        "r": rolling / 2.0 * np.tan(0.3 * steered) + wander(rng, n, 0.1, 0.01),
        "airspeed": np.clip(rolling + wander(rng, n, 3.0, 0.4), 0.0, 4.9),
        "roll": wander(rng, n, 0.2, 0.005),
        "rudder": rudder,
        "groundspeed": rolling,
    }


def changed(group: str, rng: np.random.Generator, log: bytes, facts: Facts) -> tuple[bytes, Facts]:
    """Return the log as the vehicle of its kind sends it, and what is true of that."""
    match group:
        case "vibration":
            return with_line(log, rng, facts["line_hz"], facts["line_share"]), {}
        case "passenger":
            armed, status = bool(rng.random() < 0.5), bool(rng.random() < 0.5)
            return as_passenger(split(log), rng, armed=armed, status=status), {"armed": armed}
        case "hover":
            kind = int(rng.choice([mavlink.MAV_TYPE_FIXED_WING, mavlink.MAV_TYPE_VTOL_TILTROTOR]))
            mode = int(rng.choice([QSTABILIZE, QHOVER, QLOITER, AUTO]))
            as_sent = on_lift_motors(split(log), rng, kind=kind, mode=mode)
            return as_sent, {"mode": mode, "mav_type": kind}
        case "quadrotor":  # its third control is a torque, not a rudder
            return join(px4_controls(split(log), type=mavlink.MAV_TYPE_QUADROTOR)), {}
        case "disarmed":
            heartbeat = setting(base_mode=DISARMED, custom_mode=MANUAL)
            return join(edited(split(log), HEARTBEAT=heartbeat)), {}
    return log, {}


def with_line(log: bytes, rng: np.random.Generator, line_hz: float, share: float) -> bytes:
    """Add a vibration 0.05 Hz wide to the yaw rate of ATTITUDE.

    ``share`` is its part of the power of the result.
    """
    rates = [message.yawspeed for message in messages(split(log), "ATTITUDE")]
    amplitude = math.sqrt(2.0 * share / (1.0 - share) * float(np.var(rates)))
    phase, before_s = float(rng.uniform(0.0, math.tau)), 0.0
    width = math.sqrt(math.tau * 0.05)  # of the phase's random walk, in rad per square root of a s

    def attitude(message: Any) -> None:
        nonlocal phase, before_s
        now_s = message.time_boot_ms / 1000.0
        phase += float(rng.normal(0.0, width * math.sqrt(max(now_s - before_s, 0.0))))
        before_s = now_s
        message.yawspeed += amplitude * math.sin(math.tau * line_hz * now_s + phase)

    return join(edited(split(log), ATTITUDE=attitude))


def as_passenger(
    flown: list[Record], rng: np.random.Generator, *, armed: bool, status: bool
) -> bytes:
    """Return a flight's log as a PX4 sends it that is carried along and controls nothing.

    Its controls move, and its outputs do not; these are ACTUATOR_OUTPUT_STATUS with ``status``,
    else SERVO_OUTPUT_RAW. Its controls would level the wings and damp the yaw; the yaw control has
    a part of the roll control.
    """
    roll = yaw = 0.0
    gains = rng.uniform([0.6, 0.1, 0.2], [1.5, 0.6, 1.0])
    pulses = [1500, 1500, 900, 1500, 900, 900, 900, 900]

    def attitude(message: Any) -> None:
        nonlocal roll, yaw
        roll = -gains[0] * message.roll - 0.1 * message.rollspeed
        yaw = gains[1] * roll - gains[2] * message.yawspeed + rng.normal(0.0, 0.005)

    def servos(message: Any) -> list[Any]:
        time_us = message.time_usec
        asked = px4_control(time_us, *np.clip([roll, yaw], -1.0, 1.0).tolist())
        if not status:
            return [asked, mavlink.MAVLink_servo_output_raw_message(time_us, 0, *pulses)]
        values = [*map(float, pulses), *[0.0] * 24]
        return [asked, mavlink.MAVLink_actuator_output_status_message(time_us, 8, values)]

    mode = ARMED if armed else DISARMED
    heartbeat = setting(autopilot=mavlink.MAV_AUTOPILOT_PX4, base_mode=mode)
    edits = {"HEARTBEAT": heartbeat, "ATTITUDE": attitude, "SERVO_OUTPUT_RAW": servos}
    return join(edited(flown, PARAM_VALUE=lambda _: [], **edits))


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


APART = 34
"""The number of the other flight is larger by this: another aircraft, and the same air."""
LATE_S = 0.4
"""The time by which a late clock is late, in s."""
MISLEADING = ("other flight", "backwards", "late")


def misled(number: int, draw: Draw = CHOSEN) -> Made:
    """Return log ``number`` of the corpus; the kinds come in turn, and so do the flights."""
    number, nth = divmod(number, len(MISLEADING))
    made = excited(number, draw)
    flown = split(made.log)
    stamps, rudder = _pulses(flown)
    match MISLEADING[nth]:
        case "other flight":  # at the times of this one's messages
            theirs, other = _pulses(split(excited(number + APART, draw).log))
            at = np.searchsorted(theirs, stamps, side="right") - 1
            rudder = [other[max(i, 0)] for i in at]
        case "backwards":
            rudder = rudder[::-1]
        case "late":
            behind = sum(stamp < stamps[0] + 1e6 * LATE_S for stamp in stamps)
            rudder = [rudder[0]] * behind + rudder[: len(rudder) - behind]
    left = iter(rudder)

    def servos(message: Any) -> None:
        message.servo4_raw = next(left)

    assert made.truth is not None
    log = join(edited(flown, SERVO_OUTPUT_RAW=servos))
    return Made(log, made.truth | {"group": MISLEADING[nth]})


def _pulses(flown: list[Record]) -> tuple[list[int], list[int]]:
    """Return the stamps in us and the rudder's pulses of a log's SERVO_OUTPUT_RAW."""
    sent = [(m.time_usec, m.servo4_raw) for m in messages(flown, "SERVO_OUTPUT_RAW")]
    stamps, rudder = map(list, zip(*sent, strict=True))
    return stamps, rudder
