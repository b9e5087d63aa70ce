"""The flight test card of a log, made from its answer, its channels and how it was flown.

What the log does not give is None, and the card leaves a blank to be filled in by hand. Only the
Dutch roll's period is always given, because every time on the card depends on it: where the log has
no usable answer, the period is guessed from the airspeed, and the card says so.
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from yawid.answers.flight_test_card import (
    AileronDoublet,
    ConditionsToFly,
    Expected,
    FlightTestCard,
    ManoeuvreToFly,
    ModeToFly,
    ParameterToSet,
    SurfaceMove,
)
from yawid.answers.heard import VehicleSeen
from yawid.answers.inspection import Can
from yawid.answers.more_manoeuvres import MANOEUVRES, expected
from yawid.answers.reasons import ASK_HZ, Verdict
from yawid.answers.run_summary import (
    ChannelFound,
    DutchRoll,
    Manoeuvre,
    RunSummary,
)
from yawid.blocks import Floats, Noted, SampleBlock
from yawid.quantities.airspeed import GROUND_SPEED, source_of
from yawid.quantities.vehicles import AIRFRAME, ARDUPILOT, PX4, WITH_ROLL_LOOP, WITHOUT_RUDDER

SAMPLES_PER_PERIOD: Final = 16.0
"""The message rate to ask for, in samples per period of the Dutch roll."""
ENOUGH: Final = 0.9
"""The part of that rate that is enough."""
LEAST_HZ, MOST_HZ = 10.0, 50.0
"""The lowest message rate in Hz that may be enough, and the highest that is asked for."""
NICE_HZ: Final = (5.0, 10.0, 20.0, 25.0, 40.0, 50.0, 100.0)
"""Round message rates in Hz to ask for."""
SMALL_M_S: Final = 32.0
"""An aircraft that flies slower than this, in m/s, counts as small."""
GUESSES: Final = {True: 6.0, False: 2.5}
"""wn in rad/s where it is unknown: of a small aircraft (or an unknown airspeed), and of others."""
LOW_PCT, HIGH_PCT = 15.0, 30.0
"""Percent of half the rudder's travel to move it by: to begin with, and at most."""
DOUBLETS: Final = 3
"""Doublets in a manoeuvre, left first and right first in turn: three separate mode and noise."""
LONGEST_PAUSE_S: Final = 3.5
"""The longest pause between doublets, in s: after five seconds of rest a manoeuvre has ended."""
REST_S: Final = 10.0
"""The time of rest in s after a manoeuvre, which ends it."""
SETTLE_S: Final = 45.0
"""The time in s to turn, trim and settle on another airspeed."""
APART: Final = 0.1
"""Airspeeds that differ by less than this part are one condition."""
WIDE, STALL_ROOM, ROOM = 0.15, 1.2, 1.05
"""The greatest distance from the median, and the margins to the limits in the parameters."""
ENDS_PCT: Final = (10.0, 50.0, 90.0)
"""The percentiles that describe how it was flown."""
MOST_REASONS: Final = 2
"""How many of the verdict's reasons the card repeats at most."""
BARE_WN_SHARE, BARE_ZETA, BARE_ZETA_SHARE = 0.012, 0.012, 0.03
"""Sigmas of the bare airframe after one manoeuvre with an aileron doublet, of wn relative to wn:
medians of 31 such flights of JSBSim, and the share of zeta that is the least."""
MIXES: Final[Mapping[int, Mapping[str, str]]] = {
    ARDUPILOT: {
        "KFF_RDDRMIX": "rudder follows the aileron",
        "YAW2SRV_DAMP": "yaw damper moves the rudder: leave it on only to check its gain",
        "YAW2SRV_SLIP": "sideslip loop moves the rudder",
    },
    PX4: {"FW_RLL_TO_YAW_FF": "rudder follows the roll demand"},
}
"""Parameters, by autopilot, that let the autopilot move the rudder; they are 0 for the test."""
ALWAYS: Final = ("KFF_RDDRMIX", "FW_RLL_TO_YAW_FF")
"""Those of them that the card lists even where the log does not hold them."""
LIMITS: Final = {
    "least": ("AIRSPEED_MIN", "ARSPD_FBW_MIN", "FW_AIRSPD_MIN"),
    "most": ("AIRSPEED_MAX", "ARSPD_FBW_MAX", "FW_AIRSPD_MAX"),
}
"""Parameters that hold the least and the greatest airspeed, the newest names first."""
MODES: Final = {ARDUPILOT: ("MANUAL", "FBWA"), PX4: ("MANUAL", "STABILIZED")}
"""By autopilot, the mode that shows the bare airframe, and one that shows it with a roll loop."""


