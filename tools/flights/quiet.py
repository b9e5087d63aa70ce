"""Logs of which none may have a usable answer: without excitation by the rudder, or misled.

What each kind draws is in quiet.toml. Those in the air are flown by JSBSim (turns, gusts, mixed and
damped rudders, a vibration, an autopilot that does not control the aircraft). The others are simple
motions without a flight model, in which the rudder moves no aircraft: lift motors, gusts, engines
and wheels do. A misled log has a rudder that is not the one that moved the aircraft: that of
another flight, its own reversed in time, or its own .4 s late. A yaw rate that decays freely has
the right frequency whatever the rudder did, so what is judged is the verdict.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Sequence
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scipy.signal import lfilter

from flights.flight import Hands
from flights.fly import Made, fly
from flights.moved import CHOSEN, Damper, Draw, Mixed, by_hand, drawn_link, excited, wander
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

GENTLY = Draw(places=(
    ("c172p", 3000.0, 100.0), ("J3Cub", 2000.0, 60.0), ("T37", 5000.0, 200.0),
    ("t6texan2", 5000.0, 180.0), ("OV10", 5000.0, 160.0), ("c172r", 3000.0, 90.0),
))  # fmt: skip
"""The places of the flights on which limits are chosen."""
RANGES: dict[str, dict[str, Any]] = tomllib.loads(
    Path(__file__).with_name("quiet.toml").read_text(encoding="utf-8")
)
KINDS = tuple(RANGES)
Columns = dict[str, Floats]


def unexcited(number: int, draw: Draw = GENTLY) -> Made:
    """Return log ``number`` of the corpus without excitation; the kinds come in turn."""
    rng = np.random.default_rng([draw.seed, 1, number])
    return quiet(KINDS[number % len(KINDS)], rng, draw.places)


def quiet(
    group: str,
    rng: np.random.Generator,
    places: Sequence[Place] = (),
    lengths_s: Sequence[float] = (60.0, 80.0, 100.0),
) -> Made:
    """Return a log of a kind and of one of the lengths; those in the air are flown at a place.

    Of a motion without a flight model nothing else is true than its kind.
    """
    own = RANGES[group]
    facts = {name: drawn(rng, of) for name, of in own.items() if name != "severity"}
    place = places[int(rng.integers(len(places)))] if "severity" in own else None
    still: dict[str, Any] = {"seconds": float(rng.choice(lengths_s)), "manoeuvre": "none"}
    plan = (
        plan_at(place, heading_deg=float(rng.integers(0, 360)), **still)
        if place
        else FlightPlan(**still)
    )
    severity = int(rng.choice(own.get("severity", [0])))
    link = drawn_link(rng)
    moves, edit = kind(group, rng, count(plan.seconds), facts)
    made = (
        fly(plan, link, moves, severity)
        if isinstance(moves, Hands)
        else Made(join(telemetry(link, played(plan, moves))))
    )
    log = join(edit(split(made.log))) if edit else made.log
    return Made(log, (made.truth or {}) | {"group": group})


def drawn(rng: np.random.Generator, of: Any) -> float:
    """Return a number of a list, or between ``low`` and ``high``, with so many ``digits``."""
    return (
        float(rng.choice(of))
        if isinstance(of, list)
        else round(float(rng.uniform(of["low"], of["high"])), int(of["digits"]))
    )


def kind(
    group: str, rng: np.random.Generator, n: int, facts: dict[str, float]
) -> tuple[Hands | Columns, partial[list[Record]] | None]:
    """Return the hands of a flight or the columns of a motion (n,), and what is sent of its log.

    In turns of the aileron alone and in turbulence the rudder does not move. Its trim wanders; it
    is a share of the aileron and noise (mixed), also behind a pilot's lag (coordinated, passenger);
    a yaw damper moves it; or it moves by at most 2 % of travel (vibration). All is drawn in the
    order in which it stands.
    """
    match group:
        case "turns":
            return Hands(bank=turns(rng, n)), None
        case "drift":
            bank = turns(rng, n) if rng.random() < 0.5 else None
            return Hands(drift(rng, n), bank=bank), None
        case "mixed" | "coordinated":  # the pilot's foot is slower than a mixer
            mixed = Mixed(facts["share"], facts["lag_s"])
            rustle = wander(rng, n, facts["noise_s"], facts["rudder_noise"])
            return Hands(rustle, bank=turns(rng, n), react=mixed), None
        case "damper":
            bank = turns(rng, n) if rng.random() < 0.5 else None
            return Hands(bank=bank, react=Damper(facts["damper"])), None
        case "vibration":
            foot = by_hand(rng, n, facts["foot"], 0.8) if facts["foot"] else drift(rng, n)
            return Hands(foot), partial(with_line, rng, facts["line_hz"], facts["line_share"])
        case "passenger":
            return Hands(bank=turns(rng, n), react=Mixed(0.3, 0.2)), partial(as_passenger, rng)
        case "hover":
            return _hover(rng, n, facts["wind_m_s"]), partial(on_lift_motors, rng)
        case "quadrotor":  # its third control is a torque, not a rudder
            return _hover(rng, n, 0.0), partial(px4_controls, type=mavlink.MAV_TYPE_QUADROTOR)
        case "tumble":
            return _tumble(rng, n), None
        case "parked":
            return _standing(rng, n, facts), None
        case "disarmed":
            return _standing(rng, n, facts), partial(
                edited, HEARTBEAT=setting(base_mode=DISARMED, custom_mode=0)
            )
        case "taxi":
            return _taxi(rng, n, facts["speed_m_s"]), None
    return Hands(), None


def turns(rng: np.random.Generator, n: int) -> Floats:
    """Return a bank in rad (n,): left, right or level for 6 to 18 s, reached within 1.5 s."""
    bank, at = np.zeros(n), 5000
    while at < n:
        stop = at + int(rng.integers(6_000, 18_000))
        bank[at:stop] = rng.choice([-1.0, 0.0, 1.0]) * math.radians(rng.uniform(10.0, 35.0))
        at = stop
    return np.asarray(lfilter(np.full(1500, 1.0 / 1500), [1.0], bank))


def drift(rng: np.random.Generator, n: int) -> Floats:
    """Return a trim (n,) that wanders by at most 2 % of travel over half a minute."""
    return np.clip(wander(rng, n, 15.0, 0.01), -0.02, 0.02)


def played(plan: FlightPlan, columns: Columns) -> Played:
    """Return the flight of a motion whose columns (n,) have a value for each millisecond.

    They are ``r`` and ``p`` in rad/s, ``roll`` and ``pitch`` in rad, airspeed and ground speed in
    m/s, rudder and aileron in units. A column that is not given is 0.
    """
    zero = np.zeros(count(plan.seconds))
    given = dict.fromkeys(("p", "pitch", "rudder", "aileron"), zero) | columns
    return Played(plan, {
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
    }, given)  # fmt: skip


def _standing(rng: np.random.Generator, n: int, facts: dict[str, float]) -> Columns:
    """Return the shaking of an aircraft on the ground; with ``line_hz`` its engine runs."""
    reach, tempo = float(rng.uniform(0.3, 1.0)), float(rng.uniform(0.5, 1.5))
    found = {
        "r": wander(rng, n, 0.05, 0.003),
        "roll": wander(rng, n, 0.3, 0.002),
        "rudder": by_hand(rng, n, reach, tempo),
        "aileron": by_hand(rng, n, 0.5, 1.0),
        "airspeed": np.abs(facts["wind_m_s"] + wander(rng, n, 2.0, 0.5)),
        "groundspeed": np.abs(wander(rng, n, 5.0, 0.05)),
    }
    if "line_hz" in facts:
        phase = math.tau * facts["line_hz"] * np.arange(n) * STEP_S + wander(rng, n, 5.0, 1.0)
        found["r"] = found["r"] + rng.uniform(0.002, 0.01) * np.sin(phase)
    return found


def _hover(rng: np.random.Generator, n: int, wind: float) -> Columns:
    """Return a hover in gusts: a loop with a wn of 1 to 3 rad/s follows the pilot's headings."""
    asked = np.repeat(rng.uniform(-1.0, 1.0, math.ceil(n / 6000)), 6000)[:n:20]
    gust = wander(rng, n, 0.5, 0.15)[::20]
    wn, dt = rng.uniform(1.0, 3.0), 20 * STEP_S
    r = psi = 0.0
    found = []
    for heading, torque in zip(asked.tolist(), gust.tolist(), strict=True):
        command = float(np.clip(wn * wn * (heading - psi) - 0.6 * wn * r, -1.5, 1.5))
        r += dt * (command - 0.4 * wn * r + torque)
        psi += dt * r
        found.append((r, command))
    rates, commands = (
        np.interp(np.arange(n) / 20, np.arange(len(gust)), each) for each in np.transpose(found)
    )
    roll = wander(rng, n, 0.6, 0.08)
    return {
        "r": rates,
        "roll": roll,
        "p": np.gradient(roll, STEP_S),
        "pitch": wander(rng, n, 0.6, 0.06),
        "rudder": 0.5 * commands,
        "aileron": -0.8 * roll,
        "airspeed": np.maximum(wind + wander(rng, n, 2.0, 0.7), 0.0),
        "groundspeed": np.abs(wander(rng, n, 4.0, 1.0)),
    }


