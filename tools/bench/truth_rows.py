"""What yawid answers of a log beside what is true: a row for each estimate, for bench.py truth."""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from cases.recipes import Made
from checks.corpus_judge import finished
from flights.grid import dutch_roll_at, flight
from numpy.typing import NDArray

from yawid.config.run import RunConfig
from yawid.errors import YawidError
from yawid.results.run_summary import DutchRoll, Manoeuvre, RunSummary, VerdictSummary
from yawid.results.summary import summarise

Row = dict[str, Any]
Floats = NDArray[np.float64]
Known = tuple[Floats, Floats]
"""True wn in rad/s and zeta (2,), and their sigmas (2,)."""
ROOT = Path(__file__).resolve().parents[2]
CASES = ROOT / "replay_logs"
METHODS = ("rml", "els")
MEMORY_S = 60.0
"""The default memory: what the stream's estimate at its end is of."""
CONDITIONS = (
    "number", "aircraft", "speed_kt", "manoeuvre", "severity", "gyro", "rate_hz", "amplitude",
    "seconds",
)  # fmt: skip
SAME_AIRCRAFT = {
    "sitl_fbwa_50hz": "sitl_fbwa_50hz",
    "sitl_fbwa_stock_33hz": "sitl_fbwa_stock_33hz",
    "sitl_fbwa_gcs_4hz": "sitl_fbwa_50hz",
}
"""The case whose truth.json holds for a recorded flight."""
SUFFIXES = (".tlog", ".ulg", ".bin")


def flight_rows(folder: Path, seed: int, number: int) -> list[Row]:
    """Return the rows of one flight of the bench; fly it where it is not in the folder yet.

    Raises:
        SystemExit: the flight of that name is another one.
    """
    log, told = folder / f"{number:03d}.tlog", folder / f"{number:03d}.json"
    if not told.exists():  # written last: who has it has the whole log
        made: Made = flight(seed, number)
        log.write_bytes(made.log)
        told.write_text(json.dumps(made.truth), encoding="utf-8")
    truth = json.loads(told.read_text(encoding="utf-8"))
    if (truth["seed"], truth["number"]) != (seed, number):
        raise SystemExit(f"{told} is flight {truth['number']} of seed {truth['seed']}, not {seed}")
    conditions = {name: truth[name] for name in CONDITIONS}
    end_s = truth["flown"][-1][0]
    return [conditions | row for row in compared(replayed(log, RunConfig()), truth, end_s)]


def record_rows(log: Path) -> list[Row]:
    """Return the rows of a recorded flight or of a case's log, with its name.

    A log that cannot be read is a row too: its ``fatal`` is the error.
    """
    of_case = log.name == "log.tlog"
    name = log.parent.name if of_case else log.stem
    path = CASES / (name if of_case else SAME_AIRCRAFT.get(name, name)) / "truth.json"
    known = path.exists() and (of_case or name in SAME_AIRCRAFT)
    truth = json.loads(path.read_text(encoding="utf-8")) if known else {}
    told = {"record": name, "from": "replay_logs" if of_case else "records"}
    try:
        summary = replayed(log, _default(log))
    except YawidError as error:
        verdict = VerdictSummary(usable=False, reasons=[])
        broken = {"kind": "flight"} | _told(None, None, verdict) | {"fatal": type(error).__name__}
        return [told | broken]
    return [told | row for row in compared(summary, truth, None)]


def _default(log: Path) -> RunConfig:
    """Return the default options, and which vehicle where its case says so."""
    case = log.with_name("case.toml")
    options = tomllib.loads(case.read_text(encoding="utf-8"))["options"] if case.exists() else {}
    return RunConfig(sysid=options.get("sysid"))


def records(folder: Path) -> list[Path]:
    """Return the logs with a truth in replay_logs, then those of a folder, which may be absent."""
    cases = sorted(path.with_name("log.tlog") for path in CASES.glob("*/truth.json"))
    flown = sorted(path for path in folder.glob("*") if path.suffix in SUFFIXES)
    return cases + flown


def replayed(log: Path, config: RunConfig) -> RunSummary:
    """Return the summary of a log."""
    pipeline, source = finished(log, config)
    return summarise(pipeline, source.link, str(log), "")[0]


