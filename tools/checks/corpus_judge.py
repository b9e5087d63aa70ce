"""What yawid says of a log of the corpora, beside what is true, and how often it errs.

To try a criterion: add a function of the finished pipeline and its summary to CRITERIA (a column
of the table), and the rule that would refuse by it to RULES (a line in the counts).
"""

from __future__ import annotations

import json
import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yawid.config.run import RunConfig, check_settings
from yawid.errors import YawidError
from yawid.pipeline import Pipeline
from yawid.results.judge_estimate import judge_methods
from yawid.results.run_summary import RunSummary
from yawid.results.summary import bank_summaries, summarise
from yawid.runs.inspect_log import inspect
from yawid.runs.job import Recording, feed_all, open_log

Row = dict[str, Any]
RIGHT, WRONG, SIGMAS = 0.05, 0.10, 3.0
"""Relative errors of wn: an answer below the first is right, one above the second is wrong."""
LAGS = 4


def _recommended(log: Path) -> RunConfig | None:
    report, _ = inspect(log, {})
    options = {key: value for key, value in report.recommend.items() if key != "record"}
    return RunConfig(**check_settings(options, "inspect")) if options else None


RUNS: dict[str, Callable[[Path], RunConfig | None]] = {
    "default": lambda log: RunConfig(),
    "forgetting": lambda log: RunConfig(forgetting=1.0),
    "rml": lambda log: RunConfig(forgetting=1.0, method="rml", also="els"),
    "remedy": lambda log: RunConfig(forgetting=1.0, turn="remove", band=(0.15, 3.0)),
    "inspect": _recommended,
}
"""What a run's configuration is, None where inspect recommends none; ``remedy`` is what a refusal
of turns advises."""


def finished(log: Path, config: RunConfig) -> tuple[Pipeline, Recording]:
    """Return the pipeline after the whole log, and the log: ``bank.history()`` has its samples."""
    source, pipeline = open_log(log), Pipeline(config)
    feed_all(source, pipeline)
    return pipeline, source


def samples(pipeline: Pipeline) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the rudder and the yaw rate of the longest stretch without a held sample."""
    if pipeline.bank is None:
        return np.empty(0), np.empty(0)
    history = pipeline.bank.history()
    u, y = history.u[:, 0], history.y
    edges = np.flatnonzero(np.diff(np.isfinite(u) & np.isfinite(y))) + 1
    pieces = [
        (a, b)
        for a, b in zip(np.split(u, edges), np.split(y, edges), strict=True)
        if len(a) and math.isfinite(a[0] + b[0])
    ]
    return max(pieces, key=lambda piece: len(piece[0]), default=(np.empty(0), np.empty(0)))


def rudder_ratio(pipeline: Pipeline, summary: RunSummary) -> float:
    """Return 2 log of the likelihood ratio of the rudder against none: ARX of 4 lags by AR of 4."""
    u, y = samples(pipeline)
    if len(y) < 100:
        return math.nan
    rows = len(y) - LAGS
    past = [series[LAGS - 1 - i : LAGS - 1 - i + rows] for series in (y, u) for i in range(LAGS)]
    losses = [
        _loss(np.column_stack([*columns, np.ones(rows)]), y[LAGS:])
        for columns in (past[:LAGS], past)
    ]
    return rows * math.log(losses[0] / losses[1]) if losses[1] > 0.0 else math.nan


def _loss(phi: NDArray[np.float64], y: NDArray[np.float64]) -> float:
    residual = y - phi @ np.linalg.lstsq(phi, y, rcond=None)[0]
    return float(residual @ residual)


CRITERIA: dict[str, Callable[[Pipeline, RunSummary], float]] = {
    "rudder_ratio": rudder_ratio,
}


def _below(name: str, limit: float) -> Callable[[Row], bool]:
    """Return the rule that refuses what is below a limit; absent is not failed."""
    return lambda row: isinstance(row.get(name), float) and row[name] < limit


def _says(*reasons: str) -> Callable[[Row], bool]:
    """Return the rule that refuses where the verdict has all of these reasons."""
    return lambda row: set(reasons) <= set(row["reasons"].split())


RULES: dict[str, Callable[[Row], bool]] = {
    "simulated < 40 or held back < 30": lambda row: (
        _below("simulation_pct", 40.0)(row) or _below("held_back_pct", 30.0)(row)
    ),
    "simulated < 40": _below("simulation_pct", 40.0),
    "held back < 30": _below("held_back_pct", 30.0),
    "coherence below chance": _below("coherence_margin_els", 0.0),
    "rudder_ratio < 50": _below("rudder_ratio", 50.0),
    "wrong_sign": _says("wrong_sign"),
    "els_rml_disagree": _says("els_rml_disagree"),
    "stroke < 10 %": _below("stroke_pct", 10.0),
}
"""What would refuse in addition to today's verdict, tried on the table alone."""