def _tumble(rng: np.random.Generator, n: int) -> Columns:
    """Return a tumble, rolling all the time; the controller moves the rudder against the rates."""
    p, r = wander(rng, n, 0.4, 1.5), wander(rng, n, 0.3, 0.8)
    fought = -rng.uniform(0.2, 0.6) * r - rng.uniform(0.0, 0.2) * p
    delay = int(rng.integers(20, 80))
    return {
        "r": r,
        "p": p,
        "roll": np.remainder(math.pi + np.cumsum(p + 0.5) * STEP_S + math.pi, math.tau) - math.pi,
        "pitch": np.clip(wander(rng, n, 1.0, 0.7), -1.5, 1.5),
        "rudder": np.concatenate([np.zeros(delay), fought[:-delay]]),
        "aileron": -0.3 * p,
        "airspeed": 14.0 + wander(rng, n, 3.0, 3.0),
        "groundspeed": 12.0 + wander(rng, n, 3.0, 2.0),
    }


def _taxi(rng: np.random.Generator, n: int, speed: float) -> Columns:
    """Return a roll at 1 to 4.5 m/s in little wind, steered by a nose wheel on the pedals."""
    rolling = np.clip(speed + wander(rng, n, 5.0, 0.5), 0.5, 4.5)
    rudder = by_hand(rng, n, float(rng.uniform(0.2, 0.6)), 1.0)
    pole = math.exp(-STEP_S / 0.15)
    steered = lfilter([1.0 - pole], [1.0, -pole], rudder)
    return {
        "r": rolling / 2.0 * np.tan(0.3 * steered) + wander(rng, n, 0.1, 0.01),
        "airspeed": np.clip(rolling + wander(rng, n, 3.0, 0.4), 0.0, 4.9),
        "roll": wander(rng, n, 0.2, 0.005),
        "rudder": rudder,
        "groundspeed": rolling,
    }


