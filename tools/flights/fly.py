"""Fly a plan: the log that its telemetry link would deliver, and what is true of the aircraft."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from flights.flight import Flight, Hands
from flights.guided import LegFlight, leg_truth
from flights.legs import LegPlan
from flights.plan import FlightPlan, excitation
from flights.surgery import join
from flights.telemetry import FOOT, KNOT, Link, telemetry
from flights.truth import after_lead_in, modes_at, truth_lines


@dataclass(frozen=True, slots=True)
class Made:
    """A log, and the truth where there is one."""

    log: bytes
    truth: dict[str, Any] | None = None


def flight_of(
    plan: FlightPlan | LegPlan, link: Link, hands: Hands | None = None, severity: int = 0
) -> Flight:
    """Return the flight of a plan before its first millisecond.

    ``hands`` and ``severity`` are those of a plan without legs; without hands the rudder alone is
    moved, as the plan says, and the elevator stays.

    Raises:
        FlightError: the aircraft cannot be loaded or trimmed, or trim and moves pass the stops.
    """
    if isinstance(plan, LegPlan):
        return LegFlight(plan, link)
    return Flight(plan, hands or Hands(excitation(plan), nose_held=False), link, severity)


def fly(
    plan: FlightPlan | LegPlan,
    link: Link,
    hands: Hands | None = None,
    severity: int = 0,
    **told: Any,
) -> Made:
    """Fly; return the log and its truth, and what is ``told`` of the flight besides.

    The truth of legs is that of :func:`leg_truth`. Of other plans it is the Dutch roll at the
    airspeeds and the altitude flown (``dutch_roll``, closed with the roll hold and with nothing
    that ``hands`` feed back; ``dutch_roll_open_loop``, of the airframe alone: what a model finds
    that has the aileron as an input), and what it is at any airspeed: ``lines``, see
    :func:`truth_lines`, and ``flown``, boot seconds and kt.

    Raises:
        FlightError: the aircraft cannot be trimmed or flown as asked.
    """
    flight = flight_of(plan, link, hands, severity)
    log = join(telemetry(link, flight))
    if isinstance(flight, LegFlight) and isinstance(plan, LegPlan):
        return Made(log, leg_truth(plan, link, flight) | told)
    assert isinstance(plan, FlightPlan)
    flown = after_lead_in(flight.flown)
    lines = truth_lines(plan, flown)
    speed_kt, altitude_ft = flown[:, 1:3].mean(axis=0).tolist()
    conditions = {
        "aircraft": plan.aircraft, "severity": severity, "seed": link.seed,
        "airspeed_m_s": round(speed_kt * KNOT, 3), "altitude_m": round(altitude_ft * FOOT, 1),
        "speed_kt": plan.speed_kt, "seconds": plan.seconds, "manoeuvre": plan.manoeuvre,
        "amplitude": plan.amplitude, "attitude_hz": link.attitude_hz, "servo_hz": link.servo_hz,
        "rate_noise": link.rate_noise,
    }  # fmt: skip
    at = [[round(s + link.boot_s, 2), round(kt, 3)] for s, kt, _, _ in flight.flown]
    return Made(
        log, conditions | modes_at(lines, flown[:, 1]) | {"lines": lines, "flown": at} | told
    )
