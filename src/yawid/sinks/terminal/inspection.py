"""The page of ``yawid inspect``: what a log can answer, short enough to read in ten seconds."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import TextIO

import numpy as np

from yawid.answers.inspection import FlightPhase, Inspection, MessageRate, Span
from yawid.answers.run_summary import Flight, Manoeuvre
from yawid.sinks.pages import NAME_WIDTH, Note, to_terminal, verdict_parts
from yawid.sinks.run_page import origin
from yawid.sinks.words import Row, count, dutch_roll, flown, of_loop, says

MOST_PHASES = 6
LEAST_PHASE_S = 3.0
MOST_WINDOWS = 6
MOST_SENDERS = 8
MOST_MANOEUVRES = 6


def print_inspection(report: Inspection, stream: TextIO) -> None:
    """Print what a log can answer: verdict, channels, phases and stretches, and what to do."""
    head, rows = Note(report.log, "bold", wraps=False), (Row(*each) for each in _rows(report))
    to_terminal([head, *verdict_parts(report.deciding), *origin(report), *rows], stream)
    if report.command is not None:
        # The command that was tried is for copying: it must not be wrapped.
        word = "try" if report.exit_code == 0 else "tried"
        to_terminal([Note(f"{word:>{NAME_WIDTH - 1}}  {report.command}", wraps=False)], stream)


def _rows(report: Inspection) -> Iterator[tuple[str, str]]:
    if report.vehicle is not None:
        seen = report.vehicle
        address = f"{seen.sysid}/{seen.compid}"
        yield "vehicle", f"{seen.kind}, {address}, log of {report.duration_s:.0f} s"
    senders = sorted(report.by_sender.items(), key=lambda each: -each[1]["frames"])
    yield "senders", _first([_sender(*each) for each in senders], MOST_SENDERS)
    if report.unchecked is not None:
        yield "signing", report.unchecked
    if report.rates:
        rates = ", ".join(f"{name} {_interval(each)}" for name, each in report.rates.items())
        yield "interval", rates.replace("(", "(5-95 %: ", 1)
    if report.phases:
        yield "phases", _phases(report.phases)
    windows = [f"{_boot(s)}{s.from_s:g} to {s.to_s:g} s" for s in report.excited]
    yield "excited", _first(windows, MOST_WINDOWS) if windows else "nowhere"
    if report.flight is not None:
        yield from _flight(report.flights or [report.flight], report.manoeuvres or [])
    if report.answerable is not None:
        most, well = report.answerable.wn_max_rad_s, report.answerable.wn_well_rad_s
        yield (
            "answers",
            f"Dutch rolls with wn up to {most:.3g} rad/s, and well up to {well:.3g} rad/s",
        )
    for name, can in (report.can or {}).items():
        lacks = f"does not show the aircraft's mode: {'; '.join(can.lacks)}"
        yield name, "shows the aircraft's mode: --ordinary auto" if can.yes else lacks
    for line in report.record or ():
        yield "record", line


def _sender(name: str, counts: Mapping[str, int]) -> str:
    """Return a text on one sender: its frames, and its other counts that are not zero."""
    others = [f"{n} {key.replace('_', ' ')}" for key, n in counts.items() if n and key != "frames"]
    return f"{name} ({', '.join([str(counts['frames']), *others])})"


def _interval(rate: MessageRate) -> str:
    low, middle, high = rate.interval_p5_s, rate.interval_median_s, rate.interval_p95_s
    return f"{1e3 * middle:.3g} ms ({1e3 * low:.3g} to {1e3 * high:.3g})"


def _phases(phases: Sequence[FlightPhase]) -> str:
    """Return the longest phases in their order, and the number of shorter ones."""
    lasts = np.array([phase.to_s - phase.from_s for phase in phases])
    longest = np.sort(np.argsort(-lasts, kind="stable")[:MOST_PHASES])
    shown = [i for i in longest.tolist() if lasts[i] >= LEAST_PHASE_S]
    rest = len(phases) - len(shown)
    named = ", ".join(_phase(phases[i]) for i in shown) or f"none of {LEAST_PHASE_S:g} s"
    return named + (f", and {rest} shorter" if rest else "")


def _phase(phase: FlightPhase) -> str:
    words = [word for word in (phase.mode, phase.state) if word is not None]
    return " ".join((f"{_boot(phase)}{phase.from_s:.0f} to {phase.to_s:.0f} s", *words))


def _flight(
    flights: Sequence[Flight], manoeuvres: Sequence[Manoeuvre]
) -> Iterator[tuple[str, str]]:
    """Yield the flight's answers and its manoeuvres, or why none of them is usable."""
    flight = flights[0]
    if flight.dutch_roll is None:
        fatal = Counter(each.verdict.why for each in manoeuvres)
        why = ", ".join(f"{n} {reason}" for reason, n in fatal.most_common())
        yield "flight", f"{count(len(manoeuvres))}, none usable: {why}"
        return
    said = f"{dutch_roll(flight.dutch_roll)} (± is one sigma)"
    yield "flight", f"{said} from {count(len(flight.used))}"
    for other in flights[1:]:
        yield "also", of_loop(other, manoeuvres)
    for each in manoeuvres[:MOST_MANOEUVRES]:
        yield f"#{each.n}", f"{flown(each)}: {says(each)}"
    if len(manoeuvres) > MOST_MANOEUVRES:
        yield "", f"and {count(len(manoeuvres) - MOST_MANOEUVRES)} more"


def _boot(span: Span) -> str:
    return "" if span.boot is None or span.boot <= 1 else f"boot {span.boot}: "


def _first(texts: Sequence[str], most: int) -> str:
    rest = len(texts) - most
    return ", ".join(texts[:most]) + (f", and {rest} more" if rest > 0 else "")
