"""Compares yawid's answers with the truth of a log, as rows that all judges of flights count.

A row is one estimate: a manoeuvre's answer (kind ``manoeuvre``), what the recursive methods had at
its end (``rml``, ``els``), or the flight's (``flight``). A manoeuvre of the truth that was not
found is a row, too (``missed``). Recursive methods have no verdict; their rows have that of the
answer with which they are shown.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from flights.fly import Made
from flights.truth import at_airspeeds
from numpy.typing import NDArray

from checks.judge_response import numbers_shown
from yawid.answers.reasons import Verdict
from yawid.answers.run_summary import DutchRoll, Manoeuvre, RunSummary
from yawid.config.run import RunConfig
from yawid.errors import YawidError
from yawid.pipeline import Pipeline
from yawid.results.summary import summarise
from yawid.runs.job import feed_all, open_log

Row = dict[str, Any]
Truth = dict[str, Any]
Floats = NDArray[np.float64]
Known = tuple[Floats, Floats]
"""True wn in rad/s and zeta (2,), and their sigmas (2,)."""
METHODS = ("rml", "els")


def kept(folder: Path, name: str, make: Callable[[], Made]) -> tuple[Path, Truth]:
    """Return a log and its truth; make them if the folder does not have them yet."""
    log, truth = folder / f"{name}.tlog", folder / f"{name}.json"
    if not truth.exists():  # the truth is written last, so with it the log is complete
        made = make()
        log.write_bytes(made.log)
        truth.write_text(json.dumps(made.truth, indent=1) + "\n", encoding="utf-8")
    return log, json.loads(truth.read_text(encoding="utf-8"))


def replayed(log: Path, config: RunConfig | None = None) -> RunSummary:
    """Return the summary of a log, replayed with the default options unless others are given."""
    source, pipeline = open_log(log), Pipeline(config or RunConfig())
    feed_all(source, pipeline)
    return summarise(pipeline, source.link, str(log), "")


def judged(log: Path, truth: Truth, config: RunConfig | None = None) -> list[Row]:
    """Replay a log and return its rows; a log that fails has only the flight's row, refused."""
    config = config or RunConfig()
    try:
        return compared(replayed(log, config), truth, config)
    except YawidError as error:
        verdict = Verdict(usable=False, reasons=[])
        return [
            {"kind": "flight"}
            | judged_answer(None, None, verdict)
            | {"fatal": type(error).__name__}
        ]


BARE = ("aileron",)
"""The input with which a truth is that of the bare airframe."""


def true_at(truth: Truth, from_s: float, to_s: float, inputs: Sequence[str]) -> Known | None:
    """Return the truth between two boot times, or None if it is unknown.

    With the aileron as an input, the roll hold is not part of the model, and the truth is that of
    the bare airframe.
    """
    bare = BARE[0] in inputs
    if "lines" in truth:
        line = truth["lines"]["dutch_roll_open_loop" if bare else "dutch_roll"]
        flown = np.array(truth["flown"])
        inside = (flown[:, 0] >= from_s) & (flown[:, 0] <= to_s)
        return line and at_airspeeds(line, flown[inside, 1])
    of: Truth | None = truth
    if "manoeuvres" in truth:
        of = _manoeuvre_at(truth, from_s, to_s)
    names = ("airframe", "dutch_roll_open_loop") if bare else ("dutch_roll",)
    mode = next((of[name] for name in names if name in of), None) if of else None
    if of is None or mode is None:
        return None
    value = np.array([mode["wn_rad_s"], mode["zeta"]])
    if "wn_std" in mode:
        return value, np.array([mode["wn_std"], mode["zeta_std"]])
    seen = None if bare else of.get("dutch_roll_pulse")
    pulse = value if seen is None else np.array([seen["wn_rad_s"], seen["zeta"]])
    return value, np.abs(pulse - value)


def _manoeuvre_at(truth: Truth, from_s: float, to_s: float) -> Truth | None:
    """Return the first of the truth's manoeuvres that overlaps the time between two boot times."""
    meant = (m for m in truth.get("manoeuvres", ()) if m["from_s"] < to_s and from_s < m["to_s"])
    return next(meant, None)


def compared(summary: RunSummary, truth: Truth, config: RunConfig | None = None) -> list[Row]:
    """Return the rows of one flight; its own row has no estimate if it is refused."""
    config = config or RunConfig()
    rows: list[Row] = []
    known: dict[int, Known | None] = {}
    missed = {each["n"]: each["kind"] for each in truth.get("manoeuvres", ()) if "n" in each}
    for found in summary.manoeuvres or []:
        known[found.n] = true_at(truth, found.from_s, found.to_s, found.inputs)
        of = (_manoeuvre_at(truth, found.from_s, found.to_s) or {}).get("n")
        missed.pop(of, None)
        by_stream = true_at(truth, found.from_s, found.to_s, config.inputs)
        rows += _manoeuvre_rows(found, (known[found.n], by_stream), truth, of)
    rows += [{"kind": "missed", "of": n, "leg": kind} for n, kind in missed.items()]
    rows.append(_flight_row(summary, truth, known))
    return rows


