"""Flies a plan: returns the log that its telemetry link would deliver, and its truth.

A plan with legs is flown by a simple autopilot: the throttle holds the airspeed and the nose the
climb; the ailerons hold the bank, except in MANUAL. There is no feedback of the yaw rate. In a
manoeuvre, the nose's attitude and the throttle do not change: a rudder sequence costs 1 to 3 % of
the airspeed, so the truth is linearised at the airspeed flown.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import jsbsim
import numpy as np

from flights.flight import PITCH_GAIN, PITCH_RATE_GAIN, Flight, Hands, stir
from flights.linear import SEVERITY
from flights.plan import (
    FOOT,
    KNOT,
    MODES,
    STEP_S,
    FlightPlan,
    Floats,
    Leg,
    excitation,
    rudder_moves,
)
from flights.surgery import join
from flights.telemetry import Link, telemetry
from flights.truth import (
    after_lead_in,
    flown_dutch_rolls,
    linear_dutch_rolls,
    modes_at,
    truth_lines,
)


@dataclass(frozen=True, slots=True)
class Made:
    """A log, and its truth if there is one."""

    log: bytes
    truth: dict[str, Any] | None = None


def written(made: Made) -> str:
    """Return the truth of a flight as JSON, without that at other airspeeds than its mean."""
    shown = {name: x for name, x in (made.truth or {}).items() if name not in ("lines", "flown")}
    return json.dumps(shown, indent=1) + "\n"


def flight_of(
    plan: FlightPlan, link: Link, hands: Hands | None = None, severity: int = 0
) -> Flight:
    """Return the flight of a plan before its first millisecond.

    ``hands`` and ``severity`` are for a plan without legs. Without ``hands``, only the rudder moves
    as the plan says, and the elevator does not move.

    Raises:
        FlightError: the aircraft cannot be loaded or trimmed, or trim and moves pass the stops.
    """
    if plan.legs:
        return LegFlight(plan, link)
    return Flight(plan, hands or Hands(excitation(plan), nose_held=False), link, severity)


def fly(
    plan: FlightPlan,
    link: Link,
    hands: Hands | None = None,
    severity: int = 0,
    **facts: Any,
) -> Made:
    """Fly a plan; return the log and its truth, which also has the items of ``facts``.

    The truth of a plan with legs is that of :func:`leg_truth`. The truth of other plans has the
    Dutch roll at the airspeeds and the altitude flown: ``dutch_roll`` with the roll hold, but
    without any feedback by ``hands``, and ``dutch_roll_open_loop`` of the airframe alone, which a
    model with the aileron as an input should find. For other airspeeds it has ``lines`` (see
    :func:`truth_lines`) and ``flown``, the airspeeds as pairs of s since boot and kt.

    Raises:
        FlightError: the aircraft cannot be trimmed or flown as asked.
    """
    flight = flight_of(plan, link, hands, severity)
    log = join(telemetry(link, flight))
    if isinstance(flight, LegFlight):
        return Made(log, leg_truth(plan, link, flight) | facts)
    flown = after_lead_in(flight.flown)
    lines = truth_lines(plan, flown)
    speed_kt, altitude_ft = flown[:, 1:3].mean(axis=0).tolist()
    conditions = {
        "aircraft": plan.aircraft, "jsbsim": jsbsim.__version__, "severity": severity,
        "seed": link.seed,
        "airspeed_m_s": round(speed_kt * KNOT, 3), "altitude_m": round(altitude_ft * FOOT, 1),
        "speed_kt": plan.speed_kt, "seconds": plan.seconds, "manoeuvre": plan.manoeuvre,
        "amplitude": plan.amplitude, "attitude_hz": link.attitude_hz, "servo_hz": link.servo_hz,
        "rate_noise": link.rate_noise,
    }  # fmt: skip
    at = [[round(s + link.boot_s, 2), round(kt, 3)] for s, kt, *_ in flight.flown]
    return Made(
        log, conditions | modes_at(lines, flown[:, 1]) | {"lines": lines, "flown": at} | facts
    )


GUIDE_MS, ROLL_OUT_MS = 20, 3000
"""The time between two updates of what is held, and the time at the end of a turn to roll out."""
LEVEL = ("idle", "climb", "speed")
"""Legs in which the mean aileron that keeps the wings level is learnt; MANUAL keeps it there."""
LOW_WIND = "atmosphere/turbulence/milspec/windspeed_at_20ft_AGL-fps"
LOW_WIND_FPS = 8.0
"""Wind at 20 ft for each step of severity: below 2000 ft, the turbulence depends on it."""
THROTTLE_GAIN, THROTTLE_RATE, CLIMB_THROTTLE = 0.02, 0.002, 4.0
"""Throttle per kt, per kt and s, and per rad of the wanted angle of climb."""
SPEED_STEP_KT, BANK_STEP = 1.5 * GUIDE_MS / 1000, math.radians(15.0) * GUIDE_MS / 1000
FLARE_FT, ON_WHEELS_FT = 25.0, 5.0
LOOPS = {"airframe": "dutch_roll_open_loop", "with_roll_loop": "dutch_roll"}
"""The loops that a manoeuvre is flown in, and their Dutch rolls' names in other truths."""
WINDOW_S = (1.0, 4.0)
"""Time in s before the first movement and after the last one that belongs to a manoeuvre."""