@dataclass(frozen=True, slots=True)
class Flown:
    """Airspeed in m/s and altitude in m in the air: the 10th, 50th and 90th percentile of each.

    ``airspeed_source`` names the source of the airspeed: some logs only have the ground speed.
    """

    airspeed_m_s: Sequence[float] = ()
    altitude_m: Sequence[float] = ()
    airspeed_source: str | None = None

    @classmethod
    def of(cls, samples: SampleBlock) -> "Flown":
        """Return it for all samples that are not held; those on the ground are held."""
        used = samples.held == 0
        speeds, heights = (_percentiles(x[used]) for x in (samples.airspeed, samples.altitude))
        source = source_of(samples.noted[used] & Noted.GROUND_SPEED.value != 0)
        return cls(speeds, heights, source if speeds else None)


def why_no_card(vehicle: VehicleSeen | None, verdict: Verdict) -> str | None:
    """Return why there is no card for a log, None where there is; a record needs no vehicle."""
    if vehicle is None:
        unheard = any(reason.id == "no_vehicle" for reason in verdict.reasons)
        return "no card: the log holds no vehicle" if unheard else None
    if vehicle.type in WITHOUT_RUDDER:
        return f"no card: a {vehicle.type_name} has no rudder to move"
    return None


def make_card(
    summary: RunSummary,
    can: Mapping[str, Can],
    flown: Flown,
    rates_hz: Mapping[str, float],
    parameters: Mapping[str, float],
    rudder_max_deg: float | None,
    live: str | None,
) -> FlightTestCard:
    """Return the card for the aircraft of a summary, for which :func:`why_no_card` is None.

    ``can`` says what the log gives; ``rates_hz`` holds the message rates by "yaw" and "rudder",
    ``parameters`` the vehicle's parameters; ``rudder_max_deg`` is the rudder's full deflection in
    degrees, None where unknown, and ``live`` the command for a live session.
    """
    autopilot = None if summary.vehicle is None else summary.vehicle.autopilot
    flight = summary.flight
    rests_on = () if flight is None else flight.used
    used = [each for each in summary.manoeuvres or () if each.n in rests_on]
    roll = summary.dutch_roll if flight is None else flight.dutch_roll
    if not summary.deciding.usable:
        roll, flight, used = None, None, []
    conditions = _conditions(autopilot, used, flown, parameters)
    speed = conditions.airspeed_m_s
    wn = GUESSES[speed is None or speed < SMALL_M_S] if roll is None else roll.wn_rad_s
    amplitude = [
        _move(percent, summary.channels.get("rudder"), rudder_max_deg)
        for percent in (LOW_PCT, HIGH_PCT)
    ]
    manoeuvre = _manoeuvre(wn, roll, len(conditions.airspeeds_m_s), amplitude)
    aileron = None
    if roll is not None and speed is not None and {each.loop for each in used} == {WITH_ROLL_LOOP}:
        aileron = _aileron(roll, manoeuvre, summary.channels.get("aileron"))
    return FlightTestCard(
        vehicle="not known: a record" if summary.vehicle is None else summary.vehicle.kind,
        autopilot=autopilot,
        ask_hz=_ask_hz(wn),
        yaw_hz=rates_hz.get("yaw"),
        rudder_hz=rates_hz.get("rudder"),
        rates_suffice=len(rates_hz) == 2 and min(rates_hz.values()) >= _least_hz(roll),
        rates=list(_rates(autopilot, parameters, _ask_hz(wn))),
        parameters=list(_mixes(autopilot, parameters)),
        conditions=conditions,
        manoeuvre=manoeuvre,
        aileron=aileron,
        answer=roll,
        answered=[manoeuvre.n for manoeuvre in used],
        expected=list(expected(flight)),
        lacks=list(_lacks(summary, can, used, aileron)),
        live=live,
    )


