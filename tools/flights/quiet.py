"""Logs of which none may have a usable answer: without excitation by the rudder, or misled.

Those in the air are flown by JSBSim (turns, gusts, mixed and damped rudders, a vibration, an
autopilot that does not control the aircraft); hovering, tumbling, parked and rolling are simple
motions (flights/drawn.py). A misled log has a rudder that is not the one that moved the aircraft:
that of another flight, its own reversed in time, or its own late. A yaw rate that decays freely has
the right frequency whatever the rudder did, so what is judged is the verdict.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scipy.signal import lfilter

from flights.drawn import (
    ARMED,
    DISARMED,
    LENGTHS_S,
    disarmed,
    hovering,
    parked,
    quadrotor,
    taxiing,
    tumbling,
)
from flights.flight import Floats, Hands
from flights.fly import Made, fly
from flights.moved import (
    CHOSEN,
    SEED,
    Damper,
    Draw,
    Mixed,
    by_hand,
    count,
    drawn_link,
    excited,
    wander,
)
from flights.plan import Place, plan_at
from flights.surgery import Record, edited, join, message_id, payload, px4_control, setting, split

GENTLE = (
    ("c172p", 3000.0, 100.0), ("J3Cub", 2000.0, 60.0), ("T37", 5000.0, 200.0),
    ("t6texan2", 5000.0, 180.0), ("OV10", 5000.0, 160.0), ("c172r", 3000.0, 90.0),
)  # fmt: skip
GENTLY = Draw(SEED, GENTLE)
"""The places and the seed of the flights on which limits are chosen."""
Places = Sequence[Place]


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


def in_the_air(
    rng: np.random.Generator,
    places: Places,
    hands: Callable[[float], Hands],
    severities: Sequence[int],
    **facts: Any,
) -> Made:
    """Fly one of the aircraft; ``hands`` is called with the length of the flight in s."""
    place = places[int(rng.integers(len(places)))]
    seconds = float(rng.choice(LENGTHS_S))
    heading_deg = float(rng.integers(0, 360))
    plan = plan_at(place, heading_deg=heading_deg, seconds=seconds, manoeuvre="none")
    severity = int(rng.choice(severities))
    return fly(plan, drawn_link(rng), hands(seconds), severity, **facts)


def turning(rng: np.random.Generator, places: Places) -> Made:
    """Fly turns with the aileron alone, while the rudder does not move."""
    return in_the_air(rng, places, lambda s: Hands(bank=turns(rng, s)), (0, 0, 1, 2))


def gusts(rng: np.random.Generator, places: Places) -> Made:
    """Fly wings level in turbulence, while the rudder does not move."""
    return in_the_air(rng, places, lambda s: Hands(), (1, 2, 3, 4))


def drifting(rng: np.random.Generator, places: Places) -> Made:
    """Fly in turbulence, half of the flights in turns, while the rudder's trim wanders."""

    def hands(seconds: float) -> Hands:
        bank = turns(rng, seconds) if rng.random() < 0.5 else None
        return Hands(rudder=drift(rng, seconds), bank=bank)

    return in_the_air(rng, places, hands, (0, 1, 2, 3, 4))


def mixed(rng: np.random.Generator, places: Places) -> Made:
    """Fly with an autopilot whose rudder is a share of its aileron with a little noise."""
    share = round(float(rng.uniform(0.2, 1.0)), 2)
    noise = float(rng.choice([0.0, 0.001, 0.003]))

    def hands(seconds: float) -> Hands:
        rustle = wander(rng, count(seconds), 0.1, noise)
        return Hands(bank=turns(rng, seconds), react=Mixed(share, noise=rustle))

    return in_the_air(rng, places, hands, (0, 1, 2, 3), share=share, rudder_noise=noise)


