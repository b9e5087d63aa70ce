"""The texts in the viewer: the verdict with its numbers, and the manoeuvres; ± is one sigma."""

from collections.abc import Iterator, Mapping, Sequence

from yawid.answers.reasons import Verdict
from yawid.answers.run_summary import DutchRoll, Flight, Manoeuvre, MethodSummary, RunSummary, Value
from yawid.quantities.table import YAW_CHANNEL
from yawid.quantities.units import HALF_TRAVEL
from yawid.sinks.words import (
    GREEK,
    NEXT,
    bare_rows,
    conditions,
    dutch_roll,
    loop_of,
    next_step,
    numbers,
    of_noise,
    ordinary_rows,
    plus_minus,
    sigma_means,
    whose,
)

_UNUSABLE = "Do not use the numbers: they are shown only to find out why."

_DERIVATIVES = ("a_my_beta", "a_my_omega_y", "a_my_delta_h", "a_z_beta", "K", "T_theta_s")
"""The yaw channel's numbers that are shown; wn and zeta are shown above them."""


def verdict_markdown(summary: RunSummary, rudder_unit: str = HALF_TRAVEL) -> str:
    """Return the deciding verdict for the text panel: the answer, the reasons, then numbers."""
    verdict = summary.deciding
    lines = [f"# {verdict.word.capitalize()}"]
    lines += map(flight_line, summary.by_loop)
    if summary.flight is None and summary.answer is not None:
        said = _answer(summary.dutch_roll, usable=verdict.usable)
        lines.append(f"The stream, {summary.answer.method.upper()}: {said}.")
    if bare := [row.text for row in bare_rows(summary)]:
        lines += ["", f"**The bare airframe:** {'; '.join(bare)}.", ""]
    if ordinary := [row.text for row in ordinary_rows(summary)]:
        lines += ["", f"**Ordinary flight:** {'; '.join(ordinary)}.", ""]
    lines += [f"- **{reason.id}** ({reason.weight}): {reason.text}" for reason in verdict.reasons]
    if (step := next_step(verdict)) is not None:
        lines += ["", f"**{NEXT}** {step}"]
    if summary.estimates and verdict.fatal:
        lines += ["", _UNUSABLE]
    lines += _methods(summary.estimates or {})
    for name, physics in _yaw_channels(summary):
        lines += ["", f"| yaw channel, {name} | |", "|-|-:|"]
        lines += _numbers(physics, rudder_unit)
    if summary.estimates:
        roll = summary.dutch_roll if summary.flight is None else summary.flight.dutch_roll
        lines += ["", f"± is one sigma{sigma_means([roll])}."]
    return "\n".join(lines) + "\n"


def _methods(estimates: Mapping[str, MethodSummary]) -> Iterator[str]:
    if estimates:
        yield from ("", "| stream at its end | ωn rad/s | ζ | fit simulated |", "|-|-:|-:|-:|")
    for method, estimate in estimates.items():
        wn, zeta = numbers(estimate.dutch_roll)
        fit = estimate.fit.simulation_pct
        yield f"| {method.upper()} | {wn} | {zeta} | {'' if fit is None else f'{fit:.0f} %'} |"


def _yaw_channels(summary: RunSummary) -> Iterator[tuple[str, Mapping[str, Value]]]:
    """Yield the name and the numbers of each yaw channel to show.

    They are the flight's, for each loop; without a flight those of the stream's answer.
    """
    for each in summary.by_loop:
        if each.physics:
            said = filter(None, (whose(each), conditions(each)))
            yield f"the flight, {' '.join(said)}", each.physics
    answer = summary.answer
    if summary.flight is None and answer is not None and answer.physics:
        yield f"stream, {answer.method.upper()}", answer.physics


def _numbers(physics: Mapping[str, Value], rudder_unit: str) -> Iterator[str]:
    for key in _DERIVATIVES:
        row, found = YAW_CHANNEL[key], physics.get(key, Value())
        if found.value is None:
            continue
        number = f"{plus_minus(found.value, found.std)} {row.unit_for(rudder_unit)}"
        yield f"| {row.words} {row.symbol} | {number} |"


def manoeuvres_markdown(found: Sequence[Manoeuvre], flights: Sequence[Flight] = ()) -> str:
    """Return the manoeuvres as a table, with the flight's answers above it."""
    if not found:
        return "No manoeuvre.\n"
    lines = [line for flight in flights for line in (flight_line(flight), "")]
    has_bare = any(each.lateral for each in found)
    heads, ruler = (" ωn, bare | ζ, bare |", "-:|-:|") if has_bare else ("", "")
    lines.append(f"| | mode | loop | V m/s | ωn rad/s | ζ | usable |{heads}")
    lines.append(f"|-:|-|-|-:|-:|-:|-|{ruler}")
    for each in found:
        speed = "" if each.airspeed_m_s is None else f"{each.airspeed_m_s:.1f}"
        cells = [str(each.n), each.mode or "", loop_of(each.loop).name, speed]
        cells += [*numbers(each.dutch_roll), _usable(each.verdict)]
        if has_bare:
            cells += numbers(None if each.lateral is None else each.lateral.dutch_roll)
        lines.append(f"| {' | '.join(cells)} |")
    means = sigma_means(each.dutch_roll for each in found)
    return "\n".join([*lines, "", f"± is one sigma{means}."]) + "\n"


def flight_line(flight: Flight) -> str:
    """Return the answer that the manoeuvres of a flight give together, in one line."""
    answer = _answer(flight.dutch_roll, usable=flight.verdict.usable)
    noise = of_noise(flight.dutch_roll, GREEK)
    facts = [f"The flight: {answer}{f' ({noise})' if noise else ''}", conditions(flight)]
    facts += [] if flight.loop is None else [whose(flight)]
    facts += [f"of manoeuvre {_listed(flight.used)}"] if flight.used else []
    disagree = f"; {_listed(flight.disagree)} disagree" if flight.disagree else ""
    return f"{', '.join(filter(None, facts))}{disagree}: {_usable(flight.verdict)}."


def _answer(roll: DutchRoll | None, *, usable: bool) -> str:
    """Return wn and zeta as text, in bold where they are usable."""
    bold = "**" if usable else ""
    return "no answer" if roll is None else f"{bold}{dutch_roll(roll, GREEK)}{bold}"


def _usable(verdict: Verdict) -> str:
    """Return the verdict in a word, with the first fatal reason where there is one."""
    return ", ".join((verdict.word, *(reason.name for reason in verdict.fatal[:1])))


def _listed(found: Sequence[int]) -> str:
    return ", ".join(map(str, found))
