"""What the viewer shows as text: the verdict, and the manoeuvres as a table."""

from collections.abc import Sequence

from yawid.results.run_summary import DutchRoll, Flight, Manoeuvre, RunSummary, VerdictSummary
from yawid.sinks.answers import cards, noise_spreads, sigma_means, with_two_sigma


def verdict_markdown(summary: RunSummary) -> str:
    """Return the verdict that decides for the text panel: the answer, then the reasons."""
    verdict = summary.deciding
    lines = ["# Usable" if verdict.usable else "# Not usable"]
    if summary.flight is not None:
        lines.append(flight_line(summary.flight))
    else:
        lines += _stream_lines(summary)
    lines += [f"- **{reason.id}** ({reason.weight}): {reason.text}" for reason in verdict.reasons]
    return "\n".join(lines) + "\n"


def _stream_lines(summary: RunSummary) -> list[str]:
    method, first = summary.answering, next(iter(summary.estimates or {}), "")
    lines = []
    if method is not None and method != first:
        lines.append(f"Answered by {method.upper()}; the lines drawn are those of {first.upper()}.")
    return lines + [
        f"- {card.question.rstrip('?')}: **{card.answer}** {card.spread}".rstrip()
        for card in cards(summary)[:3]
    ]


def manoeuvres_markdown(found: Sequence[Manoeuvre], flight: Flight | None = None) -> str:
    """Return the manoeuvres as a table, above it what the flight says by them together."""
    if not found:
        return "No manoeuvre.\n"
    lines = [] if flight is None else [flight_line(flight), ""]
    lines += ["| | mode | loop | V m/s | ωn rad/s | ζ | usable |", "|-:|-|-|-:|-:|-:|-|"]
    for each in found:
        speed = "" if each.airspeed_m_s is None else f"{each.airspeed_m_s:.1f}"
        cells = [str(each.n), each.mode or "", each.loop.replace("_", " "), speed]
        cells += [*_with_sigmas(each.dutch_roll), _usable(each.verdict)]
        lines.append(f"| {' | '.join(cells)} |")
    means = sigma_means(each.dutch_roll for each in found)
    return "\n".join([*lines, "", f"± is two sigma{means}."]) + "\n"


def flight_line(flight: Flight) -> str:
    """Return what the manoeuvres of a flight say together."""
    wn, zeta = _with_sigmas(flight.dutch_roll)
    noise = noise_spreads(flight.dutch_roll, 2.0)
    of_noise = f"; of it noise: ωn {noise[0]}, ζ {noise[1]}" if noise else ""
    answer = f"**ωn {wn} rad/s, ζ {zeta}** (2σ{of_noise})"
    said = f"The flight: {'no answer' if flight.dutch_roll is None else answer}"
    if flight.airspeed_m_s is not None:
        said += f" at {flight.airspeed_m_s:.1f} m/s"
    if flight.loop is not None:
        said += f", {flight.loop.replace('_', ' ')}"
    if flight.used:
        said += f", of manoeuvre {_numbers(flight.used)}"
    if flight.disagree:
        said += f"; {_numbers(flight.disagree)} disagree"
    return f"{said}: {_usable(flight.verdict)}."


def _usable(verdict: VerdictSummary) -> str:
    """Return whether it is usable, else the reason that decides: the first fatal one."""
    if verdict.usable:
        return "usable"
    why = [reason.id.replace("_", " ") for reason in verdict.fatal]
    return f"not usable, {why[0]}" if why else "not usable"


def _with_sigmas(roll: DutchRoll | None) -> tuple[str, str]:
    if roll is None:
        return "none", "none"
    pairs = (roll.wn_rad_s, roll.wn_std), (roll.zeta, roll.zeta_std)
    wn, zeta = (" ".join(with_two_sigma(*pair)) for pair in pairs)
    return wn, zeta


def _numbers(found: Sequence[int]) -> str:
    return ", ".join(map(str, found))