def coordinated(rng: np.random.Generator, places: Places) -> Made:
    """Fly a pilot's coordinated turns: the rudder lags the aileron by 0.1 to 0.3 s."""
    share, lag_s = (round(float(rng.uniform(*ends)), 2) for ends in ((0.2, 0.8), (0.1, 0.3)))

    def hands(seconds: float) -> Hands:
        foot = wander(rng, count(seconds), 0.5, 0.003)
        return Hands(bank=turns(rng, seconds), react=Mixed(share, lag_s, foot))

    return in_the_air(rng, places, hands, (0, 0, 1, 2), share=share, lag_s=lag_s)


def damped(rng: np.random.Generator, places: Places) -> Made:
    """Fly in turbulence, half of the flights in turns; only a yaw damper moves the rudder."""
    gain = round(float(rng.uniform(0.3, 1.5)), 2)

    def hands(seconds: float) -> Hands:
        bank = turns(rng, seconds) if rng.random() < 0.5 else None
        return Hands(bank=bank, react=Damper(gain))

    return in_the_air(rng, places, hands, (1, 2, 3, 4), damper=gain)


def vibrating(rng: np.random.Generator, places: Places) -> Made:
    """Add a vibration of 2 to 4 Hz to the gyro; the rudder moves by at most 2 % of travel."""
    line_hz = round(float(rng.uniform(2.0, 4.0)), 2)
    share = round(float(rng.uniform(0.1, 0.7)), 2)
    foot = float(rng.choice([0.0, 0.01, 0.02]))

    def hands(seconds: float) -> Hands:
        return Hands(by_hand(rng, seconds, foot, 0.8) if foot else drift(rng, seconds))

    made = in_the_air(rng, places, hands, (1, 2, 3), line_hz=line_hz, line_share=share)
    return Made(with_line(made.log, line_hz, share, rng), made.truth)


def with_line(log: bytes, line_hz: float, share: float, rng: np.random.Generator) -> bytes:
    """Add a vibration 0.05 Hz wide to the yaw rate of ATTITUDE.

    ``share`` is its part of the power of the result.
    """
    rates = [
        struct.unpack_from("<f", payload(frame, 28), 24)[0]
        for _, frame in split(log)
        if message_id(frame) == mavlink.MAVLINK_MSG_ID_ATTITUDE
    ]
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


def passenger(rng: np.random.Generator, places: Places) -> Made:
    """Carry a PX4 along that controls nothing: its controls move, its outputs do not.

    In half of the logs it is disarmed.
    """

    def hands(seconds: float) -> Hands:
        return Hands(bank=turns(rng, seconds), react=Mixed(0.3, 0.2))

    made = in_the_air(rng, places, hands, (0, 1, 2))
    armed, status = bool(rng.random() < 0.5), bool(rng.random() < 0.5)
    log = as_passenger(split(made.log), rng, armed=armed, status=status)
    assert made.truth is not None
    return Made(log, made.truth | {"armed": armed})


def as_passenger(
    flown: list[Record], rng: np.random.Generator, *, armed: bool, status: bool
) -> bytes:
    """Return a flight's log as such a PX4 sends it.

    Its outputs are ACTUATOR_OUTPUT_STATUS with ``status``, else SERVO_OUTPUT_RAW. Its controls
    would level the wings and damp the yaw; the yaw control has a part of the roll control.
    """
    roll = yaw = 0.0
    gains = rng.uniform([0.6, 0.1, 0.2], [1.5, 0.6, 1.0])

    def attitude(message: Any) -> None:
        nonlocal roll, yaw
        roll = -gains[0] * message.roll - 0.1 * message.rollspeed
        yaw = gains[1] * roll - gains[2] * message.yawspeed + rng.normal(0.0, 0.005)

    def servos(message: Any) -> list[Any]:
        asked = px4_control(message.time_usec, *np.clip([roll, yaw], -1.0, 1.0).tolist())
        return [asked, _still_outputs(message.time_usec, status)]

    mode = DISARMED | ARMED if armed else DISARMED
    heartbeat = setting(autopilot=mavlink.MAV_AUTOPILOT_PX4, base_mode=mode)
    edits = {"HEARTBEAT": heartbeat, "ATTITUDE": attitude, "SERVO_OUTPUT_RAW": servos}
    return join(edited(flown, PARAM_VALUE=lambda _: [], **edits))


