"""The words of an answer, the same in all outputs, which only lay them out.

A number with its sigma, the line of a Dutch roll, the result of a manoeuvre in a word, how a
manoeuvre or a flight was flown, and the rows of a flight's answer.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Final, NamedTuple

from yawid.answers.heard import VehicleSeen
from yawid.answers.ordinary import ORDINARY, OrdinaryAnswer
from yawid.answers.reasons import Verdict
from yawid.answers.run_summary import (
    CT,
    Bare,
    DutchRoll,
    Flight,
    Manoeuvre,
    RunSummary,
    Value,
)
from yawid.estimation.fit import WORST_PCT
from yawid.quantities.airspeed import GROUND_SPEED
from yawid.quantities.vehicles import AIRFRAME, WITH_ROLL_LOOP

LATIN: Final = ("wn", "zeta")
GREEK: Final = ("ωn", "ζ")
"""The names of a Dutch roll's two numbers: for a terminal, and where Greek letters are shown."""
NONE: Final = "–"
"""The sign for a number that is missing."""
LARGEST_IN_FULL: Final = 1e6
"""A number as large as this comes from an estimate that diverged; it has few digits."""
MOST_DIGITS: Final = 6
"""The most digits after the decimal point; a number that needs more has four significant ones."""
NEXT: Final = "next:"
"""Begins the last line of a verdict that is not usable: what to do about the first fatal reason."""
NOT_USED: Final = "usable, not used"
_AS_GIVEN: Final = ("calibrated", "indicated")
"""Kinds of airspeed that are used as if they were the equivalent airspeed."""


OF_ORDINARY: Final = "from ordinary flight: the aircraft without its autopilot, mode only"


class Loop(NamedTuple):
    """What the numbers describe: a word for a column, a name, and a phrase for a sentence."""

    short: str
    name: str
    whose: str


_LOOPS: Final = {
    AIRFRAME: Loop("bare", "airframe", "the airframe"),
    WITH_ROLL_LOOP: Loop("roll", "with roll loop", "the aircraft with its roll loop"),
}
_NO_LOOP: Final = Loop("?", "not known", "the aircraft as flown (the flight mode is not known)")


class Row(NamedTuple):
    """One row of an answer: its name, its text, and its style in rich."""

    name: str
    text: str
    style: str = ""


def next_step(verdict: Verdict) -> str | None:
    """Return what to do next and where the manual explains why; None when usable."""
    return verdict.next and f"{verdict.next} (yawid explain {verdict.why})"


def percent(value: float, spec: str = ".1f") -> str:
    """Return a fit in percent; of a diverging model only that it is below the worst shown."""
    return format(value, spec) if value > WORST_PCT else f"< {WORST_PCT:.0f}"


def with_sigma(value: float, sigma: float | None) -> tuple[str, str]:
    """Return a value and its sigma, both rounded to two digits of sigma, which is "" if unknown."""
    if sigma is None or not sigma > 0.0:
        return f"{value:.4g}", ""
    if max(abs(value), sigma) >= LARGEST_IN_FULL:
        return f"{value:.4g}", f"± {sigma:.2g}"
    digits = max(1 - math.floor(math.log10(sigma)), 0)
    if digits > MOST_DIGITS:
        return f"{value:.4g}", f"± {sigma:.2g}"
    return f"{value:.{digits}f}", f"± {sigma:.{digits}f}"


def plus_minus(value: float | None, sigma: float | None, noise: float | None = None) -> str:
    """Return a value with its sigma, and in brackets the sigma of noise alone, where known."""
    if value is None:
        return NONE
    return " ".join(filter(None, (*with_sigma(value, sigma), in_brackets(noise))))


def in_brackets(noise: float | None) -> str:
    """Return the sigma of noise alone in brackets, "" where it is unknown."""
    return "" if noise is None else f"({noise:.2g})"


def of_value(found: Value) -> str:
    """Return a coefficient with its sigma, and in brackets that of noise alone."""
    return plus_minus(found.value, found.std, found.std_noise)


