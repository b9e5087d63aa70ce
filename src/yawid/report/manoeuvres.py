"""The report's sections on a flight: its manoeuvres as a table, and the flight's answer."""

from collections.abc import Iterator, Sequence
from typing import Final

from yawid.answers.run_summary import Flight, Manoeuvre, RunSummary, Value
from yawid.report.data import Drawn
from yawid.report.html import Cell, note, sheet, table
from yawid.report.run_tables import NO_YAW_CHANNEL, yaw_channel
from yawid.sinks.words import (
    NONE,
    in_brackets,
    loop_of,
    method_words,
    no_manoeuvre,
    of_value,
    outcome,
    percent,
    plus_minus,
    sigma_means,
    utc,
    whose,
)

MOST_COLUMNS: Final = 2
"""The largest number of manoeuvres in columns: more do not fit next to the names."""


def flight_section(summary: RunSummary, rudder_unit: str) -> Iterator[str]:
    """Yield the section on a run's manoeuvres; nothing where they were not looked for."""
    manoeuvres, flights = summary.manoeuvres, summary.by_loop
    if manoeuvres is None:
        return
    if not manoeuvres:
        yield note("Manoeuvres", f"{no_manoeuvre(summary)}.")
        return
    heading = (
        "n", "ωn, rad/s", "ζ", "from–to, s", "mode", "airspeed, m/s", "altitude, m", "inputs",
        f"K, rad/s per {rudder_unit}", "explained, %", "result",
    )  # fmt: skip  # wn and zeta come second: on a phone the first columns alone are seen
    rows = [(_row(each, flights), not each.verdict.usable) for each in manoeuvres]
    yield sheet("Manoeuvres", heading, rows)
    means = sigma_means(each.dutch_roll for each in manoeuvres)
    in_brackets = "; in brackets of noise alone" if means.startswith(":") else ""
    yield note(
        "",
        f"± is one sigma{means}{in_brackets}. Seconds are those since boot, as on the pictures' "
        "axes. Explained: the part of the yaw rate that the model, run free, has.",
    )
    reasons = {
        f"{each.n}: {reason.name}": reason.text
        for each in manoeuvres
        for reason in each.verdict.reasons
    }
    yield table("reasons of each manoeuvre", reasons, folded=True, printed=True)


def _begun(text: str) -> str:
    """Return a text as the begin of a sentence."""
    return text[:1].upper() + text[1:]


def _row(each: Manoeuvre, flights: Sequence[Flight]) -> Iterator[Cell]:
    answer, mode = each.answer, each.dutch_roll
    yield str(each.n), ""
    if mode is None:
        yield "none", ""
        yield "none", ""
    else:
        yield plus_minus(mode.wn_rad_s, mode.wn_std), in_brackets(mode.wn_std_noise)
        yield plus_minus(mode.zeta, mode.zeta_std), in_brackets(mode.zeta_std_noise)
    yield f"{each.from_s:.1f}–{each.to_s:.1f}", utc(each.date)
    yield each.mode or NONE, loop_of(each.loop).name
    yield _speed(each), each.airspeed_source or ""
    yield NONE if each.altitude_m is None else f"{each.altitude_m:.0f}", ""
    yield ", ".join(each.inputs), "turn removed" if each.turn_removed else ""
    gain = ((answer and answer.physics) or {}).get("K", Value())
    yield plus_minus(gain.value, gain.std), in_brackets(gain.std_noise)
    share = None if answer is None else answer.fit.simulation_pct
    yield NONE if share is None else percent(share, ".0f"), ""
    ids = [reason.name for reason in each.verdict.reasons]
    yield outcome(each, flights).replace("_", " "), ", ".join(ids) if each.verdict.usable else ""


def _speed(each: Manoeuvre) -> str:
    if each.airspeed_m_s is None:
        return NONE
    spread = "" if each.airspeed_std_m_s is None else f" ± {each.airspeed_std_m_s:.2f}"
    return f"{each.airspeed_m_s:.2f}{spread}"


def flight_numbers(summary: RunSummary, drawn: Sequence[Drawn], rudder_unit: str) -> Iterator[str]:
    """Yield the tables of the flight's answers and of their numbers of eq. 22-23.

    Where no answer has these, those of manoeuvres are shown, else why there are none.
    """
    flights = summary.by_loop
    for flight in flights:
        of = f", {whose(flight)}" if len(flights) > 1 else ""
        yield table(f"The flight{of}, ± one σ", dict(_facts(flight, rudder_unit)))
    physics = {_column(each, len(flights)): each.physics for each in flights if each.physics}
    physics = physics or {
        f"manoeuvre {each.found.n}": each.found.answer.physics
        for each in drawn[:MOST_COLUMNS]
        if each.found.answer is not None and each.found.answer.physics
    }
    if physics:
        yield yaw_channel(physics, rudder_unit)
    without = [each for each in flights if not each.physics]
    if without:
        yield note("", f"{_begun('; '.join(map(_no_physics, without)))}.")


def _column(flight: Flight, count: int) -> str:
    """Return the heading of a flight's numbers of eq. 22-23, which are those at its airspeed."""
    of = loop_of(flight.loop).name if count > 1 else "the flight"
    return of if flight.airspeed_m_s is None else f"{of} at {flight.airspeed_m_s:.1f} m/s"


def _no_physics(flight: Flight) -> str:
    """Return why a flight has no numbers of eq. 22-23."""
    if not flight.used:
        return "no manoeuvre is usable, so the flight has no derivatives (eq. 22-23)"
    return f"derivatives of {whose(flight)} are absent: in each manoeuvre used {NO_YAW_CHANNEL}"


def _facts(flight: Flight, rudder_unit: str) -> Iterator[tuple[str, str]]:
    mode, between = flight.dutch_roll, flight.between_std
    if mode is not None:
        yield "ωn, rad/s", plus_minus(mode.wn_rad_s, mode.wn_std, mode.wn_std_noise)
        yield "ζ", plus_minus(mode.zeta, mode.zeta_std, mode.zeta_std_noise)
        yield "of", whose(flight)
    if flight.airspeed_m_s is not None:
        source = flight.airspeed_source or "the ground speed of some"
        yield "at", f"{flight.airspeed_m_s:.1f} m/s ({source}), the median of those used"
    if flight.altitude_m is not None:
        yield "altitude, m", f"{flight.altitude_m:.0f}"
    for name, each in (
        ("κ = ωn / V, rad/m", flight.kappa_rad_m),
        (f"K / V, rad/m per {rudder_unit}", flight.K_per_V),
    ):
        if each is not None:
            yield name, of_value(each)
    if between is not None and between.wn_rad_s is not None:
        yield "scatter of ωn beyond σ, rad/s", f"{between.wn_rad_s:.2g}"
    if between is not None and between.zeta is not None:
        yield "scatter of ζ beyond σ", f"{between.zeta:.2g}"
    if flight.used:
        yield "manoeuvres used", ", ".join(map(str, flight.used))
    if flight.disagree:
        yield "left out, as they disagree", ", ".join(map(str, flight.disagree))
    if flight.method is not None:
        yield "answered by", method_words(flight.method)
    if flight.date is not None:
        yield "date", utc(flight.date)