def _conditions(
    autopilot: int | None, used: Sequence[Manoeuvre], flown: Flown, parameters: Mapping[str, float]
) -> ConditionsToFly:
    speeds, heights = flown.airspeed_m_s or (None,) * 3, flown.altitude_m or (None,) * 3
    limits = _limit("least", parameters), _limit("most", parameters)
    return ConditionsToFly(
        airspeed_source=flown.airspeed_source,
        airspeed_low_m_s=speeds[0],
        airspeed_m_s=speeds[1],
        airspeed_high_m_s=speeds[2],
        airspeed_least_m_s=limits[0],
        airspeed_most_m_s=limits[1],
        airspeeds_m_s=[] if flown.airspeed_source == GROUND_SPEED else _airspeeds(speeds, limits),
        altitude_low_m=heights[0],
        altitude_high_m=heights[2],
        modes=list(_modes(autopilot, used)),
    )


def _manoeuvre(
    wn: float, roll: DutchRoll | None, airspeeds: int, amplitude: list[SurfaceMove]
) -> ManoeuvreToFly:
    """Return the manoeuvre for a wn in rad/s, which is a guess where ``roll`` is None."""
    period_s = _period_s(wn, 0.0 if roll is None else roll.zeta)
    pause_s = min(max(2.0 * period_s, 1.0), LONGEST_PAUSE_S)
    manoeuvre_s = DOUBLETS * (period_s + pause_s)
    return ManoeuvreToFly(
        wn_rad_s=wn,
        wn_guessed=roll is None,
        period_s=period_s,
        side_s=period_s / 2.0,
        unit_s=period_s / 4.0,
        doublets=DOUBLETS,
        pause_s=pause_s,
        manoeuvres=MANOEUVRES,
        rest_s=REST_S,
        manoeuvre_s=manoeuvre_s,
        total_s=max(airspeeds, 1) * (MANOEUVRES * (manoeuvre_s + REST_S) + SETTLE_S),
        amplitude=amplitude,
    )


def _aileron(
    roll: DutchRoll, manoeuvre: ManoeuvreToFly, channel: ChannelFound | None
) -> AileronDoublet | None:
    """Return the aileron's doublet, None where messages cannot be fast enough for the airframe.

    It ends before the rudder's rest ends the manoeuvre.
    """
    if roll.airframe_hz > MOST_HZ:
        return None
    zeta_std = max(BARE_ZETA, BARE_ZETA_SHARE * roll.zeta)
    return AileronDoublet(
        after_s=manoeuvre.pause_s / 2.0,
        side_s=manoeuvre.unit_s,
        amplitude=_move(LOW_PCT, channel, None),
        ask_hz=MOST_HZ,
        expected=Expected(more=1, wn_std=BARE_WN_SHARE * roll.wn_rad_s, zeta_std=zeta_std),
    )


def _percentiles(x: Floats) -> Sequence[float]:
    known = x[np.isfinite(x)]
    return tuple(np.percentile(known, ENDS_PCT).tolist()) if len(known) else ()


def _period_s(wn: float, zeta: float) -> float:
    """Return the period in s of the damped oscillation; a zeta above 0.8 counts as 0.8."""
    return 2.0 * math.pi / (wn * math.sqrt(1.0 - min(max(zeta, 0.0), 0.8) ** 2))


def _least_hz(roll: DutchRoll | None) -> float:
    """Return the message rate in Hz that is enough for a Dutch roll, also for an unknown one."""
    if roll is None:
        return ENOUGH * ASK_HZ
    return ENOUGH * max(LEAST_HZ, SAMPLES_PER_PERIOD * roll.wn_rad_s / (2.0 * math.pi))


def _ask_hz(wn: float) -> float:
    wanted = SAMPLES_PER_PERIOD * wn / (2.0 * math.pi)
    least = min(max(ENOUGH * wanted, ASK_HZ), MOST_HZ)
    return next(rate for rate in NICE_HZ if rate >= least)


def _rates(
    autopilot: int | None, parameters: Mapping[str, float], ask_hz: float
) -> Iterator[ParameterToSet]:
    """Yield ArduPilot's parameters for stream rates, by the names that its version has."""
    if autopilot != ARDUPILOT:
        return
    for stream, why in (("EXTRA1", "ATTITUDE"), ("RC_CHAN", "SERVO_OUTPUT_RAW")):
        named = {prefix: re.compile(rf"{prefix}\d+_{stream}") for prefix in ("SR", "MAV")}
        now = {
            prefix: {name: value for name, value in parameters.items() if pattern.fullmatch(name)}
            for prefix, pattern in named.items()
        }
        known = [prefix for prefix in now if now[prefix]]
        name = " or ".join(f"{prefix}n_{stream}" for prefix in known or now)
        values = now[known[0]] if known else {}
        yield ParameterToSet(name=name, to=ask_hz, now=values, why=why)