class LegFlight(Flight):
    """A flight of legs in progress; turbulence, gusts and noise depend on the link's seed.

    The gains of the elevator are given for the airspeed at the start, and vary as 1/V^2.

    ``starts_ms`` are the beginnings of the legs and the end of the last one in ms.
    """

    def __init__(self, plan: FlightPlan, link: Link) -> None:
        self.rudder_moves = moves(plan)
        super().__init__(plan, Hands(np.append(self.rudder_moves, 0.0)), link)
        fdm = self._fdm
        lengths = [round(leg.seconds / STEP_S) for leg in plan.legs]
        self.starts_ms = np.concatenate([[0], np.cumsum(lengths)]).tolist()
        self._number, self._speeds = -1, plan.speeds_kt()
        self._speed, self._height = plan.speed_kt, plan.altitude_ft
        self._throttle = fdm["fcs/throttle-cmd-norm"]
        self._lift = self._nose = self._bank_held = self._feet = 0.0
        self._slow_aileron = self._aileron_trim
        self._runway: float | None = None
        self._drawn = np.random.default_rng([link.seed, 41])
        fdm["propulsion/fuel_freeze"] = 1.0  # the mass stays that of the truth
        stir(fdm, link.seed, plan.legs[0].severity)
        self._enter(0)

    @property
    def custom_mode(self) -> int:
        """ArduPlane's present mode as a number, which HEARTBEAT reports."""
        return MODES[self._leg.mode]

    def _enter(self, number: int) -> None:
        self._number, self._leg = number, self.plan.legs[number]
        self._fdm[SEVERITY] = self._leg.severity
        self._fdm[LOW_WIND] = LOW_WIND_FPS * self._leg.severity
        if self._leg.kind == "landing":
            self._fdm["gear/gear-cmd-norm"] = 1.0
        side, size, share = self._drawn.uniform(size=3)
        room_s = max(self._leg.seconds - self._leg.gust_s, 0.0)
        self._gust_ms = self.starts_ms[number] + 1000.0 * min(1.0 + share * 5.0, room_s)
        self._gust_fps = (
            self._leg.gust_m_s * (0.7 + 0.6 * size) / FOOT * math.copysign(1, side - 0.5)
        )

    def _step(self) -> None:
        ms = self.ms
        if ms > self.starts_ms[self._number + 1] and self._number + 1 < len(self.plan.legs):
            self._enter(self._number + 1)
        if ms % GUIDE_MS == 0:
            self._guide()
        if self._leg.gust_m_s:
            self._blow()
        super()._step()

    def _commands(self) -> tuple[float, float, float]:
        rudder, aileron = self._rudder[self.ms] + self._feet, self._slow_aileron
        if self._leg.mode != "MANUAL":
            roll = self.sensed(0) - self._roll_trim - self._bank_held
            aileron = self._aileron_trim - self._roll_hold(roll)
            if self._leg.kind in LEVEL and abs(roll) < 0.03:
                self._slow_aileron += STEP_S / 3.0 * (aileron - self._slow_aileron)
        nose = self.sensed(1) - self._pitch - self._nose
        stiffness = min((self.plan.speed_kt / max(self["velocities/vc-kts"], 1.0)) ** 2, 4.0)
        held = stiffness * (PITCH_GAIN * nose + PITCH_RATE_GAIN * self.sensed(4))
        return rudder, aileron, self._elevator + held

    def _guide(self) -> None:
        """Update the wanted nose attitude, throttle and bank, fifty times a second."""
        leg = self._leg
        turns = leg.kind == "turn" and self.starts_ms[self._number + 1] - self.ms >= ROLL_OUT_MS
        bank = math.radians(leg.bank_deg) if turns else 0.0
        self._bank_held += within(bank - self._bank_held, BANK_STEP)
        fdm, dt = self._fdm, GUIDE_MS / 1000
        if leg.kind == "manoeuvre":
            self._nose += (self._lift - self._nose) * dt
            return
        if leg.kind == "landing" and fdm["position/h-agl-ft"] < FLARE_FT:
            self._flare(dt)
            return
        self._speed += within(self._speeds[self._number] - self._speed, SPEED_STEP_KT)
        climb = leg.climb_ft_min / 60.0
        if (leg.to_ft - self._height) * climb < 0.0:
            climb = 0.0
        self._height += climb * dt
        wanted = within(climb + 0.15 * (self._height - fdm["position/h-sl-ft"]), 15.0)
        slow = self._speed - fdm["velocities/vc-kts"]
        self._throttle = min(max(self._throttle + THROTTLE_RATE * slow * dt, 0.0), 1.0)
        steep = CLIMB_THROTTLE * wanted / max(fdm["velocities/vt-fps"], 50.0)
        throttle = self._throttle + THROTTLE_GAIN * slow + steep
        fdm["fcs/throttle-cmd-norm"] = min(max(throttle, 0.0), 1.0)
        # If the throttle does not suffice, the nose goes down to keep the speed.
        self._climb(wanted - 3.0 * max(slow - 4.0, 0.0), dt)

    def _climb(self, wanted_fps: float, dt: float) -> None:
        fdm = self._fdm
        share = (wanted_fps - fdm["velocities/h-dot-fps"]) / max(fdm["velocities/vt-fps"], 50.0)
        self._lift = within(self._lift + 0.4 * share * dt, 0.3)
        self._nose = within(self._lift + 0.8 * share, 0.3)

    def _flare(self, dt: float) -> None:
        """Close the throttle and slow the descent; on the wheels, steer straight and brake."""
        fdm = self._fdm
        over_ft = fdm["position/h-agl-ft"] - ON_WHEELS_FT
        self._throttle = max(self._throttle - 0.3 * dt, 0.0)
        fdm["fcs/throttle-cmd-norm"] = self._throttle
        if self._runway is None and fdm["gear/unit[1]/WOW"] + fdm["gear/unit[2]/WOW"] == 0.0:
            self._climb(-1.5 - max(over_ft, 0.0) / 4.0, dt)
            return
        heading = self.sensed(2)
        if self._runway is None:
            self._runway = heading + math.radians(self._drawn.uniform(-6.0, 6.0))
        self._nose += within(-self._nose, 0.03 * dt)
        off = math.remainder(heading - self._runway, math.tau)
        self._feet += within(within(-2.0 * off, 0.4) - self._feet, 1.0 * dt)
        fdm["fcs/left-brake-cmd-norm"] = fdm["fcs/right-brake-cmd-norm"] = 0.3

    def _blow(self) -> None:
        """Set the side gust, a (1 - cos) across the heading."""
        fdm, share = self._fdm, (self.ms - self._gust_ms) / (1000.0 * self._leg.gust_s)
        size = self._gust_fps * 0.5 * (1.0 - math.cos(math.tau * min(max(share, 0.0), 1.0)))
        heading = fdm["attitude/psi-rad"]
        fdm["atmosphere/gust-north-fps"] = -size * math.sin(heading)
        fdm["atmosphere/gust-east-fps"] = size * math.cos(heading)


