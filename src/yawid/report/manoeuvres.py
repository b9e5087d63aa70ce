"""The report's sections on a flight: its manoeuvres as a table, and the flight's answer."""

from collections.abc import Iterator, Sequence
from typing import Final

from yawid.answers.run_summary import BetweenStd, Flight, Manoeuvre, RunSummary, Value
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


def _row(each: Manoeuvre, flights: Sequence[Flight]) -> list[Cell]:
    answer, mode = each.answer, each.dutch_roll
    numbers = [("none", ""), ("none", "")] if mode is None else [
        (plus_minus(mode.wn_rad_s, mode.wn_std), in_brackets(mode.wn_std_noise)),
        (plus_minus(mode.zeta, mode.zeta_std), in_brackets(mode.zeta_std_noise)),
    ]  # fmt: skip
    spread = "" if each.airspeed_std_m_s is None else f" ± {each.airspeed_std_m_s:.2f}"
    speed = NONE if each.airspeed_m_s is None else f"{each.airspeed_m_s:.2f}{spread}"
    gain = ((answer and answer.physics) or {}).get("K", Value())
    share = None if answer is None else answer.fit.simulation_pct
    ids = [reason.name for reason in each.verdict.reasons] if each.verdict.usable else []
    return [
        (str(each.n), ""),
        *numbers,
        (f"{each.from_s:.1f}–{each.to_s:.1f}", utc(each.date)),
        (each.mode or NONE, loop_of(each.loop).name),
        (speed, each.airspeed_source or ""),
        (NONE if each.altitude_m is None else f"{each.altitude_m:.0f}", ""),
        (", ".join(each.inputs), "turn removed" if each.turn_removed else ""),
        (plus_minus(gain.value, gain.std), in_brackets(gain.std_noise)),
        (NONE if share is None else percent(share, ".0f"), ""),
        (outcome(each, flights).replace("_", " "), ", ".join(ids)),
    ]


def flight_numbers(summary: RunSummary, drawn: Sequence[Drawn], rudder_unit: str) -> Iterator[str]:
    """Yield the tables of the flight's answers and of their numbers of eq. 22-23.

    Where no answer has these, those of manoeuvres are shown, else why there are none.
    """
    flights = summary.by_loop
    for flight in flights:
        of = f", {whose(flight)}" if len(flights) > 1 else ""
        yield table(f"The flight{of}, ± one σ", _facts(flight, rudder_unit))
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


def _facts(flight: Flight, rudder_unit: str) -> dict[str, str]:
    """Return what is known of a flight's answer, by its name."""
    mode, between = flight.dutch_roll, flight.between_std or BetweenStd()
    source = flight.airspeed_source or "the ground speed of some"
    numbers = {
        "κ = ωn / V, rad/m": flight.kappa_rad_m,
        f"K / V, rad/m per {rudder_unit}": flight.K_per_V,
        "overshoot after a step of the rudder, %": flight.overshoot_pct,
        "settling time after it, s": flight.settling_s,
    }
    rows = {
        **({} if mode is None else {
            "ωn, rad/s": plus_minus(mode.wn_rad_s, mode.wn_std, mode.wn_std_noise),
            "ζ": plus_minus(mode.zeta, mode.zeta_std, mode.zeta_std_noise),
            "of": whose(flight),
        }),
        "at": None if flight.airspeed_m_s is None
        else f"{flight.airspeed_m_s:.1f} m/s ({source}), the median of those used",
        "altitude, m": None if flight.altitude_m is None else f"{flight.altitude_m:.0f}",
        **{name: of_value(each) for name, each in numbers.items() if each is not None},
        "scatter of ωn beyond σ, rad/s": None if between.wn_rad_s is None
        else f"{between.wn_rad_s:.2g}",
        "scatter of ζ beyond σ": None if between.zeta is None else f"{between.zeta:.2g}",
        "manoeuvres used": ", ".join(map(str, flight.used)),
        "left out, as they disagree": ", ".join(map(str, flight.disagree)),
        "answered by": flight.method and method_words(flight.method),
        "date": flight.date and utc(flight.date),
    }  # fmt: skip
    return {name: str(text) for name, text in rows.items() if text}