def numbers(mode: DutchRoll | None) -> tuple[str, str]:
    """Return wn in rad/s and zeta, each with its sigma; ``none`` without a Dutch roll."""
    if mode is None:
        return "none", "none"
    return plus_minus(mode.wn_rad_s, mode.wn_std), plus_minus(mode.zeta, mode.zeta_std)


def dutch_roll(mode: DutchRoll, names: tuple[str, str] = LATIN) -> str:
    """Return the line of a Dutch roll: wn and zeta, each with its sigma."""
    wn, zeta = numbers(mode)
    return f"{names[0]} {wn} rad/s, {names[1]} {zeta}"


def of_noise(mode: DutchRoll) -> str:
    """Return the sigmas of noise alone as a phrase, "" where they are unknown."""
    if mode.wn_std_noise is None or mode.zeta_std_noise is None:
        return ""
    return f"noise alone: wn ± {mode.wn_std_noise:.2g}, zeta ± {mode.zeta_std_noise:.2g}"


def sigma_means(modes: Iterable[DutchRoll | None]) -> str:
    """Return what the sigmas contain, as a phrase that follows ``one sigma``; "" without any.

    Those of the stream are of noise alone: there both are equal.
    """
    known = [mode for mode in modes if mode is not None and mode.wn_std is not None]
    if any(mode.wn_std_noise not in (None, mode.wn_std) for mode in known):
        return ": noise, structure, scatter of manoeuvres"
    return " of noise alone" if known else ""


def duration(seconds: float) -> str:
    """Return a duration rounded to s, min or h."""
    if seconds < 120.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 7200.0 else f"{seconds / 3600.0:.1f} h"


def loop_of(loop: str | None) -> Loop:
    """Return what the numbers describe, from the ``loop`` of a manoeuvre or a flight."""
    return _LOOPS.get(loop or "", _NO_LOOP)


def whose(found: Manoeuvre | Flight) -> str:
    """Return what an answer is of, in a phrase for a sentence."""
    return ", ".join(filter(None, (loop_of(found.loop).whose, found.yaw_loop)))


def count(manoeuvres: int) -> str:
    """Return a number of manoeuvres in words."""
    return "one manoeuvre" if manoeuvres == 1 else f"{manoeuvres} manoeuvres"


def method_words(method: str) -> str:
    """Return a method in words."""
    return "a continuous-time fit" if method == CT else method.upper()


def counted(flight: Flight, manoeuvres: Sequence[Manoeuvre]) -> str:
    """Return from how many of the manoeuvres the flight's answer is made."""
    total = len(manoeuvres)
    return f"from {len(flight.used) or 'none'} of {total} manoeuvre{'s' if total > 1 else ''}"


def flown(found: Manoeuvre) -> str:
    """Return when and how a manoeuvre was flown."""
    said = [f"{found.from_s:.0f} to {found.to_s:.0f} s", found.mode or "in an unknown mode"]
    if found.airspeed_m_s is not None:
        over_ground = " over ground" if found.airspeed_source == GROUND_SPEED else ""
        said.append(f"{found.airspeed_m_s:.1f} m/s{over_ground}")
    return ", ".join(said)


def says(found: Manoeuvre) -> str:
    """Return a manoeuvre's answer: its Dutch roll, or the first reason why it is not usable."""
    mode = found.dutch_roll
    if found.verdict.why is not None or mode is None:
        return f"not usable: {found.verdict.why}"
    return dutch_roll(mode)


def outcome(manoeuvre: Manoeuvre, flights: Sequence[Flight]) -> str:
    """Return a manoeuvre's result in a word or two; if refused, the first fatal reason's id."""
    if not manoeuvre.verdict.usable:
        return manoeuvre.verdict.why or "not usable"
    if any(manoeuvre.n in flight.disagree for flight in flights):
        return "disagrees"
    return "used" if any(manoeuvre.n in flight.used for flight in flights) else NOT_USED


