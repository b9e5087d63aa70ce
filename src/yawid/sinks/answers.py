"""The report's first screen in words: wn, zeta, how sure they are, and whether to use them.

Where manoeuvres were found the answer is the flight's, else that of the stream at its end.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from msgspec.structs import replace

from yawid.answers.ordinary import ORDINARY
from yawid.answers.reasons import KINDS, Reason
from yawid.answers.run_summary import DutchRoll, Flight, MethodSummary, RunSummary
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

ROUGHLY: Final = "Roughly"
Stretch = tuple[float | None, float | None]
"""The begin and the end of a stretch in s since boot; None where not given."""
_NONE: Final = ("none found", "")
_NO_SIGMA: Final = "σ not known"


@dataclass(frozen=True, slots=True)
class Card:
    """One of the four answers: the question, the answer in large type, and the lines below it."""

    question: str
    answer: str
    spread: str
    notes: tuple[str, ...]


def cards(summary: RunSummary) -> list[Card]:
    """Return the cards of the four questions, for the flight or for the stream's answer."""
    mode, flight = _dutch_roll(summary), summary.flight
    others = dict(list((summary.estimates or {}).items())[1:]) if flight is None else {}
    levelled = summary.deciding.usable and (flight is None or flight.loop == AIRFRAME)
    if mode is not None and not levelled:
        mode = replace(mode, level=None)
    frequency = _of_number("Natural frequency ωn", 0, mode, others)
    damping = _of_number("Damping ratio ζ", 1, mode, others)
    if flight is None:
        return [frequency, damping, _sure(summary), use(summary)]
    if mode is not None:
        slope = kappa(flight) and f"ωn = {kappa(flight)}"
        more = conditions(flight), slope, whose(flight)
        notes = (*frequency.notes, *(note for note in more if note))
        frequency = dataclasses.replace(frequency, notes=notes)
    return [frequency, damping, _sure_of_flight(summary, flight), use(summary)]


def use(summary: RunSummary) -> Card:
    """Return the card that says whether the answer can be used."""
    reasons = summary.deciding.reasons
    if summary.verdict is None:
        return Card("Can I use it?", "Not judged", "no manoeuvres were looked for", _names(reasons))
    if not summary.deciding.usable:
        shown = _dutch_roll(summary) is not None
        spread = "the numbers are shown for study only" if shown else "there is no answer"
        return Card("Can I use it?", "No", spread, _names(summary.deciding.fatal))
    wide = _sureness(summary, _dutch_roll(summary)) == ROUGHLY
    if not reasons and not wide:
        return Card("Can I use it?", "Yes", "there is no reason against it", ())
    said = ["its σ is wide"] if wide else []
    if reasons:
        said.append(f"{len(reasons)} warning{'s' if len(reasons) > 1 else ''}, see below")
    return Card("Can I use it?", "Yes, with care", "; ".join(said), _names(reasons))


def headline(summary: RunSummary, stretch: Stretch = (None, None)) -> str:
    """Return the whole answer in a sentence or two; ``stretch`` are --from and --to, if given."""
    mode, flight = _dutch_roll(summary), summary.flight
    if summary.verdict is None:
        said = "not known" if mode is None else dutch_roll(mode, GREEK)
        return f"At its end the stream's estimate is {said}. It was not judged."
    if not summary.deciding.usable:
        # The first fatal reason decides.
        why = next((reason.text for reason in summary.deciding.fatal), "the reasons are below")
        what = _stretch(stretch) or ("This flight" if flight is not None else "This log")
        said = f"{what} cannot say how the yaw answers the rudder: {_sentences(why)}"
        return " ".join(filter(None, (said, _elsewhere(summary))))
    if mode is None:
        return f"No Dutch roll was identified from {_stretch(stretch).lower() or 'this log'}."
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


def _elsewhere(summary: RunSummary) -> str:
    """Return a sentence on the part of a refused log that is usable by itself, "" without any."""
    if summary.flight is None:
        return ""
    usable = [
        of_loop(each, summary.manoeuvres or (), GREEK)
        for each in summary.by_loop
        if each.verdict.usable
    ]
    if usable:
        return f"This can be used: {'; '.join(usable)}."
    alone = [
        f"{each.n} ({each.from_s:.0f} to {each.to_s:.0f} s)"
        for each in summary.manoeuvres or ()
        if each.verdict.usable and each.dutch_roll is not None
    ]
    if alone:
        some = f"manoeuvre{'s' if len(alone) > 1 else ''} {', '.join(alone)}"
        return f"By itself this can be used: {some}; see the table."
    return ""


def _dutch_roll(summary: RunSummary) -> DutchRoll | None:
    """Return the answer's Dutch roll: the flight's where there is a flight, else the stream's.

    Where only ordinary flight was to be answered it is that of it.
    """
    if summary.ordinary is not None and summary.deciding.method == ORDINARY:
        return summary.ordinary.dutch_roll
    return summary.dutch_roll if summary.flight is None else summary.flight.dutch_roll


def _names(reasons: list[Reason]) -> tuple[str, ...]:
    return tuple(reason.name for reason in reasons)


