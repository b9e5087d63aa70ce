"""Fly whole flights, replay each with the default options, count what is found and how right it is.

    python -m checks.judge_manoeuvres upset [--seeds 100] [--keep DIR] [--workers 1]
    python -m checks.judge_manoeuvres speeds [--seeds 4] [--severities 0,1,2,3,4] [--keep DIR]

``upset``: gusts, a go-around and a landing in turbulence, nothing moved on purpose: a usable
manoeuvre is a false one. ``speeds``: the plan three_speeds in turbulence of each severity: every
manoeuvre against the truth at the airspeed flown, the flight's answer too. With ``--keep`` flights
stay in DIR and are not flown again.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from flights.flight import FlightError, FlightPlan
from flights.guided import LegFlight, leg_truth
from flights.legs import PLANS, LegPlan
from flights.surgery import join
from flights.telemetry import FOOT, KNOT, Link, telemetry
from flights.truth import yaw_channels

from checks.corpus import in_processes
from yawid.config.run import RunConfig
from yawid.pipeline import Pipeline
from yawid.results.run_summary import Flight, Manoeuvre, RunSummary
from yawid.results.summary import summarise
from yawid.runs.job import feed_all, open_log

Row = dict[str, Any]
Task = tuple[int, int]
"""The severity of the turbulence (of ``upset`` its plan's own: 0) and the seed."""
WN, ZETA, FAIR, WRONG = 0.02, 0.02, 0.05, 0.10
"""Right is within the first two, fair and wrong are of wn alone."""
LOWEST_FT = 200.0
"""At which a truth is linearised for what is found near the ground."""


def flown(folder: Path, name: str, plan: LegPlan, seed: int) -> Path:
    """Return the log of a flight, its truth beside it; fly it where it is not there yet."""
    log = folder / f"{name}.tlog"
    truth = log.with_suffix(".truth.json")
    if not truth.exists():  # written last: who has it has the whole log
        link = Link(seed=seed)
        flight = LegFlight(plan, seed)
        log.write_bytes(join(telemetry(plan.trim_plan(), link, flight)))
        truth.write_text(json.dumps(leg_truth(plan, link, flight), indent=1) + "\n")
    return log


def turbulent(plan: LegPlan, severity: int) -> LegPlan:
    """Return the plan in turbulence of one severity throughout."""
    return replace(plan, legs=tuple(replace(leg, severity=severity) for leg in plan.legs))


def replayed(log: Path) -> RunSummary:
    """Return the summary of a log with the default options."""
    source, pipeline = open_log(log), Pipeline(RunConfig())
    feed_all(source, pipeline)
    return summarise(pipeline, source.link, str(log), "")[0]


def judge_upset(folder: Path, task: Task) -> list[Row]:
    """Fly one upset; return a row for each manoeuvre found, with the truth where it is usable.

    A replay that breaks off is a row too, and the others are still judged.
    """
    seed = task[1]
    log = flown(folder, f"upset_{seed:03d}", PLANS["upset"], seed)
    truth = json.loads(log.with_suffix(".truth.json").read_text())
    rows = []
    try:
        summary = replayed(log)
    except Exception as error:  # whatever it is, it is to be counted
        return [{"seed": seed, "usable": False, "reasons": repr(error), "broken": True}]
    for found in summary.manoeuvres or []:
        true = _linearised(found) if found.verdict.usable else None
        rows.append({"seed": seed} | _told(found, truth["legs"], true))
    return rows


def judge_speeds(folder: Path, task: Task) -> list[Row]:
    """Fly the three speeds once; return a row a manoeuvre, found or missed, then the flight's.

    What is found of a manoeuvre is that of its truth where the two overlap.
    """
    severity, seed = task
    plan = turbulent(PLANS["three_speeds"], severity)
    log = flown(folder, f"three_speeds_s{severity}_{seed:03d}", plan, seed)
    truth = json.loads(log.with_suffix(".truth.json").read_text())
    rows = compared(replayed(log), truth)
    return [{"severity": severity, "seed": seed} | row for row in rows]


def compared(summary: RunSummary, truth: dict[str, Any]) -> list[Row]:
    """Return the rows of one flight, see :func:`judge_speeds`."""
    rows, missed = [], {each["n"]: each for each in truth["manoeuvres"]}
    for found in summary.manoeuvres or []:
        of = next((m for m in truth["manoeuvres"] if _overlap(found, m)), None)
        row = _told(found, truth["legs"], of and _true(of, found.inputs))
        rows.append({"what": "found", "of": of and of["n"]} | row)
        if of is not None:
            missed.pop(of["n"], None)
    rows += [{"what": "missed", "of": n, "leg": each["kind"]} for n, each in missed.items()]
    return [*rows, {"what": "flight"} | _flight_row(summary.flight, truth)]


def _overlap(found: Manoeuvre, of: dict[str, Any]) -> bool:
    return bool(found.from_s < of["to_s"] and of["from_s"] < found.to_s)


def _true(of: dict[str, Any], inputs: Sequence[str]) -> Row:
    """Return the Dutch roll to be found: with the aileron as input the roll hold is outside."""
    return dict(of["airframe"] if "aileron" in inputs else of["dutch_roll"])


def _linearised(found: Manoeuvre) -> Row | None:
    """Return the c172p's Dutch roll where a manoeuvre was found, None where it does not fly."""
    if found.airspeed_m_s is None or found.altitude_m is None:
        return None
    feet = max(found.altitude_m / FOOT, LOWEST_FT)
    plan = FlightPlan(speed_kt=found.airspeed_m_s / KNOT, altitude_ft=feet)
    try:
        modes = yaw_channels(plan)
    except FlightError:
        return None
    return modes["with_roll_loop" if found.loop == "with_roll_loop" else "airframe"]


def _told(found: Manoeuvre, legs: list[dict[str, Any]], true: Row | None) -> Row:
    """Return what is said of a manoeuvre and what is true of it."""
    mode = found.dutch_roll
    row: Row = {
        "n": found.n,
        "from": found.from_s,
        "to": found.to_s,
        "leg": "+".join(leg["kind"] for leg in legs if _overlap(found, leg)),
        "mode": found.mode,
        "airspeed": found.airspeed_m_s,
        "inputs": "+".join(found.inputs),
        "wn": mode and mode.wn_rad_s,
        "wn_std": mode and mode.wn_std,
        "zeta": mode and mode.zeta,
        "zeta_std": mode and mode.zeta_std,
        "usable": found.verdict.usable,
        "reasons": " ".join(reason.id for reason in found.verdict.reasons),
    }
    return row | _against(row, true)


def _against(row: Row, true: Row | None) -> Row:
    if true is None:
        return {}
    told = {"true_wn": true["wn_rad_s"], "true_zeta": true["zeta"]}
    if row["wn"] is not None:
        told["wn_off"] = row["wn"] / true["wn_rad_s"] - 1.0
        told["zeta_off"] = row["zeta"] - true["zeta"]
    return told


def _flight_row(flight: Flight | None, truth: dict[str, Any]) -> Row:
    """Return the flight's answer beside the truth at its airspeed, between the manoeuvres'."""
    if flight is None or flight.dutch_roll is None or flight.airspeed_m_s is None:
        return {"usable": False}
    mode, kappa, V = flight.dutch_roll, flight.kappa_rad_m, flight.airspeed_m_s
    row: Row = {
        "usable": flight.verdict.usable,
        "reasons": " ".join(reason.id for reason in flight.verdict.reasons),
        "loop": flight.loop,
        "airspeed": V,
        "used": flight.used,
        "disagree": flight.disagree,
        "wn": mode.wn_rad_s,
        "wn_std": mode.wn_std,
        "zeta": mode.zeta,
        "zeta_std": mode.zeta_std,
        "kappa": kappa and kappa.value,
        "kappa_std": kappa and kappa.std,
    }
    loop = flight.loop if flight.loop in ("airframe", "with_roll_loop") else None
    if loop is None:
        return row
    told = sorted((m["airspeed_m_s"], *m[loop].values()) for m in truth["manoeuvres"])
    speeds, wn, zeta = np.array(told)[:, :3].T
    true = {"wn_rad_s": float(np.interp(V, speeds, wn)), "zeta": float(np.interp(V, speeds, zeta))}
    row |= {"true_kappa": truth["kappa_rad_m"][loop]["mean"]} | _against(row, true)
    if row["kappa"] is not None:
        row["kappa_off"] = row["kappa"] / row["true_kappa"] - 1.0
    return row


def listed(rows: Sequence[Row], first: Sequence[str]) -> Iterator[str]:
    """Yield a line for each manoeuvre found, ``first`` naming what says where."""
    names = (*first, "n", "from", "to", "leg", "mode", "airspeed", "wn", "zeta")
    names = (*names, "true_wn", "true_zeta", "usable", "reasons")
    yield " ".join(names)
    for row in rows:
        yield " ".join(_text(row.get(name)) for name in names)


def _text(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    return "-" if value is None or value == "" else str(value)


def upset_lines(rows: Sequence[Row], flights: int) -> Iterator[str]:
    """Yield every manoeuvre found in upset flights and how many are usable."""
    yield from listed(rows, ("seed",))
    usable = [row for row in rows if row["usable"]]
    seeds = {row["seed"] for row in usable}
    broken = sum("broken" in row for row in rows)
    found = f"{len(rows) - broken} found, {len(usable)} usable in {len(seeds)} flights"
    yield f"{flights} flights: {found}, {broken} replays broke off"
    wrong = [row for row in usable if abs(row.get("wn_off", np.inf)) > WRONG]
    yield f"of those {len(wrong)} are off by more than {WRONG:.0%} in wn, or nothing is true there"


def speeds_lines(rows: Sequence[Row]) -> Iterator[str]:
    """Yield a Markdown table of manoeuvres, then one of flights, a row for each severity."""
    by: dict[int, list[Row]] = defaultdict(list)
    for row in rows:
        by[row["severity"]].append(row)
    yield "| severity | flown | missed | elsewhere | refused | right | fair | neither | wrong |"
    yield "|---" * 9 + "|"
    for severity, each in by.items():
        yield f"| {severity} | " + " | ".join(map(str, counts(each))) + " |"
    yield ""
    yield "| severity | flights | usable | wn off | zeta off | kappa off | off / sigma | disagree |"
    yield "|---" * 8 + "|"
    for severity, each in by.items():
        flights = [row for row in each if row["what"] == "flight"]
        yield f"| {severity} | " + " | ".join(map(str, _flight_cells(flights))) + " |"


def counts(rows: Sequence[Row]) -> tuple[int, ...]:
    """Return how many manoeuvres were flown, missed, found elsewhere, refused, and how right.

    Each that is usable is right (2 % and .02), fair (wn within 5 %), wrong (off by more than 10 %)
    or neither.
    """
    found = [row for row in rows if row["what"] == "found"]
    missed = sum(row["what"] == "missed" for row in rows)
    flown_ones = {(row["seed"], row["of"]) for row in rows if row.get("of") is not None}
    own = [row for row in found if row["of"] is not None]
    usable = [row for row in own if row["usable"]]
    kinds = [_kind(row) for row in usable]
    told = [kinds.count(kind) for kind in ("right", "fair", "neither", "wrong")]
    return len(flown_ones), missed, len(found) - len(own), len(own) - len(usable), *told


def _kind(row: Row) -> str:
    wn, zeta = abs(row.get("wn_off", np.inf)), abs(row.get("zeta_off", np.inf))
    if wn <= WN and zeta <= ZETA:
        return "right"
    return "fair" if wn <= FAIR else "wrong" if wn > WRONG else "neither"


def _flight_cells(flights: Sequence[Row]) -> Iterator[str]:
    usable = [row for row in flights if row["usable"] and "wn_off" in row]
    yield str(len(flights))
    yield str(len(usable))
    for name, form in (("wn_off", "+.1%"), ("zeta_off", "+.3f"), ("kappa_off", "+.1%")):
        yield _span([row[name] for row in usable if name in row], form)
    sigmas = [
        (row[name] - row[f"true_{name}"]) / row[f"{name}_std"]
        for row in usable
        for name in ("wn", "zeta", "kappa")
        if row.get(f"{name}_std")
    ]
    yield _span(sigmas, "+.1f")
    yield str(sum(len(row["disagree"]) for row in usable))


def _span(values: Sequence[float], form: str) -> str:
    return f"{min(values):{form}} to {max(values):{form}}" if values else "-"


def numbers(text: str) -> list[int]:
    """Return whole numbers between commas."""
    return [int(each) for each in text.split(",")]


def parse(argv: Sequence[str]) -> argparse.Namespace:
    """Return the options."""
    parser = argparse.ArgumentParser(
        prog="judge_manoeuvres.py",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(dest="command", required=True)
    upset = commands.add_parser("upset", help="what must not be found")
    upset.add_argument("--seeds", type=int, default=100)
    speeds = commands.add_parser("speeds", help="what must be found, and right")
    speeds.add_argument("--seeds", type=int, default=4, help="of each severity")
    speeds.add_argument("--severities", type=numbers, default=[0, 1, 2, 3, 4], help="0 to 7")
    for command in (upset, speeds):
        command.add_argument("--keep", type=Path, metavar="DIR", help="where the flights stay")
        command.add_argument("--workers", type=int, default=1, help="processes, at most 2")
    options = parser.parse_args(argv)
    if min(options.workers, options.seeds) < 1:
        parser.error("--workers and --seeds must be at least 1")
    return options


def judge(options: argparse.Namespace, folder: Path) -> list[Row]:
    """Return the rows of every flight, in the order of severity and seed."""
    one: Callable[[Path, Task], list[Row]] = judge_speeds
    tasks = [(s, n + 1) for s in getattr(options, "severities", [0]) for n in range(options.seeds)]
    if options.command == "upset":
        one = judge_upset
    rows = []
    for number, found in enumerate(in_processes(partial(one, folder), tasks, options.workers), 1):
        rows += found
        print(f"\r{number} of {len(tasks)} ", end="", file=sys.stderr, flush=True)
    return rows


def main(argv: Sequence[str]) -> int:
    """Fly, replay, print; return 0."""
    options = parse(argv)
    with tempfile.TemporaryDirectory() as scratch:
        folder = options.keep or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        rows = judge(options, folder)
    if options.command == "upset":
        lines = upset_lines(rows, options.seeds)
    else:
        found = [row for row in rows if row["what"] == "found"]
        print("\n".join(listed(found, ("severity", "seed", "of"))) + "\n")
        lines = speeds_lines(rows)
    print("\n".join(lines))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