def conditions(flight: Flight) -> str:
    """Return the airspeed and altitude for which the flight's answer holds, "" if unknown."""
    speed, altitude = flight.airspeed_m_s, flight.altitude_m
    source = "" if flight.airspeed_source is None else f" ({flight.airspeed_source})"
    known = [] if speed is None else [f"{speed:.1f} m/s{source}"]
    known += [] if altitude is None else [f"{altitude:.0f} m altitude"]
    return f"at {' and '.join(known)}" if known else ""


def kappa(flight: Flight) -> str:
    """Return wn as a multiple of the airspeed V, with the factor's sigma; "" where unknown."""
    if flight.kappa_rad_m is None or flight.kappa_rad_m.value is None:
        return ""
    return f"{plus_minus(flight.kappa_rad_m.value, flight.kappa_rad_m.std)} · V"


def utc(date: str | None) -> str:
    """Return an ISO 8601 time in UTC in a form for people, to the second."""
    if date is None:
        return "date unknown"
    return f"{date[:19].replace('T', ' ')} UTC"


def no_manoeuvre(summary: RunSummary) -> str:
    """Return a text that no manoeuvre was found, with the likely cause."""
    if summary.estimates is None:
        return "no manoeuvre was found: no stretch has both rudder and yaw rate"
    return (
        "no manoeuvre was found: the rudder never moved by itself for long enough, in the air and "
        "at a steady airspeed"
    )


def flight_rows(
    flights: Sequence[Flight], manoeuvres: Sequence[Manoeuvre], vehicle: VehicleSeen | None
) -> Iterator[Row]:
    """Yield the rows of a flight's answers, one for each loop, the headline first."""
    flight, *others = flights
    mode, count = flight.dutch_roll, counted(flight, manoeuvres)
    if mode is None:
        yield Row("flight", f"no answer, {count}")
    else:
        yield Row("flight", dutch_roll(mode))
        if noise := of_noise(mode):
            yield Row("", noise, "dim")
        yield Row("", ", ".join(filter(None, (conditions(flight), count))))
        yield Row("", f"this is {whose(flight)}")
    if slope := kappa(flight):
        kind = flight.airspeed_kind if flight.airspeed_kind in _AS_GIVEN else "equivalent"
        yield Row("", f"wn = {slope}, where V is the {kind} airspeed")
    for other in others:
        yield Row("also", of_loop(other, manoeuvres))
    yield Row("flown", ", ".join(_flown(flight, manoeuvres, vehicle)))


def bare_rows(summary: RunSummary, names: tuple[str, str] = LATIN) -> Iterator[Row]:
    """Yield the rows of the bare airframe, nothing where it was not looked for."""
    bare = summary.bare
    if bare is None:
        return
    if bare.dutch_roll is None:
        yield from _unknown("bare", "the bare airframe is not known", bare.verdict)
        return
    level = "" if bare.dutch_roll.level is None else f", level {bare.dutch_roll.level}"
    yield Row("bare", f"{dutch_roll(bare.dutch_roll, names)}{level}")
    modes = ("roll mode", bare.roll_mode), ("spiral", bare.spiral)
    said = [f"{n} {plus_minus(m.time_constant_s, m.std)} s" for n, m in modes if m is not None]
    if bare.servo_lag_s is not None:
        said.append(f"servo lag {of_value(bare.servo_lag_s)} s")
    yield Row("", ", ".join(said))
    speed = "" if bare.airspeed_m_s is None else f" at {bare.airspeed_m_s:.1f} m/s (true airspeed)"
    yield Row(
        "", f"this is the airframe without its roll loop{speed}, from {count(len(bare.used))}"
    )
    for text in bare_warnings(bare):
        yield Row("", text)


def _unknown(name: str, text: str, verdict: Verdict) -> Iterator[Row]:
    """Yield why an answer is not known, and what to do next."""
    yield Row(name, f"{text}: {'; '.join(reason.text for reason in verdict.reasons)}")
    if verdict.next is not None:
        yield Row("", f"{NEXT} {verdict.next} (yawid explain {name}_unknown)")


