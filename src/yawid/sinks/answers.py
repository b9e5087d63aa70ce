"""The report's first screen, in words: what is wn, what is zeta, how sure, can it be used."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import accumulate
from typing import Final

from msgspec.structs import replace

from yawid.estimation.fit import WORST_PCT
from yawid.results.run_summary import DutchRoll, MethodSummary, ReasonSummary, RunSummary

MOST_HEADLINE = 160
"""Characters of a reason that the headline repeats; it stands whole below."""
_NONE: Final = ("none found", "")


@dataclass(frozen=True, slots=True)
class Card:
    """One of the four answers: the question, the answer in large, what stands below it."""

    question: str
    answer: str
    spread: str
    notes: tuple[str, ...]


def percent(value: float, spec: str = ".1f") -> str:
    """Return a fit in percent; of a model that explodes only that it does."""
    return format(value, spec) if value > WORST_PCT else f"< {WORST_PCT:.0f}"


def cards(summary: RunSummary) -> list[Card]:
    """Return the answers to the four questions; numbers are those of the method that answers."""
    mode, others = summary.dutch_roll, summary.others
    if mode is not None and not summary.verdict.usable:
        mode = replace(mode, level=None)
    return [_frequency(mode, others), _damping(mode, others), _sure(summary), use(summary)]


def use(summary: RunSummary) -> Card:
    """Return whether the estimate can be used."""
    reasons = summary.verdict.reasons
    if not summary.verdict.usable:
        shown = summary.dutch_roll is not None
        spread = "the numbers are shown for study only" if shown else "there is no answer"
        return Card("Can I use it?", "No", spread, _names(_fatal(summary)))
    if not reasons:
        return Card("Can I use it?", "Yes", "nothing speaks against it", ())
    count = f"{len(reasons)} warning{'s' if len(reasons) > 1 else ''}, see below"
    notes = _names(reasons)
    return Card("Can I use it?", "Yes, with care", count, notes)


def headline(summary: RunSummary) -> str:
    """Return the whole answer as one sentence."""
    mode = summary.dutch_roll
    if not summary.verdict.usable:
        # The first fatal reason is the one that decides.
        why = next((reason.text for reason in _fatal(summary)), "the reasons stand below")
        return f"This log cannot say how the yaw answers the rudder: {_first_sentences(why)}"
    if mode is None:
        return "No Dutch roll was identified from this log."
    wn, zeta = mode.wn_rad_s, mode.zeta
    return (
        f"The yaw answers the rudder with a Dutch roll of {wn:.3g} rad/s "
        f"({wn / (2.0 * math.pi):.2g} Hz) and a damping ratio of {zeta:.2g}: {_damped(zeta)}."
    )


def _fatal(summary: RunSummary) -> list[ReasonSummary]:
    return [r for r in summary.verdict.reasons if r.weight == "fatal"]


def _names(reasons: list[ReasonSummary]) -> tuple[str, ...]:
    return tuple(reason.id.replace("_", " ") for reason in reasons)


def with_two_sigma(value: float, sigma: float | None) -> tuple[str, str]:
    """Return a value and its 2 sigma, rounded to where the sigma has two digits."""
    if sigma is None or not sigma > 0.0:
        return f"{value:.4g}", "sigma not known"
    spread = 2.0 * sigma
    digits = min(max(1 - math.floor(math.log10(spread)), 0), 6)
    return f"{value:.{digits}f}", f"± {spread:.{digits}f}"


def _frequency(mode: DutchRoll | None, others: Mapping[str, MethodSummary]) -> Card:
    value, spread = _wn(mode)
    notes = [f"{m.upper()} beside it: {' '.join(_wn(e.dutch_roll))}" for m, e in others.items()]
    if mode is not None:
        wn, zeta = mode.wn_rad_s, mode.zeta
        swing = f", a swing takes {_period(wn, zeta):.3g} s" if abs(zeta) < 1.0 else ""
        notes.insert(0, f"{wn / (2.0 * math.pi):.3g} Hz{swing}")
        value += " rad/s"
    return _card("Natural frequency ωn", value, spread, notes)


def _damping(mode: DutchRoll | None, others: Mapping[str, MethodSummary]) -> Card:
    value, spread = _zeta(mode)
    notes = [f"{m.upper()} beside it: {' '.join(_zeta(e.dutch_roll))}" for m, e in others.items()]
    if mode is not None:
        level = "" if mode.level is None else f"; MIL-F-8785C level {mode.level}"
        notes.insert(0, f"{_damped(mode.zeta)}{level}")
    return _card("Damping ratio ζ", value, spread, notes)


def _card(question: str, value: str, spread: str, notes: list[str]) -> Card:
    shown = f"{spread} (2σ)" if spread else ""
    return Card(question, value, shown, tuple(note.rstrip() for note in notes))


def _wn(mode: DutchRoll | None) -> tuple[str, str]:
    return _NONE if mode is None else with_two_sigma(mode.wn_rad_s, mode.wn_std)


def _zeta(mode: DutchRoll | None) -> tuple[str, str]:
    return _NONE if mode is None else with_two_sigma(mode.zeta, mode.zeta_std)


def _sure(summary: RunSummary) -> Card:
    answer, mode, notes = summary.answer, summary.dutch_roll, []
    if answer is not None:
        if answer.fit.simulation_pct is not None:
            explained_pct = max(answer.fit.simulation_pct, 0.0)
            notes.append(f"the model alone tells {explained_pct:.0f} % of the yaw rate")
        notes.append(f"learnt from {_duration(answer.updates * answer.sample_time_s)} of flight")
    if not summary.verdict.usable:
        return Card("How sure?", "Not usable", "whatever the sigma says", tuple(notes))
    if mode is None or mode.wn_std is None or mode.zeta_std is None:
        return Card("How sure?", "Not known", "no sigma was found", tuple(notes))
    wn_pct = 200.0 * mode.wn_std / mode.wn_rad_s
    zeta_pct = 200.0 * mode.zeta_std / abs(mode.zeta) if mode.zeta else math.inf
    spread = f"ωn to ±{wn_pct:.2g} %, ζ to ±{zeta_pct:.2g} % (2σ)"
    word = "Very" if wn_pct < 5.0 and zeta_pct < 20.0 else "Fairly"
    if word == "Very" and any(r.id == "coloured_residuals" for r in summary.verdict.reasons):
        word = "Fairly"
        notes.append("σ may be too small: the residuals are not white")
    word = "Hardly" if wn_pct > 20.0 or zeta_pct > 60.0 else word
    return Card("How sure?", word, spread, tuple(notes))


def _damped(zeta: float) -> str:
    if zeta < 0.0:
        return "unstable: each swing grows"
    if zeta >= 1.0:
        return "it does not swing"
    left_pct = 100.0 * math.exp(-2.0 * math.pi * zeta / math.sqrt(1.0 - zeta * zeta))
    said = format(left_pct, ".0f" if left_pct >= 10.0 else ".2g")
    return f"each swing leaves {said} % of the one before"


def _period(wn_rad_s: float, zeta: float) -> float:
    return 2.0 * math.pi / (wn_rad_s * math.sqrt(1.0 - zeta * zeta))


def _duration(seconds: float) -> str:
    if seconds < 120.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 7200.0 else f"{seconds / 3600.0:.1f} h"


def _first_sentences(text: str) -> str:
    """Return so many whole sentences or clauses as a headline bears, the first in any case."""
    sentences = re.split(r"(?<=[.;?!]) +", text)
    count = max(sum(end <= MOST_HEADLINE for end in accumulate(len(s) + 1 for s in sentences)), 1)
    said = " ".join(sentences[:count]).rstrip(".;")
    return said if said.endswith(("?", "!")) else f"{said}."
