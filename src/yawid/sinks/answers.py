"""The report's first screen in words: wn and zeta with their sigmas, and whether to use them.

Where manoeuvres were found the answer is the flight's, else that of the stream at its end.
"""

import math
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

from yawid.answers.ordinary import ORDINARY
from yawid.answers.run_summary import DutchRoll, Flight, Manoeuvre, RunSummary
from yawid.quantities.vehicles import AIRFRAME
from yawid.sinks.words import (
    GREEK,
    OF_ORDINARY,
    conditions,
    counted,
    duration,
    dutch_roll,
    kappa,
    of_loop,
    whose,
    with_sigma,
)

Stretch = tuple[float | None, float | None]
"""The begin and the end of a stretch in s since boot; None where not given."""
NONE_FOUND: Final = "none found"


class Card(NamedTuple):
    """One of the three answers: the question, the answer in large type, and the lines below it."""

    question: str
    answer: str
    spread: str
    notes: Sequence[str]


def cards(summary: RunSummary) -> list[Card]:
    """Return the cards of the three questions, for the flight or for the stream's answer."""
    mode, flight = _dutch_roll(summary), summary.flight
    wn, zeta = [(NONE_FOUND, "")] * 2
    swings, damps = [], []
    if mode is not None:
        wn, zeta = with_sigma(mode.wn_rad_s, mode.wn_std), with_sigma(mode.zeta, mode.zeta_std)
        hz = f"{mode.wn_rad_s / (2.0 * math.pi):.3g} Hz"
        if abs(mode.zeta) < 1.0:
            period_s = 2.0 * math.pi / (mode.wn_rad_s * math.sqrt(1.0 - mode.zeta**2))
            hz += f", a swing takes {period_s:.3g} s"
        swings, damps = [hz], [_damped(mode.zeta)]
        levelled = summary.deciding.usable and (flight is None or flight.loop == AIRFRAME)
        if mode.level is not None and levelled:
            damps[0] += f"; MIL-F-8785C level {mode.level}"
        if flight is not None:
            slope = kappa(flight) and f"ωn = {kappa(flight)}"
            swings += filter(None, (conditions(flight), slope, whose(flight)))
    unit = "" if mode is None else " rad/s"
    sigmas = [sigma or ("" if mode is None else "σ not known") for _, sigma in (wn, zeta)]
    return [
        Card("Natural frequency ωn", wn[0] + unit, sigmas[0], swings),
        Card("Damping ratio ζ", zeta[0], sigmas[1], damps),
        use(summary),
    ]


def use(summary: RunSummary) -> Card:
    """Return the card that says whether the answer can be used."""
    question, mode, verdict = "Can I use it?", _dutch_roll(summary), summary.deciding
    names = [reason.name for reason in verdict.reasons]
    rests = [] if summary.flight is None else _evidence(summary.flight, summary.manoeuvres or [])
    if summary.verdict is None:
        return Card(question, "Not judged", "no manoeuvres were looked for", names)
    if not verdict.usable:
        spread = "there is no answer" if mode is None else "the numbers are shown for study only"
        return Card(question, "No", spread, [reason.name for reason in verdict.fatal])
    if not names:
        return Card(question, "Yes", "there is no reason against it", [*rests])
    count = f"{len(names)} warning{'s' if len(names) > 1 else ''}, see below"
    return Card(question, "Yes, with care", count, [*names, *rests])