def _still_outputs(time_us: int, status: bool) -> Any:
    pulses = [1500, 1500, 900, 1500, 900, 900, 900, 900]
    if not status:
        return mavlink.MAVLink_servo_output_raw_message(time_us, 0, *pulses)
    values = [float(pulse) for pulse in pulses] + [0.0] * 24
    return mavlink.MAVLink_actuator_output_status_message(time_us, 8, values)


AIR: dict[str, Callable[[np.random.Generator, Places], Made]] = {
    "turns": turning,
    "gusts": gusts,
    "drift": drifting,
    "mixed": mixed,
    "coordinated": coordinated,
    "damper": damped,
    "vibration": vibrating,
    "passenger": passenger,
}
GROUND: dict[str, Callable[[np.random.Generator], Made]] = {
    "hover": hovering,
    "quadrotor": quadrotor,
    "tumble": tumbling,
    "parked": parked,
    "disarmed": disarmed,
    "taxi": taxiing,
}
KINDS = (*AIR, *GROUND)


def unexcited(number: int, draw: Draw = GENTLY) -> Made:
    """Return log ``number`` of the corpus without excitation; the kinds come in turn."""
    group = KINDS[number % len(KINDS)]
    rng = np.random.default_rng([draw.seed, 1, number])
    made = AIR[group](rng, draw.places) if group in AIR else GROUND[group](rng)
    assert made.truth is not None
    return Made(made.log, made.truth | {"group": group})


APART = 34
"""The number of the other flight is larger by this: another aircraft, and the same air."""
LATE_S = 0.4
"""The time by which a late clock is late, in s."""


Pulses = list[tuple[int, int]]
"""The stamp in us and the rudder's pulse of each SERVO_OUTPUT_RAW."""


def pulses(flown: list[Record]) -> Pulses:
    """Return the pulses of the rudder in a log."""
    servos = mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW
    frames = (frame for _, frame in flown if message_id(frame) == servos)
    found = (struct.unpack("<I4H", payload(frame, 12)) for frame in frames)
    return [(time_us, rudder) for time_us, *_, rudder in found]


def other(own: Pulses, number: int, draw: Draw) -> list[int]:
    """Return the rudder of another flight, at the times of this one's messages."""
    stamps, rudder = zip(*pulses(split(excited(number + APART, draw).log)), strict=True)
    at = np.searchsorted(stamps, [stamp for stamp, _ in own], side="right") - 1
    return [rudder[max(i, 0)] for i in at]


def backwards(own: Pulses, number: int, draw: Draw) -> list[int]:
    """Return a flight's rudder, reversed in time."""
    return [pulse for _, pulse in reversed(own)]


def late(own: Pulses, number: int, draw: Draw) -> list[int]:
    """Return a flight's rudder by a clock that is late."""
    behind = sum(stamp < own[0][0] + 1e6 * LATE_S for stamp, _ in own)
    return [own[0][1]] * behind + [pulse for _, pulse in own[: len(own) - behind]]


MISLEADING: dict[str, Callable[[Pulses, int, Draw], list[int]]] = {
    "other flight": other,
    "backwards": backwards,
    "late": late,
}


def misled(number: int, draw: Draw = CHOSEN) -> Made:
    """Return log ``number`` of the corpus; the kinds come in turn, and so do the flights."""
    number, nth = divmod(number, len(MISLEADING))
    kind, made = list(MISLEADING)[nth], excited(number, draw)
    flown = split(made.log)
    left = iter(MISLEADING[kind](pulses(flown), number, draw))

    def servos(message: Any) -> None:
        message.servo4_raw = next(left)

    assert made.truth is not None
    log = join(edited(flown, SERVO_OUTPUT_RAW=servos))
    return Made(log, made.truth | {"group": kind})
