"""The words of an answer, one form for all: presenters only lay out what is said here.

A number with its sigma, the line of a Dutch roll, the verdict in a word, how a manoeuvre or a
flight was flown, and the rows that tell a flight's answer.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Final, NamedTuple

from yawid.answers.run_summary import (
    DutchRoll,
    Flight,
    Manoeuvre,
    RunSummary,
    Value,
    VehicleSeen,
)
from yawid.estimation.fit import WORST_PCT
from yawid.quantities.airspeed import GROUND_SPEED

LATIN: Final = ("wn", "zeta")
GREEK: Final = ("ωn", "ζ")
"""The names of the two numbers of a Dutch roll: in a terminal, and where there are all signs."""
NONE: Final = "–"
"""Stands for a number that there is not."""
LARGEST_IN_FULL: Final = 1e6
"""A larger number, of an estimate that diverged, is not written digit by digit."""
MOST_DIGITS: Final = 6
"""After the point: a smaller number is written with its power of ten."""
NOT_USED: Final = "usable, not used"
_AS_GIVEN: Final = ("calibrated", "indicated")
"""Kinds of airspeed that are taken for the equivalent one."""


class Loop(NamedTuple):
    """Whose numbers they are: in a word for a column, by name, and in a sentence."""

    short: str
    name: str
    whose: str


_LOOPS: Final = {
    "airframe": Loop("bare", "airframe", "the airframe"),
    "with_roll_loop": Loop("roll", "with roll loop", "the aircraft with its roll loop"),
}
_NO_LOOP: Final = Loop("?", "not known", "the aircraft as flown (the flight mode is not known)")


class Row(NamedTuple):
    """One row of an answer: its name, its text, and rich's style of it."""

    name: str
    text: str
    style: str = ""


def percent(value: float, spec: str = ".1f") -> str:
    """Return a fit in percent; of a model that explodes only that it does."""
    return format(value, spec) if value > WORST_PCT else f"< {WORST_PCT:.0f}"


def with_sigma(value: float, sigma: float | None) -> tuple[str, str]:
    """Return a value and one sigma, rounded to where that has two digits; empty if unknown."""
    if sigma is None or not sigma > 0.0:
        return f"{value:.4g}", ""
    if max(abs(value), sigma) >= LARGEST_IN_FULL:
        return f"{value:.4g}", f"± {sigma:.2g}"
    digits = max(1 - math.floor(math.log10(sigma)), 0)
    if digits > MOST_DIGITS:
        return f"{value:.4g}", f"± {sigma:.2g}"
    return f"{value:.{digits}f}", f"± {sigma:.{digits}f}"


def plus_minus(value: float | None, sigma: float | None, noise: float | None = None) -> str:
    """Return a value with one sigma, and in brackets that of noise alone, where these are known."""
    if value is None:
        return NONE
    return " ".join(filter(None, (*with_sigma(value, sigma), in_brackets(noise))))


def in_brackets(noise: float | None) -> str:
    """Return the part of a sigma that noise explains, empty where it is not known."""
    return "" if noise is None else f"({noise:.2g})"


def of_value(found: Value) -> str:
    """Return a coefficient with its sigma and that of noise."""
    return plus_minus(found.value, found.std, found.std_noise)


def numbers(mode: DutchRoll | None) -> tuple[str, str]:
    """Return wn in rad/s and zeta, each with one sigma; ``none`` without a Dutch roll."""
    if mode is None:
        return "none", "none"
    return plus_minus(mode.wn_rad_s, mode.wn_std), plus_minus(mode.zeta, mode.zeta_std)


def dutch_roll(mode: DutchRoll, names: tuple[str, str] = LATIN) -> str:
    """Return the line of a Dutch roll: wn and zeta, each with one sigma."""
    wn, zeta = numbers(mode)
    return f"{names[0]} {wn} rad/s, {names[1]} {zeta}"


def noise_spreads(mode: DutchRoll | None) -> tuple[str, str] | None:
    """Return the sigmas of wn and zeta that noise alone explains; None where not known."""
    if mode is None or mode.wn_std_noise is None or mode.zeta_std_noise is None:
        return None
    return f"± {mode.wn_std_noise:.2g}", f"± {mode.zeta_std_noise:.2g}"


def of_noise(mode: DutchRoll | None, names: tuple[str, str] = LATIN) -> str:
    """Return how much of the sigmas is of noise, empty where not known."""
    noise = noise_spreads(mode)
    return f"of it noise: {names[0]} {noise[0]}, {names[1]} {noise[1]}" if noise else ""


def sigma_means(modes: Iterable[DutchRoll | None]) -> str:
    """Say what the sigmas of these are of, to stand after ``one sigma``; empty without any."""
    told = [mode for mode in modes if mode is not None and mode.wn_std is not None]
    if any(noise_spreads(mode) for mode in told):
        return ": noise, scatter over the record, structure"
    return " of noise alone" if told else ""


def duration(seconds: float) -> str:
    """Return how long something lasts, roughly."""
    if seconds < 120.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 7200.0 else f"{seconds / 3600.0:.1f} h"