def column(records: Sequence[Record], name: str, *fields: str) -> Floats:
    """Return these fields (fields, n) of all messages of a name."""
    return np.array([attrgetter(*fields)(message) for message in messages(records, name)]).T


def with_column(
    records: Sequence[Record], name: str, field: str, values: Sequence[float]
) -> list[Record]:
    """Return the records with other values (n,) in a field of all messages of a name."""
    left = iter(values)
    return edited(records, **{name: lambda message: setattr(message, field, next(left))})


def with_line(
    rng: np.random.Generator, line_hz: float, share: float, records: list[Record]
) -> list[Record]:
    """Add a vibration 0.05 Hz wide to the yaw rate of ATTITUDE.

    ``share`` is its part of the power of the result. Its phase has a random walk.
    """
    boot_ms, r = column(records, "ATTITUDE", "time_boot_ms", "yawspeed")
    t_s, start = boot_ms / 1000.0, rng.uniform(0.0, math.tau)
    amplitude = math.sqrt(2.0 * share / (1.0 - share) * float(np.var(r)))
    steps = rng.normal(0.0, np.sqrt(math.tau * 0.05 * np.diff(t_s, prepend=0.0)))
    phase = math.tau * line_hz * t_s + np.cumsum(np.append(start, steps))[1:]
    return with_column(records, "ATTITUDE", "yawspeed", r + amplitude * np.sin(phase))