def _mixes(autopilot: int | None, parameters: Mapping[str, float]) -> Iterator[ParameterToSet]:
    """Yield the parameters that mix into the rudder: those set, and common ones without a value."""
    for name, why in MIXES.get(autopilot or 0, {}).items():
        value = parameters.get(name)
        if value or (value is None and name in ALWAYS):
            now = {} if value is None else {name: value}
            yield ParameterToSet(name=name, to=0.0, now=now, why=why)


def _modes(autopilot: int | None, used: Sequence[Manoeuvre]) -> Iterator[ModeToFly]:
    for mode, loop in zip(MODES.get(autopilot or 0, ()), (AIRFRAME, WITH_ROLL_LOOP), strict=False):
        yield ModeToFly(mode=mode, loop=loop, answered=[m.n for m in used if m.loop == loop])


def _limit(which: str, parameters: Mapping[str, float]) -> float | None:
    return next((v for name in LIMITS[which] if (v := parameters.get(name, 0.0)) > 0.0), None)


def _airspeeds(flown: Sequence[float | None], limits: Sequence[float | None]) -> list[float]:
    """Return the median airspeed in m/s, and one at either side where the flight had such a one.

    The outer ones are about 10 to 15 % from it, enough to show how wn depends on V, and keep a
    margin to ``limits``, the least and the greatest: take-off and landing were flown too. Nothing
    is returned where the percentiles ``flown`` are unknown.
    """
    low, middle, high = flown
    if low is None or middle is None or high is None:
        return []
    least, most = limits
    low = max(low, (1.0 - WIDE) * middle, STALL_ROOM * (least or 0.0))
    high = min(high, (1.0 + WIDE) * middle, (most or math.inf) / ROOM)
    chosen = [middle]
    if middle > (1.0 + APART) * low:
        chosen.insert(0, low)
    if high > (1.0 + APART) * middle:
        chosen.append(high)
    return [round(each, 1) for each in chosen]


def _move(percent: float, surface: ChannelFound | None, max_deg: float | None) -> SurfaceMove:
    """Return a movement of ``percent``; a surface of two servos has no single pulse width."""
    low = high = None
    if surface is not None and not surface.source.count("servo") > 1:
        least, trim, most = surface.min_us, surface.trim_us, surface.max_us
        if least is not None and trim is not None and most is not None:
            low = round(trim - percent / 100.0 * (trim - least))
            high = round(trim + percent / 100.0 * (most - trim))
    deg = None if max_deg is None else percent / 100.0 * max_deg
    return SurfaceMove(percent=percent, low_us=low, high_us=high, deg=deg)


def _spread(used: Sequence[Manoeuvre]) -> float:
    """Return the manoeuvres' largest airspeed over their smallest, less 1; 0 where unknown."""
    speeds = [each.airspeed_m_s for each in used if each.airspeed_m_s]
    return max(speeds) / min(speeds) - 1.0 if speeds else 0.0


def _lacks(
    summary: RunSummary,
    can: Mapping[str, Can],
    used: Sequence[Manoeuvre],
    aileron: AileronDoublet | None,
) -> Iterator[str]:
    """Yield in words what the log cannot answer yet."""
    yield from can["flown"].lacks[:MOST_REASONS]
    loops = {manoeuvre.loop for manoeuvre in used}
    if loops == {"unknown"}:
        yield "whose answer it is: the flight mode is not known"
    elif used and can["bare"].lacks:
        yield f"the bare airframe: {can['bare'].lacks[0]}"
    elif used and "airframe" not in loops and not summary.bare:
        how = "" if aileron is None else ", or one with the aileron's doublet of part 3"
        yield f"the bare airframe: fly a manoeuvre without the roll loop{how}"
    if used and _spread(used) < APART:
        yield "how wn varies with the airspeed: all manoeuvres are at one"
    if used and len(used) < MANOEUVRES:
        yield f"how manoeuvres scatter: {len(used)} of {MANOEUVRES} needed"
