"""The report's first screen, in words: what is wn, what is zeta, how sure, can it be used."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import accumulate
from typing import Any

from yawid.estimation.fit import WORST_PCT
from yawid.results.reasons import KINDS

MOST_HEADLINE = 160
"""Characters of a reason that the headline repeats; it stands whole below."""


@dataclass(frozen=True, slots=True)
class Card:
    """One of the four answers: the question, the answer in large, what stands below it."""

    question: str
    answer: str
    spread: str
    notes: tuple[str, ...]


def answering(summary: Mapping[str, Any]) -> str | None:
    """Return the method whose estimate is the answer, None where nothing was estimated.

    The verdict says which; in runs of older versions it is the first.
    """
    estimates = summary.get("estimates", {})
    method: str | None = summary["verdict"].get("method")
    return method if method in estimates else next(iter(estimates), None)


def answer_and_others(
    summary: Mapping[str, Any],
) -> tuple[Mapping[str, Any], dict[str, Mapping[str, Any]]]:
    """Return the estimate that is the answer, empty where there is none, and the others by name."""
    others = dict(summary.get("estimates", {}))
    return others.pop(answering(summary), {}), others


def percent(value: float, spec: str = ".1f") -> str:
    """Return a fit in percent; of a model that explodes only that it does."""
    return format(value, spec) if value > WORST_PCT else f"< {WORST_PCT:.0f}"


def cards(summary: Mapping[str, Any]) -> list[Card]:
    """Return the answers to the four questions; numbers are those of the method that answers."""
    primary, others = answer_and_others(summary)
    mode = primary.get("dutch_roll", {})
    if not summary["verdict"]["usable"]:
        mode = {name: value for name, value in mode.items() if name != "level"}
    return [_frequency(mode, others), _damping(mode, others), _sure(summary, primary), use(summary)]


def use(summary: Mapping[str, Any]) -> Card:
    """Return whether the estimate can be used."""
    verdict = summary["verdict"]
    reasons = verdict["reasons"]
    if not verdict["usable"]:
        spread = "the numbers are shown for study only" if _mode(summary) else "there is no answer"
        return Card("Can I use it?", "No", spread, _names(_fatal(summary)))
    if not reasons:
        return Card("Can I use it?", "Yes", "nothing speaks against it", ())
    count = f"{len(reasons)} warning{'s' if len(reasons) > 1 else ''}, see below"
    notes = _names(reasons)
    return Card("Can I use it?", "Yes, with care", count, notes)


def headline(summary: Mapping[str, Any]) -> str:
    """Return the whole answer as one sentence."""
    mode = _mode(summary)
    if not summary["verdict"]["usable"]:
        # The first fatal reason is the one that decides.
        why = next((reason["text"] for reason in _fatal(summary)), "the reasons stand below")
        return f"This log cannot say how the yaw answers the rudder: {_first_sentences(why)}"
    if "wn_rad_s" not in mode:
        return "No Dutch roll was identified from this log."
    wn, zeta = mode["wn_rad_s"], mode["zeta"]
    return (
        f"The yaw answers the rudder with a Dutch roll of {wn:.3g} rad/s "
        f"({wn / (2.0 * math.pi):.2g} Hz) and a damping ratio of {zeta:.2g}: {_damped(zeta)}."
    )


def _mode(summary: Mapping[str, Any]) -> Mapping[str, float]:
    """Return the Dutch roll of the method that answers, empty where there is none."""
    mode: Mapping[str, float] = answer_and_others(summary)[0].get("dutch_roll", {})
    return mode


def _fatal(summary: Mapping[str, Any]) -> list[Mapping[str, str]]:
    return [r for r in summary["verdict"]["reasons"] if r["weight"] == "fatal"]


def _names(reasons: list[Mapping[str, str]]) -> tuple[str, ...]:
    return tuple(reason["id"].replace("_", " ") for reason in reasons)


def advice(reason: Mapping[str, str]) -> str:
    """Return what to do about a reason, or nothing."""
    kind = KINDS.get(reason["id"])
    return "" if kind is None else kind.now


def with_two_sigma(values: Mapping[str, float], name: str, sigma: str) -> tuple[str, str]:
    """Return a value and its 2 sigma, rounded to where the sigma has two digits."""
    if name not in values:
        return "none found", ""
    value = values[name]
    if not values.get(sigma, 0.0) > 0.0:
        return f"{value:.4g}", "sigma not known"
    spread = 2.0 * values[sigma]
    digits = min(max(1 - math.floor(math.log10(spread)), 0), 6)
    return f"{value:.{digits}f}", f"± {spread:.{digits}f}"


def _frequency(mode: Mapping[str, float], others: Mapping[str, Any]) -> Card:
    value, spread = with_two_sigma(mode, "wn_rad_s", "wn_std")
    notes = list(_beside(others, "wn_rad_s", "wn_std"))
    if "wn_rad_s" in mode:
        wn, zeta = mode["wn_rad_s"], mode["zeta"]
        swing = f", a swing takes {_period(wn, zeta):.3g} s" if abs(zeta) < 1.0 else ""
        notes.insert(0, f"{wn / (2.0 * math.pi):.3g} Hz{swing}")
        value += " rad/s"
    return Card("Natural frequency ωn", value, f"{spread} (2σ)" if spread else "", tuple(notes))


def _damping(mode: Mapping[str, float], others: Mapping[str, Any]) -> Card:
    value, spread = with_two_sigma(mode, "zeta", "zeta_std")
    notes = list(_beside(others, "zeta", "zeta_std"))
    if "zeta" in mode:
        level = f"; MIL-F-8785C level {mode['level']:.0f}" if "level" in mode else ""
        notes.insert(0, f"{_damped(mode['zeta'])}{level}")
    return Card("Damping ratio ζ", value, f"{spread} (2σ)" if spread else "", tuple(notes))


def _sure(summary: Mapping[str, Any], primary: Mapping[str, Any]) -> Card:
    mode, fit = primary.get("dutch_roll", {}), primary.get("fit", {})
    notes = []
    simulated = fit.get("simulation_pct")
    if simulated is not None:
        notes.append(f"the model alone tells {max(simulated, 0.0):.0f} % of the yaw rate")
    if "updates" in primary:
        seconds = primary["updates"] * primary["sample_time_s"]
        notes.append(f"learnt from {_duration(seconds)} of flight")
    if not summary["verdict"]["usable"]:
        return Card("How sure?", "Not usable", "whatever the sigma says", tuple(notes))
    if "wn_std" not in mode or "zeta_std" not in mode:
        return Card("How sure?", "Not known", "no sigma was found", tuple(notes))
    wn_pct = 200.0 * mode["wn_std"] / mode["wn_rad_s"]
    zeta_pct = 200.0 * mode["zeta_std"] / abs(mode["zeta"]) if mode["zeta"] else math.inf
    spread = f"ωn to ±{wn_pct:.2g} %, ζ to ±{zeta_pct:.2g} % (2σ)"
    word = "Very" if wn_pct < 5.0 and zeta_pct < 20.0 else "Fairly"
    if word == "Very" and _doubtful(summary):
        word = "Fairly"
        notes.append("σ may be too small: the residuals are not white")
    word = "Hardly" if wn_pct > 20.0 or zeta_pct > 60.0 else word
    return Card("How sure?", word, spread, tuple(notes))


def _doubtful(summary: Mapping[str, Any]) -> bool:
    reasons = {reason["id"] for reason in summary["verdict"]["reasons"]}
    return "coloured_residuals" in reasons


def _beside(others: Mapping[str, Any], name: str, sigma: str) -> Iterator[str]:
    for method, estimate in others.items():
        value, spread = with_two_sigma(estimate.get("dutch_roll", {}), name, sigma)
        yield f"{method.upper()} beside it: {value} {spread}".rstrip()


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