def as_passenger(rng: np.random.Generator, records: list[Record]) -> list[Record]:
    """Return a flight's log as a PX4 sends it that is carried along and controls nothing.

    It may be armed. Its controls move, and its outputs do not; these are ACTUATOR_OUTPUT_STATUS or
    SERVO_OUTPUT_RAW. Its controls would level the wings and damp the yaw; the yaw control has a
    part of the roll control.
    """
    armed, has_status = rng.random(2) < 0.5
    gains = rng.uniform([0.6, 0.1, 0.2], [1.5, 0.6, 1.0])
    pulses, asked = [1500, 1500, 900, 1500, 900, 900, 900, 900], [0.0, 0.0]
    send, fields = (
        (mavlink.MAVLink_actuator_output_status_message, (8, [*map(float, pulses), *[0.0] * 24]))
        if has_status
        else (mavlink.MAVLink_servo_output_raw_message, (0, *pulses))
    )

    def attitude(message: Any) -> None:
        roll = -gains[0] * message.roll - 0.1 * message.rollspeed
        yaw = gains[1] * roll - gains[2] * message.yawspeed + rng.normal(0.0, 0.005)
        asked[:] = np.clip([roll, yaw], -1.0, 1.0).tolist()

    def servos(message: Any) -> list[Any]:
        return [px4_control(message.time_usec, *asked), send(message.time_usec, *fields)]

    return edited(
        records,
        HEARTBEAT=setting(
            autopilot=mavlink.MAV_AUTOPILOT_PX4, base_mode=ARMED if armed else DISARMED
        ),
        PARAM_VALUE=lambda _: [],
        ATTITUDE=attitude,
        SERVO_OUTPUT_RAW=servos,
    )


def on_lift_motors(rng: np.random.Generator, records: list[Record]) -> list[Record]:
    """Change a log into that of a quadplane, carried by lift motors on outputs 5 to 8.

    The modes are QSTABILIZE, QHOVER, QLOITER and AUTO.
    """
    motors = [  # their functions are 33 to 36
        mavlink.MAVLink_param_value_message(
            f"SERVO{5 + i}_FUNCTION".encode(), 33.0 + i, mavlink.MAV_PARAM_TYPE_INT16, 25, 21 + i
        )
        for i in range(4)
    ]

    def servos(message: Any) -> None:
        yaw = (message.servo4_raw - 1500) / 4.0
        for i, turn in enumerate((1, 1, -1, -1)):
            pulse = 1520 + turn * yaw + rng.normal(0.0, 8.0)
            setattr(message, f"servo{5 + i}_raw", round(float(np.clip(pulse, 1000, 2000))))

    def parameter(message: Any) -> list[Any]:
        return [message, motors.pop(0)] if motors else [message]

    return edited(
        records,
        HEARTBEAT=setting(
            type=int(rng.choice([mavlink.MAV_TYPE_FIXED_WING, mavlink.MAV_TYPE_VTOL_TILTROTOR])),
            custom_mode=int(rng.choice([17, 18, 19, 10])),
        ),
        PARAM_VALUE=parameter,
        SERVO_OUTPUT_RAW=servos,
    )


MISLEADING = ("other flight", "backwards", "late")


def misled(number: int, draw: Draw = CHOSEN) -> Made:
    """Return log ``number`` of the corpus; the kinds come in turn, and so do the flights."""
    number, nth = divmod(number, len(MISLEADING))
    made = excited(number, draw)
    servos = "SERVO_OUTPUT_RAW", "time_usec", "servo4_raw"
    flown = split(made.log)
    stamps, rudder = column(flown, *servos)
    match MISLEADING[nth]:
        case "other flight":  # of another aircraft in the same air, at this one's times
            theirs, other = column(split(excited(number + 34, draw).log), *servos)
            rudder = other[np.maximum(np.searchsorted(theirs, stamps, side="right") - 1, 0)]
        case "backwards":
            rudder = rudder[::-1]
        case "late":
            behind = np.searchsorted(stamps, stamps[0] + 0.4e6)
            rudder = rudder[np.maximum(np.arange(len(rudder)) - behind, 0)]
    sent = with_column(flown, "SERVO_OUTPUT_RAW", "servo4_raw", rudder.astype(int).tolist())
    return Made(join(sent), (made.truth or {}) | {"group": MISLEADING[nth]})