def true_at(
    truth: dict[str, Any], from_s: float, to_s: float, inputs: Sequence[str]
) -> Known | None:
    """Return what is true between two boot times, None where it is not known.

    ``truth`` is that of truth_flights.py or a truth.json, whose manoeuvres may have their own. With
    the aileron as an input the roll hold is outside the model: then the bare airframe is true.
    """
    bare = "aileron" in inputs
    if "line" in truth:
        return None if bare else dutch_roll_at(truth, from_s, to_s)
    of = truth
    if "manoeuvres" in truth:
        meant = (m for m in truth["manoeuvres"] if m["from_s"] < to_s and from_s < m["to_s"])
        of = next(meant, {})
    names = ("airframe", "dutch_roll_open_loop") if bare else ("dutch_roll",)
    mode = next((of[name] for name in names if name in of), None)
    if mode is None:
        return None
    value = np.array([mode["wn_rad_s"], mode["zeta"]])
    if "wn_std" in mode:
        return value, np.array([mode["wn_std"], mode["zeta_std"]])
    seen = None if bare else of.get("dutch_roll_pulse")
    pulse = value if seen is None else np.array([seen["wn_rad_s"], seen["zeta"]])
    return value, np.abs(pulse - value)


def compared(summary: RunSummary, truth: dict[str, Any], end_s: float | None) -> list[Row]:
    """Return a row for each estimate: of every manoeuvre, of the flight, and of the stream's end.

    ``end_s`` is the boot time at which the stream ends; without it there are no rows of the stream.
    The flight's row is that of the deciding verdict: of the stream where no manoeuvre was found.
    Its estimate is absent where it is refused.
    """
    rows: list[Row] = []
    known: dict[int, Known | None] = {}
    for found in summary.manoeuvres or []:
        known[found.n] = true_at(truth, found.from_s, found.to_s, found.inputs)
        rows += _manoeuvre_rows(found, known[found.n])
    at_end = None if end_s is None else true_at(truth, end_s - MEMORY_S, end_s, ("rudder",))
    of_all, flight, verdict = at_end, summary.flight, summary.deciding
    roll = summary.dutch_roll if verdict.usable else None
    if flight is not None:
        roll = flight.dutch_roll if verdict.usable else None
        at_speed = flight.airspeed_m_s if {"line", "manoeuvres"} & truth.keys() else None
        used = [m for m in summary.manoeuvres or [] if m.n in flight.used or not flight.used]
        of_all = _together(used, known, at_speed)
    rows.append({"kind": "flight", "answers": True} | _told(roll, of_all, verdict))
    if end_s is not None:
        for method in METHODS:
            estimate = (summary.estimates or {}).get(method)
            roll = None if estimate is None else estimate.dutch_roll
            answers = {"answers": method == summary.answering}
            told = _told(roll, at_end, summary.verdict)
            rows.append({"kind": f"stream {method}"} | answers | told)
    return rows


def _manoeuvre_rows(found: Manoeuvre, known: Known | None) -> list[Row]:
    rows = []
    for method in METHODS:
        estimate = found.estimates.get(method)
        row: Row = {
            "kind": method,
            "n": found.n,
            "from_s": found.from_s,
            "to_s": found.to_s,
            "inputs": "+".join(found.inputs),
            "answers": method == found.verdict.method,
        }
        roll = None if estimate is None else estimate.dutch_roll
        rows.append(row | _told(roll, known, found.verdict))
    return rows


def _together(
    used: Sequence[Manoeuvre], known: Mapping[int, Known | None], at_speed: float | None
) -> Known | None:
    """Return the mean truth of manoeuvres and its sigma: that of each, and how they scatter.

    wn is scaled to an airspeed in m/s, unless the truth is one for all of them: None.
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


def _told(roll: DutchRoll | None, known: Known | None, verdict: VerdictSummary) -> Row:
    """Return verdict, truth, estimate, error in %, sigmas and z; None for what there is not."""
    row: Row = {
        "usable": verdict.usable,
        "warnings": " ".join(r.id for r in verdict.reasons if r.weight == "warning"),
        "fatal": " ".join(r.id for r in verdict.fatal),
    }
    for i, (name, key) in enumerate((("wn", "wn_rad_s"), ("zeta", "zeta"))):
        true, true_sigma = (None, None) if known is None else (float(x[i]) for x in known)
        value = None if roll is None else getattr(roll, key)
        sigma = None if roll is None else getattr(roll, f"{name}_std")
        noise = None if roll is None else getattr(roll, f"{name}_std_noise")
        noise = sigma if noise is None else noise
        row |= {f"{name}_true": true, f"{name}_true_sigma": true_sigma}
        row |= {name: value, f"{name}_sigma": sigma, f"{name}_sigma_noise": noise}
        row |= {f"{name}_error_pct": None, f"{name}_z": None, f"{name}_z_noise": None}
        if value is None or true is None or true_sigma is None:
            continue
        row[f"{name}_error_pct"] = 100.0 * (value / true - 1.0)
        for what, of in (("z", sigma), ("z_noise", noise)):
            if of is not None and (total := math.hypot(of, true_sigma)) > 0.0:
                row[f"{name}_{what}"] = (value - true) / total
    return row