def _manoeuvre_rows(
    found: Manoeuvre, known: tuple[Known | None, Known | None], truth: Truth, of: int | None
) -> Iterator[Row]:
    """Yield a manoeuvre's rows; ``known`` is the truth of its answer, and of the stream's model."""
    first, last = found.from_s, found.to_s
    legs = (leg for leg in truth.get("legs", ()) if first < leg["to_s"] and leg["from_s"] < last)
    where: Row = {
        "n": found.n,
        "of": of,
        "from_s": found.from_s,
        "to_s": found.to_s,
        "leg": "+".join(leg["kind"] for leg in legs),
        "mode": found.mode,
        "inputs": "+".join(found.inputs),
        "turn_removed": found.turn_removed,
    }
    for method in METHODS:
        estimate = found.estimates.get(method)
        roll = None if estimate is None else estimate.dutch_roll
        yield {"kind": method} | where | judged_answer(roll, known[1], found.verdict)
    own = {} if known[0] is None else numbers_shown(found.answer, float(known[0][0][0]))
    yield (
        {"kind": "manoeuvre"}
        | where
        | judged_answer(found.dutch_roll, known[0], found.verdict)
        | own
    )
    if (bare := found.lateral) is not None:
        of_bare = true_at(truth, found.from_s, found.to_s, BARE)
        yield {"kind": "bare"} | where | judged_answer(bare.dutch_roll, of_bare, bare.verdict)


def _flight_row(summary: RunSummary, truth: Truth, known: Mapping[int, Known | None]) -> Row:
    flight, verdict = summary.flight, summary.deciding
    if flight is None:
        return {"kind": "flight"} | judged_answer(None, None, verdict)
    roll = flight.dutch_roll if verdict.usable else None
    at_speed = flight.airspeed_m_s if {"lines", "manoeuvres"} & truth.keys() else None
    used = [m for m in summary.manoeuvres or [] if m.n in flight.used or not flight.used]
    row: Row = {"kind": "flight"} | judged_answer(roll, _together(used, known, at_speed), verdict)
    row["disagree"] = len(flight.disagree)
    true = truth.get("kappa_rad_m", {}).get(flight.loop)
    if true and flight.kappa_rad_m is not None:
        row |= {"kappa": flight.kappa_rad_m.value, "kappa_sigma": flight.kappa_rad_m.std}
        row["kappa_true"] = true["mean"]
    return row


def _together(
    used: Sequence[Manoeuvre], known: Mapping[int, Known | None], at_speed: float | None
) -> Known | None:
    """Return the mean truth of manoeuvres and its sigma, from their sigmas and their scatter.

    wn is scaled to ``at_speed`` in m/s; with None it is not, as all manoeuvres have one truth. The
    result is None if the truth of a manoeuvre is unknown.
    """
    values, sigmas = [], []
    for each in used:
        one, scale = known[each.n], np.ones(2)
        if one is None:
            return None
        if at_speed and each.airspeed_m_s:
            scale[0] = at_speed / each.airspeed_m_s
        values.append(scale * one[0])
        sigmas.append(scale * one[1])
    squares = np.mean(np.square(sigmas), axis=0) + np.var(values, axis=0)
    return np.mean(values, axis=0), np.sqrt(squares)


def judged_answer(roll: DutchRoll | None, known: Known | None, verdict: Verdict) -> Row:
    """Return verdict, truth, estimate, error (wn's in %), sigmas and z; unknown ones are None.

    ``sigma_mean`` and ``z_mean`` are those of a flight's mean.
    """
    row: Row = {
        "usable": verdict.usable,
        "warnings": " ".join(r.id for r in verdict.reasons if r.weight == "warning"),
        "fatal": " ".join(r.id for r in verdict.fatal),
    }
    keys = ("wn", "wn_rad_s", "wn_error_pct"), ("zeta", "zeta", "zeta_error")
    for i, (name, key, error) in enumerate(keys):
        true, true_sigma = (None, None) if known is None else (float(x[i]) for x in known)
        value = None if roll is None else getattr(roll, key)
        row |= {f"{name}_true": true, f"{name}_true_sigma": true_sigma, name: value, error: None}
        for end in ("", "_mean"):
            sigma = getattr(roll, f"{name}_std{end}", None)
            row |= {f"{name}_sigma{end}": sigma, f"{name}_z{end}": None}
            if value is None or true is None or true_sigma is None:
                continue
            row[error] = 100.0 * (value / true - 1.0) if name == "wn" else value - true
            if sigma is not None and (total := math.hypot(sigma, true_sigma)) > 0.0:
                row[f"{name}_z{end}"] = (value - true) / total
    return row