def judged(truth_path: Path, runs: Sequence[str]) -> list[Row]:
    """Return a row for each run of the log beside a truth."""
    truth = json.loads(truth_path.read_text(encoding="utf-8"))
    log = truth_path.with_suffix(".tlog")
    return [_row(log, run, truth) for run in runs]


def _row(log: Path, run: str, truth: dict[str, Any]) -> Row:
    row: Row = {"name": truth["name"], "kind": truth["kind"], "group": truth["group"], "run": run}
    try:
        config = RUNS[run](log)
        if config is None:
            return row | {"usable": False, "reasons": "no_run_recommended"}
        pipeline, source = finished(log, config)
    except YawidError as error:
        return row | {"usable": False, "reasons": type(error).__name__}
    summary, verdict = summarise(pipeline, source.link, str(log), "")
    row |= {"usable": verdict.usable, "reasons": " ".join(r.id for r in verdict.reasons)}
    method = verdict.method or config.method
    row |= {"method": method, "inputs": "+".join(config.inputs)} | _estimates(summary, method)
    # With the aileron as an input the roll hold is outside the model.
    key = "dutch_roll" if config.inputs == ("rudder",) else "dutch_roll_open_loop"
    true = truth.get(key) or {}
    row |= {"true_wn": true.get("wn_rad_s", math.nan), "true_zeta": true.get("zeta", math.nan)}
    answer = _of(summary, method, "dutch_roll", "wn_rad_s")
    if summary.flight is not None:  # then it is the flight that the verdict is of
        roll = summary.flight.dutch_roll
        answer = math.nan if roll is None else roll.wn_rad_s
    row["error"] = answer / row["true_wn"] - 1.0
    row |= {name: find(pipeline, summary) for name, find in CRITERIA.items()}
    row |= _judged_methods(pipeline)
    told = ("aircraft", "severity", "airspeed_m_s", "rate_noise", "manoeuvre", "amplitude")
    row |= {name: truth[name] for name in told if name in truth}
    return {name: _told(value) for name, value in row.items()}


def _judged_methods(pipeline: Pipeline) -> Row:
    """Return what the verdict looks at: own stroke in %, and of each method what speaks against it.

    ``coherence_margin_*`` is by how much the squared coherence at wn exceeds what chance gives.
    """
    bank, intervals = pipeline.bank, pipeline.channels.intervals_us
    if bank is None or intervals is None:
        return {}
    _, evidence = bank_summaries(bank)
    rates_hz = 1e6 / intervals[0], 1e6 / intervals[1]
    judged = judge_methods(bank, evidence, rates_hz)
    row: Row = {"stroke_pct": 100.0 * judged.moved.most_own}
    row["reacts"] = judged.reacts
    for method, reasons in judged.reasons.items():
        found = judged.coherence[method]
        margin = math.nan if found is None else found.squared - found.limit
        row[f"coherence_margin_{method}"] = margin
        row[f"fatal_{method}"] = " ".join(r.id for r in reasons if r.exit_code)
    return row


def _told(value: Any) -> Any:
    if isinstance(value, float):
        return None if not math.isfinite(value) else float(f"{value:.6g}")
    return value


def _estimates(summary: RunSummary, method: str) -> Row:
    """Return the Dutch roll and fits by ELS and RML, the fits of the answering one first."""
    fits = {"simulation_pct": "simulation_pct", "held_back_pct": "simulation_held_back_pct"}
    found: Row = {name: _of(summary, method, "fit", key) for name, key in fits.items()}
    for each in ("els", "rml"):
        for name in ("wn_rad_s", "wn_std", "zeta", "zeta_std"):
            found[f"{name.removesuffix('_rad_s')}_{each}"] = _of(summary, each, "dutch_roll", name)
        found |= {f"{name}_{each}": _of(summary, each, "fit", key) for name, key in fits.items()}
    return found