def within(value: float, most: float) -> float:
    """Return a value, limited to ``most`` on both sides."""
    return min(max(value, -most), most)


def moves(plan: FlightPlan) -> Floats:
    """Return the moves of the rudder in the whole flight (n,) in units.

    The unit of time is 0.3 periods of the Dutch roll, scaled to the leg's airspeed. JSBSim's
    linearisation takes seconds, so a plan without a manoeuvre is flown without it.

    Raises:
        ValueError: there is a manoeuvre, and the aircraft has no oscillatory Dutch roll.
    """
    first_s = 1.0
    if any(leg.kind == "manoeuvre" for leg in plan.legs):
        mode = linear_dutch_rolls(plan)["dutch_roll"]
        if mode is None:
            raise ValueError(f"{plan.aircraft} shows no oscillatory Dutch roll here")
        first_s = 0.3 * math.tau / mode["wn_rad_s"]
    steps = [first_s * plan.speed_kt / speed for speed in plan.speeds_kt()]
    return np.concatenate(list(map(rudder_moves, plan.legs, steps)))


def leg_truth(plan: FlightPlan, link: Link, flight: LegFlight) -> dict[str, Any]:
    """Return what identification should find in a finished flight, manoeuvre by manoeuvre.

    Times are in s since boot; ``from_s`` and ``to_s`` are the first and the last movement of the
    rudder. Means are from 1 s before that to 4 s after it. The Dutch roll is linearised at these
    means for the loop flown (``dutch_roll``), bare (``airframe``) and with the roll hold
    (``with_roll_loop``), each with its sigmas. ``dutch_roll_at_trim`` is linearised at the airspeed
    at the beginning.
    """
    flown = np.array(flight.flown)
    found: list[dict[str, Any]] = []
    for leg, (start, stop) in zip(plan.legs, pairwise(flight.starts_ms), strict=True):
        moved = start + np.flatnonzero(flight.rudder_moves[start:stop])
        if leg.kind == "manoeuvre" and len(moved):
            ends_ms = int(moved[0]), int(moved[-1]) + 1
            from_s, to_s = (round(ms / 1e3 + link.boot_s, 3) for ms in ends_ms)
            known = {"n": len(found) + 1, "kind": leg.shape, "from_s": from_s, "to_s": to_s}
            found.append(known | _manoeuvre(plan, leg, flown, ends_ms))
    return {
        "aircraft": plan.aircraft,
        "jsbsim": jsbsim.__version__,
        "seed": link.seed,
        "roll_hold": {"aileron_per_rad": plan.roll_gain, "aileron_per_rad_s": plan.roll_rate_gain},
        "manoeuvres": found,
    }