def _of_number(
    question: str, i: int, mode: DutchRoll | None, others: Mapping[str, MethodSummary]
) -> Card:
    """Return the card of wn (``i`` 0) or zeta (1), with the values of the other methods."""
    said = [
        f"{m.upper()} next to it: {' '.join(_known(e.dutch_roll)[i])}" for m, e in others.items()
    ]
    value, spread = _known(mode)[i]
    if mode is None:
        return Card(question, value, spread, tuple(note.rstrip() for note in said))
    wn, zeta = mode.wn_rad_s, mode.zeta
    level = "" if mode.level is None else f"; MIL-F-8785C level {mode.level}"
    swing = ""
    if abs(zeta) < 1.0:
        swing = f", a swing takes {2.0 * math.pi / (wn * math.sqrt(1.0 - zeta * zeta)):.3g} s"
    facts = f"{wn / (2.0 * math.pi):.3g} Hz{swing}", f"{_damped(zeta)}{level}"
    unit = (" rad/s", "")[i]
    return Card(question, value + unit, spread, (facts[i], *(note.rstrip() for note in said)))


def _known(mode: DutchRoll | None) -> tuple[tuple[str, str], tuple[str, str]]:
    """Return wn and zeta as texts, each with its sigma."""
    if mode is None:
        return _NONE, _NONE
    wn, zeta = with_sigma(mode.wn_rad_s, mode.wn_std), with_sigma(mode.zeta, mode.zeta_std)
    return (wn[0], wn[1] or _NO_SIGMA), (zeta[0], zeta[1] or _NO_SIGMA)


def _sure(summary: RunSummary) -> Card:
    answer, mode, notes = summary.answer, _dutch_roll(summary), []
    if answer is not None:
        if answer.fit.simulation_pct is not None:
            explained_pct = max(answer.fit.simulation_pct, 0.0)
            notes.append(f"the model alone explains {explained_pct:.0f} % of the yaw rate")
        notes.append(
            f"estimated from {duration((answer.updates or 0) * answer.sample_time_s)} of flight"
        )
    if mode is not None and mode.wn_std is not None and mode.wn_std_noise is None:
        notes.append("σ is of noise alone")
    return _how_sure(summary, mode, notes)


def _sure_of_flight(summary: RunSummary, flight: Flight) -> Card:
    manoeuvres = summary.manoeuvres or []
    used = [each for each in manoeuvres if each.n in flight.used]
    notes = [counted(flight, manoeuvres)]
    if flight.disagree:
        notes.append(f"left out, as they disagree: {', '.join(map(str, flight.disagree))}")
    fits = [each.answer.fit.simulation_pct for each in used if each.answer is not None]
    known = [max(fit, 0.0) for fit in fits if fit is not None]
    if known:
        notes.append(f"the models alone explain {_range(known)} % of the yaw rate")
    if used:
        notes.append(f"estimated from {duration(sum(each.duration_s for each in used))} of flight")
    return _how_sure(summary, flight.dutch_roll, notes)


def _range(values: Sequence[float]) -> str:
    low, high = f"{min(values):.0f}", f"{max(values):.0f}"
    return low if low == high else f"{low} to {high}"


def _how_sure(summary: RunSummary, mode: DutchRoll | None, notes: list[str]) -> Card:
    if summary.verdict is None:
        return Card("How sure?", "Not known", "σ of the stream is of noise alone", tuple(notes))
    if not summary.deciding.usable:
        return Card("How sure?", "Not enough", "whatever σ says", tuple(notes))
    if mode is None or mode.wn_std is None or mode.zeta_std is None:
        return Card("How sure?", "Not known", "no sigma was found", tuple(notes))
    wn_pct, zeta_pct = _sigma_pct(mode, mode.wn_std, mode.zeta_std)
    spread = f"ωn to ±{wn_pct:.2g} %, ζ to ±{zeta_pct:.2g} %"
    if mode.wn_std_noise is not None and mode.zeta_std_noise is not None:
        of_noise = _sigma_pct(mode, mode.wn_std_noise, mode.zeta_std_noise)
        notes.append(
            f"noise alone gives ωn ±{of_noise[0]:.2g} %, ζ ±{of_noise[1]:.2g} %; the rest is "
            "structure and the scatter of manoeuvres"
        )
    return Card("How sure?", _sureness(summary, mode), spread, tuple(notes))


def _sureness(summary: RunSummary, mode: DutchRoll | None) -> str:
    """Return how well a usable answer is known, from its sigmas and its warnings, "" if unknown."""
    if mode is None or mode.wn_std is None or mode.zeta_std is None:
        return ""
    wn_pct, zeta_pct = _sigma_pct(mode, mode.wn_std, mode.zeta_std)
    if wn_pct > 10.0 or zeta_pct > 30.0:
        return ROUGHLY
    doubted = any(
        KINDS[reason.id].origin == "estimate"
        for reason in summary.deciding.reasons
        if reason.id in KINDS
    )
    return "Well" if wn_pct < 2.5 and zeta_pct < 10.0 and not doubted else "Fairly"


def _sigma_pct(mode: DutchRoll, wn_std: float, zeta_std: float) -> tuple[float, float]:
    """Return the sigmas in percent of wn and of zeta."""
    zeta_pct = 100.0 * zeta_std / abs(mode.zeta) if mode.zeta else math.inf
    return 100.0 * wn_std / mode.wn_rad_s, zeta_pct


def _damped(zeta: float) -> str:
    if zeta < 0.0:
        return "unstable: each swing grows"
    if zeta >= 1.0:
        return "it does not swing"
    left_pct = 100.0 * math.exp(-2.0 * math.pi * zeta / math.sqrt(1.0 - zeta * zeta))
    said = format(left_pct, ".0f" if left_pct >= 10.0 else ".2g")
    return f"each swing leaves {said} % of the one before"


def _sentences(text: str) -> str:
    """Return a reason's whole text, with a full stop: a part of it alone may mislead."""
    return text if text.endswith(("?", "!", ".")) else f"{text}."