def ordinary_rows(summary: RunSummary, names: tuple[str, str] = LATIN) -> Iterator[Row]:
    """Yield the rows of ordinary flight, nothing where it was not looked for.

    Next to a usable answer it is no news that there was none.
    """
    found = summary.ordinary
    if found is None or (found.dutch_roll is None and summary.deciding.usable):
        return
    if found.dutch_roll is None:
        text = "from ordinary flight the aircraft's mode is not known"
        yield from _unknown(ORDINARY, text, found.verdict)
        return
    yield Row(ORDINARY, dutch_roll(found.dutch_roll, names))
    turns = f"{found.turns} turn{'s' * (found.turns != 1)}"
    kind = GROUND_SPEED if found.airspeed_source == GROUND_SPEED else "true airspeed"
    where = f"at {found.airspeed_m_s:.1f} m/s ({kind})"
    where += f", from {found.seconds / 60.0:.0f} of {found.seen_s / 60.0:.0f} min, {turns}"
    yield Row("", f"{OF_ORDINARY}; {where}")
    if (roll := found.roll_mode) is not None:
        yield Row("", f"roll mode {plus_minus(roll.time_constant_s, roll.std)} s")
    if (agrees := found.agrees) is not None:
        whose = "bare airframe" if agrees.against == "bare" else "answer"
        apart = f"{agrees.wn_sigmas:.1f} and zeta by {agrees.zeta_sigmas:.1f} sigma"
        yield Row("", f"next to the manoeuvres' {whose}: wn differs by {apart}")
    for text in bare_warnings(found):
        yield Row("", text)


def answer_rows(summary: RunSummary) -> Iterator[Row]:
    """Yield the rows of all answers: of manoeuvres, of the bare airframe, of ordinary flight."""
    if summary.by_loop:
        yield from flight_rows(summary.by_loop, summary.manoeuvres or [], summary.vehicle)
    elif summary.manoeuvres is not None:
        yield Row("flight", no_manoeuvre(summary))
    yield from (*bare_rows(summary), *ordinary_rows(summary))


def bare_warnings(bare: Bare | OrdinaryAnswer) -> Iterator[str]:
    """Yield each warning of a bare airframe that is known, then what to do about them."""
    for reason in bare.verdict.reasons:
        yield f"warning {reason.name}: {reason.text}"
    if bare.verdict.next is not None:
        yield f"{NEXT} {bare.verdict.next}"


def lateral_says(bare: Bare) -> str:
    """Return a manoeuvre's bare airframe in a line, or why it is not known."""
    if bare.dutch_roll is None:
        why = bare.verdict.reasons[0].text if bare.verdict.reasons else "no reason was given"
        return f"the bare airframe is not known: {why}"
    return ", ".join([f"the bare airframe: {dutch_roll(bare.dutch_roll)}", *bare_warnings(bare)])


def of_loop(flight: Flight, manoeuvres: Sequence[Manoeuvre], names: tuple[str, str] = LATIN) -> str:
    """Return the answer for another loop than the headline's in one line."""
    mode = flight.dutch_roll
    said = "no answer" if mode is None else dutch_roll(mode, names)
    why = "" if flight.verdict.usable else f", not usable: {flight.verdict.why}"
    where = ", ".join(filter(None, (conditions(flight), counted(flight, manoeuvres))))
    return f"{said} for {whose(flight)}, {where}{why}"


def _flown(
    flight: Flight, manoeuvres: Sequence[Manoeuvre], vehicle: VehicleSeen | None
) -> Iterator[str]:
    dates = [date for date in (flight.date, *(each.date for each in manoeuvres)) if date]
    if dates:
        yield utc(dates[0])
    used = [each for each in manoeuvres if each.n in flight.used] or manoeuvres
    modes = dict.fromkeys(each.mode for each in used if each.mode is not None)
    if modes:
        yield f"in {' and '.join(modes)}"
    if vehicle is not None:
        yield f"vehicle {vehicle.sysid}/{vehicle.compid}, {vehicle.kind}"
    if flight.method is not None:
        yield f"answered by {method_words(flight.method)}"