def _of(summary: RunSummary, method: str, part: str, key: str) -> float:
    found = getattr((summary.estimates or {}).get(method), part, None)
    value: float | None = getattr(found, key, None)
    return math.nan if value is None else value


def counts(rows: Iterable[Row]) -> str:
    """Return how often the verdict errs, each way, as text; and what each of RULES would change."""
    by_run: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        by_run[row["run"]].append(row)
    lines = []
    for run, each in by_run.items():
        lines += [f"== {run}", *_quiet_lines(each), *_excited_lines(each), *_rule_lines(each)]
    return "\n".join(lines)


def table(rows: Iterable[Row]) -> str:
    """Return a Markdown table of both errors, a row for each run."""
    by_run: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        by_run[row["run"]].append(row)
    lines = [
        "| run | usable without excitation | right | right, refused | usable, wrong |",
        "|---|---|---|---|---|",
    ]
    for run, each in by_run.items():
        quiet = [row for row in each if row["kind"] == "unexcited"]
        flights = [row for row in each if row["kind"] == "excited"]
        right = [row for row in flights if _error(row) < RIGHT]
        false = sum(row["usable"] for row in quiet)
        refused = sum(not row["usable"] for row in right)
        wrong = sum(row["usable"] and _error(row) > WRONG for row in flights)
        cells = (f"{false} of {len(quiet)}", f"{len(right)} of {len(flights)}", refused, wrong)
        lines.append(f"| {run} | " + " | ".join(map(str, cells)) + " |")
    return "\n".join(lines)


def _groups(rows: list[Row], kind: str) -> dict[str, list[Row]]:
    found: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        if row["kind"] == kind:
            found[row["group"]].append(row)
    return found


def _quiet_lines(rows: list[Row]) -> list[str]:
    groups = _groups(rows, "unexcited")
    lines = ["unexcited: usable (false) of all"]
    for group, each in groups.items():
        usable = [row["name"] for row in each if row["usable"]]
        lines.append(f"  {group:12} {len(usable):3} of {len(each):3}  {' '.join(usable)}")
    every = [row for each in groups.values() for row in each]
    return [*lines, f"  {'all':12} {sum(row['usable'] for row in every):3} of {len(every):3}"]


def _error(row: Row) -> float:
    return math.inf if row.get("error") is None else abs(row["error"])


def _sigmas(row: Row) -> float:
    """Return by how many of its sigma the answer is wrong."""
    wn, sigma = row[f"wn_{row['method']}"], row[f"wn_std_{row['method']}"]
    return math.inf if not sigma else abs(wn - row["true_wn"]) / float(sigma)


def _excited_lines(rows: list[Row]) -> list[str]:
    lines = [
        "excited: flights; right (error < 5 %); right, refused; usable, wrong; by > 3 sigma too"
    ]
    groups = dict(sorted(_groups(rows, "excited").items()))
    for group, each in {**groups, "all": [row for g in groups.values() for row in g]}.items():
        right = [row for row in each if _error(row) < RIGHT]
        refused = [row for row in right if not row["usable"]]
        wrong = [row["name"] for row in each if row["usable"] and _error(row) > WRONG]
        reasons = sorted({reason for row in refused for reason in row["reasons"].split()})
        far = [row for row in each if row["name"] in wrong and _sigmas(row) > SIGMAS]
        counted = f"{len(each):4} {len(right):4} {len(refused):4} {len(wrong):4} {len(far):4}"
        lines.append(f"  {group:12} {counted}  {' '.join(wrong)}  [{' '.join(reasons)}]")
    return lines


def _rule_lines(rows: list[Row]) -> list[str]:
    lines = ["with one more rule: false usable, right ones refused, wrong ones usable"]
    for name, refuses in {"none": lambda row: False, **RULES}.items():
        usable = [row for row in rows if row["usable"] and not refuses(row)]
        false = sum(row["kind"] == "unexcited" for row in usable)
        flights = [row for row in rows if row["kind"] == "excited"]
        right = sum(_error(row) < RIGHT for row in flights)
        kept = sum(_error(row) < RIGHT for row in usable if row["kind"] == "excited")
        wrong = sum(_error(row) > WRONG for row in usable if row["kind"] == "excited")
        lines.append(f"  {name:34} {false:4} {right - kept:4} {wrong:4}")
    return lines
