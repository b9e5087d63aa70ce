"""Flies a plan: returns the log that its telemetry link would deliver, and its truth."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import jsbsim

from flights.flight import Flight, Hands
from flights.plan import FOOT, KNOT, FlightPlan, Link
from flights.surgery import join
from flights.telemetry import telemetry
from flights.truth import after_lead_in, modes_at, truth_lines


@dataclass(frozen=True, slots=True)
class Made:
    """A log, and its truth if there is one."""

    log: bytes
    truth: dict[str, Any] | None = None


def written(made: Made) -> str:
    """Return the truth of a flight as JSON, without that at other airspeeds than its mean."""
    shown = {name: x for name, x in (made.truth or {}).items() if name not in ("lines", "flown")}
    return json.dumps(shown, indent=1) + "\n"


def fly(
    plan: FlightPlan,
    link: Link,
    hands: Hands | None = None,
    severity: int = 0,
    **facts: Any,
) -> Made:
    """Fly a plan; return the log and its truth, which also has the items of ``facts``.

    The truth has the Dutch roll at the airspeeds and the altitude flown: ``dutch_roll`` with the
    roll hold, but without any feedback by ``hands``, and ``dutch_roll_open_loop`` of the airframe
    alone, which a model with the aileron as an input should find. For other airspeeds it has
    ``lines`` (see :func:`truth_lines`) and ``flown``, the airspeeds as pairs of s since boot and
    kt.

    Raises:
        FlightError: the aircraft cannot be trimmed or flown as asked.
    """
    flight = Flight(plan, hands, link, severity)
    log = join(telemetry(link, flight))
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
    at = [[round(s + link.boot_s, 2), round(kt, 3)] for s, kt, _ in flight.flown]
    return Made(
        log, conditions | modes_at(lines, flown[:, 1]) | {"lines": lines, "flown": at} | facts
    )