def _manoeuvre(
    plan: FlightPlan, leg: Leg, flown: Floats, ends_ms: tuple[int, int]
) -> dict[str, Any]:
    first, last = (ends_ms[0] - 1e3 * WINDOW_S[0], ends_ms[1] + 1e3 * WINDOW_S[1])
    at_ms = flown[:, 0] / STEP_S
    inside = flown[(at_ms >= first) & (at_ms <= last)]
    _, knots, feet, equivalent_kt = inside.mean(axis=0).tolist()
    trim = replace(plan, legs=(), altitude_ft=feet)
    modes = flown_dutch_rolls(trim, inside)
    before = linear_dutch_rolls(replace(trim, speed_kt=float(inside[0, 1])))
    loop = "airframe" if leg.mode == "MANUAL" else "with_roll_loop"
    return {
        "mode": leg.mode,
        "loop": loop,
        "amplitude": leg.amplitude,
        "airspeed_m_s": round(equivalent_kt * KNOT, 3),
        "airspeed_from_to_m_s": [
            round(float(end(inside[:, 3])) * KNOT, 3) for end in (np.min, np.max)
        ],
        "calibrated_kt": round(knots, 3),
        "calibrated_kt_at_trim": round(float(inside[0, 1]), 3),
        "altitude_m": round(feet * FOOT, 1),
        "dutch_roll": modes[LOOPS[loop]],
        "dutch_roll_at_trim": before[LOOPS[loop]],
        **{each: modes[name] for each, name in LOOPS.items()},
    }