def headline(summary: RunSummary, stretch: Stretch = (None, None)) -> str:
    """Return the whole answer in a sentence or two; ``stretch`` are --from and --to, if given."""
    mode, flight = _dutch_roll(summary), summary.flight
    if summary.verdict is None:
        said = "not known" if mode is None else dutch_roll(mode, GREEK)
        return f"At its end the stream's estimate is {said}. It was not judged."
    if not summary.deciding.usable or mode is None:
        # The first fatal reason decides.
        why = next((reason.text for reason in summary.deciding.fatal), "the reasons are below")
        what = _stretch(stretch) or ("This flight" if flight is not None else "This log")
        said = f"{what} cannot say how the yaw answers the rudder: {why.rstrip('.')}."
        return " ".join(filter(None, (said, elsewhere(summary))))
    wn, zeta = mode.wn_rad_s, mode.zeta
    said = (
        f"The yaw answers the rudder with a Dutch roll of {wn:.3g} rad/s "
        f"({wn / (2.0 * math.pi):.2g} Hz) and a damping ratio of {zeta:.2g}: {_damped(zeta)}."
    )
    if summary.deciding.method == ORDINARY:
        return f"The Dutch roll is {dutch_roll(mode, GREEK)}, {OF_ORDINARY}."
    if flight is None:
        return said
    facts = (whose(flight), conditions(flight), counted(flight, summary.manoeuvres or ()))
    others = [
        f" Also: {of_loop(each, summary.manoeuvres or (), GREEK)}." for each in summary.by_loop[1:]
    ]
    return f"{said} It holds for {', '.join(fact for fact in facts if fact)}.{''.join(others)}"


def _stretch(stretch: Stretch) -> str:
    """Return the name of the part of the log that was read, "" where all of it was."""
    ends = [
        f"{word} {at:g} s" for word, at in zip(("from", "to"), stretch, strict=True)
        if at is not None
    ]  # fmt: skip
    return f"This stretch of the log, {' '.join(ends)}," if ends else ""


def elsewhere(summary: RunSummary) -> str:
    """Return a sentence on what of a refused log is usable by itself, "" without any."""
    found = summary.manoeuvres or ()
    usable = [of_loop(each, found, GREEK) for each in summary.by_loop if each.verdict.usable]
    alone = [
        f"manoeuvre {each.n} ({each.from_s:.0f} to {each.to_s:.0f} s)"
        for each in found
        if each.verdict.usable
    ]
    alone = usable or alone
    for each, of in ((summary.bare, "the bare airframe"), (summary.ordinary, OF_ORDINARY)):
        if each is not None and each.dutch_roll is not None and each.verdict.usable:
            alone.append(f"{dutch_roll(each.dutch_roll, GREEK)}, {of}")
    said = "; ".join(alone)
    return f"By itself this can be used: {said}." if said else ""


def _dutch_roll(summary: RunSummary) -> DutchRoll | None:
    """Return the answer's Dutch roll: the flight's where there is a flight, else the stream's.

    Where only ordinary flight was to be answered it is that of it.
    """
    if summary.ordinary is not None and summary.deciding.method == ORDINARY:
        return summary.ordinary.dutch_roll
    return summary.dutch_roll if summary.flight is None else summary.flight.dutch_roll


def _evidence(flight: Flight, manoeuvres: Sequence[Manoeuvre]) -> Iterator[str]:
    """Yield what a flight's answer rests on."""
    used = [each for each in manoeuvres if each.n in flight.used]
    yield counted(flight, manoeuvres)
    if flight.disagree:
        yield f"left out, as they disagree: {', '.join(map(str, flight.disagree))}"
    fits = [each.answer.fit.simulation_pct for each in used if each.answer is not None]
    known = [f"{max(fit, 0.0):.0f}" for fit in sorted(fit for fit in fits if fit is not None)]
    if known:
        ends = dict.fromkeys((known[0], known[-1]))
        yield f"the models alone explain {' to '.join(ends)} % of the yaw rate"
    if used:
        yield f"estimated from {duration(sum(each.duration_s for each in used))} of flight"


def _damped(zeta: float) -> str:
    if zeta < 0.0:
        return "unstable: each swing grows"
    if zeta >= 1.0:
        return "it does not swing"
    left_pct = 100.0 * math.exp(-2.0 * math.pi * zeta / math.sqrt(1.0 - zeta * zeta))
    said = format(left_pct, ".0f" if left_pct >= 10.0 else ".2g")
    return f"each swing leaves {said} % of the one before"