def loop_of(loop: str | None) -> Loop:
    """Return whose numbers they are, by ``loop`` of a manoeuvre or a flight."""
    return _LOOPS.get(loop or "", _NO_LOOP)


def count(manoeuvres: int) -> str:
    """Return how many manoeuvres it is."""
    return "one manoeuvre" if manoeuvres == 1 else f"{manoeuvres} manoeuvres"


def counted(flight: Flight, manoeuvres: Sequence[Manoeuvre]) -> str:
    """Return how many of the manoeuvres the flight's answer rests on."""
    total = len(manoeuvres)
    return f"from {len(flight.used) or 'none'} of {total} manoeuvre{'s' if total > 1 else ''}"


def flown(found: Manoeuvre) -> str:
    """Return when and how a manoeuvre was flown."""
    said = [f"{found.from_s:.0f} to {found.to_s:.0f} s", found.mode or "in no known mode"]
    if found.airspeed_m_s is not None:
        over_ground = " over ground" if found.airspeed_source == GROUND_SPEED else ""
        said.append(f"{found.airspeed_m_s:.1f} m/s{over_ground}")
    return ", ".join(said)


def says(found: Manoeuvre) -> str:
    """Return what a manoeuvre says: its Dutch roll, or the first reason why it cannot be used."""
    if found.verdict.why is not None or found.dutch_roll is None:
        return f"not usable: {found.verdict.why}"
    return dutch_roll(found.dutch_roll)


def outcome(manoeuvre: Manoeuvre, flight: Flight | None) -> str:
    """Say in a word or two what came of a manoeuvre: the first fatal reason's id where refused."""
    if not manoeuvre.verdict.usable:
        return manoeuvre.verdict.why or "not usable"
    if flight is not None and manoeuvre.n in flight.disagree:
        return "disagrees"
    if flight is not None and manoeuvre.n in flight.used:
        return "used"
    # A flight is told of one aircraft: with its roll loop or without.
    return "other loop" if flight is not None and manoeuvre.loop != flight.loop else NOT_USED


def conditions(flight: Flight) -> str:
    """Return the airspeed and altitude that the flight's answer is told at, empty if unknown."""
    speed, altitude = flight.airspeed_m_s, flight.altitude_m
    source = "" if flight.airspeed_source is None else f" ({flight.airspeed_source})"
    known = [] if speed is None else [f"{speed:.1f} m/s{source}"]
    known += [] if altitude is None else [f"{altitude:.0f} m altitude"]
    return f"at {' and '.join(known)}" if known else ""


def kappa(flight: Flight) -> str:
    """Return wn as it goes with the airspeed V, and its sigma; empty where not known."""
    if flight.kappa_rad_m is None or flight.kappa_rad_m.value is None:
        return ""
    return f"{plus_minus(flight.kappa_rad_m.value, flight.kappa_rad_m.std)} · V"


def utc(date: str | None) -> str:
    """Return an ISO 8601 time in UTC as people read it, to the second."""
    if date is None:
        return "date unknown"
    return f"{date[:19].replace('T', ' ')} UTC"


def no_manoeuvre(summary: RunSummary) -> str:
    """Say that manoeuvres were looked for in vain, and why that may be."""
    if summary.estimates is None:
        return "no manoeuvre found: rudder and yaw rate were never there together"
    return (
        "no manoeuvre found: the rudder never moved on its own for long enough, in the air and at "
        "a steady airspeed"
    )


def flight_rows(summary: RunSummary) -> Iterator[Row]:
    """Yield each row that tells the flight's answer."""
    flight = summary.flight
    if flight is None:
        if summary.manoeuvres is not None:
            yield Row("flight", no_manoeuvre(summary))
        return
    manoeuvres = summary.manoeuvres or []
    mode, count = flight.dutch_roll, counted(flight, manoeuvres)
    if mode is None:
        yield Row("flight", f"no answer, {count}")
    else:
        yield Row("flight", dutch_roll(mode))
        if noise := of_noise(mode):
            yield Row("", noise, "dim")
        yield Row("", ", ".join(filter(None, (conditions(flight), count))))
        yield Row("", f"this is {loop_of(flight.loop).whose}")
    if slope := kappa(flight):
        kind = flight.airspeed_kind if flight.airspeed_kind in _AS_GIVEN else "equivalent"
        yield Row("", f"wn = {slope}, V the {kind} airspeed")
    yield Row("flown", ", ".join(_flown(flight, manoeuvres, summary.vehicle)))


def _flown(
    flight: Flight, manoeuvres: Sequence[Manoeuvre], vehicle: VehicleSeen | None
) -> Iterator[str]:
    dates = [date for date in (flight.date, *(each.date for each in manoeuvres)) if date]
    if dates:
        yield utc(dates[0])
    told = [each for each in manoeuvres if each.n in flight.used] or manoeuvres
    modes = dict.fromkeys(each.mode for each in told if each.mode is not None)
    if modes:
        yield f"in {' and '.join(modes)}"
    if vehicle is not None:
        yield f"vehicle {vehicle.sysid}/{vehicle.compid}, {vehicle.kind}"
    if flight.method is not None and flight.orders is not None:
        yield f"answered by {flight.method.upper()}, orders {flight.orders}"
