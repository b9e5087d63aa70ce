"""Flies JSBSim's aircraft in all conditions, and compares estimate and sigma with the truth.

    python tools/bench.py truth [--seed 162] [--flights N] [--logs DIR] [--jobs 2]
                                [--csv FILE] [--readme]

The flights are the grid of flights/moved.py, replayed with the default options; with --logs they
stay in DIR and are not flown again. Below the tables of the READMEs come the criteria and the worst
answer of each aircraft. (Recorded flights: the bench ``real``.)
The exit code is 1 if a criterion is not met. --csv has a row for each flight and estimate.

z is (estimate - truth) / sqrt(sigma^2 + sigma of the truth^2). The figures of the answer, of RML
and of ELS are over all usable manoeuvres, each compared with the truth at the airspeed at which it
was flown. The answer is output error's in calm air, else RML's.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from checks.judge import METHODS, Row, folder_of, in_processes, judged, kept, options_of, write_csv
from flights.moved import COUNT, GYROS, PLACES, RATES_HZ, SEVERITIES, SHAPES, TABLE, of_grid

CONDITIONS = (
    "number", "aircraft", "speed_kt", "manoeuvre", "severity", "gyro", "rate_hz", "amplitude",
    "seconds",
)  # fmt: skip
STRIDE = 97
"""Step between the numbers of the flights flown; coprime to COUNT, so that a few mix all
conditions."""
RIGHT_PCT, WRONG_PCT, WRONG_Z = 1.0, 3.0, 4.0
"""Limits of wn's error: below RIGHT_PCT no warning is due; above both WRONG_PCT and WRONG_Z (in
sigmas) a warning or a refusal is."""
Z_FROM, Z_TO = 0.7, 1.4
COVERED_PCT = 90.0
ANSWERED_PCT = {"calm": 90.0, "turbulence": 60.0}
SIGMA_PCT = {"calm": 1.5, "turbulence": 4.0}
SILENT_PCT, WARNED_PCT = 80.0, 90.0
COLUMNS = ("flights", "answered %", "off %", "mean %", "sigma %", "z wn", "z zeta", "in 2 sigma %")
"""``off`` is the median size of wn's error, ``mean`` its mean with its sign, ``sigma`` the median
of wn's sigma, ``z`` the root mean square of z; the last column is of wn and zeta."""
KINDS = {"manoeuvre": "answer"} | {method: method.upper() for method in METHODS}
"""The kinds of rows that the criteria judge, and their names."""
TABLED = ("manoeuvre", "rml")
"""The kinds of rows that the tables show."""
NEEDED = (
    "",
    f"calm {ANSWERED_PCT['calm']:g}, else {ANSWERED_PCT['turbulence']:g}",
    "",
    "",
    f"calm {SIGMA_PCT['calm']:g}, else {SIGMA_PCT['turbulence']:g}",
    f"{Z_FROM:g} to {Z_TO:g}",
    f"{Z_FROM:g} to {Z_TO:g}",
    f"{COVERED_PCT:g}",
)
Criterion = tuple[str, str, str, bool]
"""A criterion: its name, what is needed, what was measured, and whether it is met."""


def _where(name: str, value: object) -> Callable[[Row], bool]:
    return lambda row: row.get(name) == value


GROUPS: dict[str, Callable[[Row], bool]] = {
    "all": lambda row: True,
    "calm": _where("severity", 0),
    "turbulence": lambda row: row["severity"] > 0,
    **{f"severity {severity}": _where("severity", severity) for severity in SEVERITIES[1:]},
    **{f"{gyro} gyro": _where("gyro", gyro) for gyro in GYROS},
    **{f"{hz} Hz": _where("rate_hz", hz) for hz in RATES_HZ},
    **{shape: _where("manoeuvre", shape) for shape in SHAPES},
    **{name: _where("aircraft", name) for name in dict.fromkeys(place[0] for place in PLACES)},
}


def of_kind(rows: Iterable[Row], *kinds: str) -> list[Row]:
    """Return the rows of these kinds of estimate."""
    return [row for row in rows if row["kind"] in kinds]


def estimates(rows: Iterable[Row], kind: str) -> list[Row]:
    """Return the usable rows of one kind whose estimate has a known truth."""
    return [row for row in of_kind(rows, kind) if row["usable"] and row["wn_error_pct"] is not None]


def rms(rows: Iterable[Row], name: str) -> float:
    """Return the root mean square of a column over the rows that have it; NaN without any."""
    known = [row[name] for row in rows if row[name] is not None]
    return math.sqrt(sum(x * x for x in known) / len(known)) if known else math.nan


def within(rows: Sequence[Row], name: str) -> float:
    """Return how many % of the rows have |z| of at most 2; an unknown z counts as more."""
    hits = sum(row[name] is not None and abs(row[name]) <= 2.0 for row in rows)
    return 100.0 * hits / len(rows) if rows else math.nan


def sigma_pct(rows: Iterable[Row]) -> float:
    """Return the median sigma of wn in % of wn."""
    known = [100.0 * row["wn_sigma"] / row["wn"] for row in rows if row["wn_sigma"] is not None]
    return float(np.median(known)) if known else math.nan


def mean_pct(rows: Sequence[Row]) -> float:
    """Return the mean error of wn in %, with its sign."""
    return sum(row["wn_error_pct"] for row in rows) / len(rows) if rows else math.nan


def answered_pct(rows: Iterable[Row]) -> float:
    """Return how many % of the flights have a usable answer."""
    flights = of_kind(rows, "flight")
    usable = sum(row["usable"] for row in flights)
    return 100.0 * usable / len(flights) if flights else math.nan


def cells(rows: Sequence[Row], kinds: Sequence[str], z: str = "z") -> list[str]:
    """Return the last six of COLUMNS, each cell with the kinds of estimate side by side."""
    each = [estimates(rows, kind) for kind in kinds]
    off = [[abs(row["wn_error_pct"]) for row in e] for e in each]
    return [
        _side_by_side("{:.2f}", (float(np.median(o)) if o else math.nan for o in off)),
        _side_by_side("{:+.2f}", map(mean_pct, each)),
        _side_by_side("{:.2f}", map(sigma_pct, each)),
        _side_by_side("{:.2f}", (rms(e, f"wn_{z}") for e in each)),
        _side_by_side("{:.2f}", (rms(e, f"zeta_{z}") for e in each)),
        _side_by_side("{}", (f"{within(e, f'wn_{z}'):.0f} {within(e, f'zeta_{z}'):.0f}"
                             for e in each)),
    ]  # fmt: skip


def _side_by_side(form: str, values: Iterable[object]) -> str:
    return (
        " / ".join(form.format(value) for value in values).replace("+nan", "-").replace("nan", "-")
    )


def _line(first: str, others: Iterable[object]) -> str:
    return f"| {first} | " + " | ".join(map(str, others)) + " |"


def condition_line(name: str, rows: Sequence[Row]) -> str:
    """Return the line of one condition."""
    flights = len(of_kind(rows, "flight"))
    counted = [str(flights), f"{answered_pct(rows):.0f}".replace("nan", "-")]
    return _line(name, [*counted, *cells(rows, TABLED)])


def condition_lines(first: str, rows: Sequence[Row], names: Iterable[str]) -> Iterator[str]:
    """Yield a table with a row for each condition, answer / RML."""
    yield f"|{first}| " + " | ".join(COLUMNS) + " |"
    yield "|---" * (1 + len(COLUMNS)) + "|"
    for name in names:
        if some := [row for row in rows if GROUPS[name](row)]:
            yield condition_line(name, some)


def across_lines(rows: Sequence[Row], names: Sequence[str]) -> Iterator[str]:
    """Yield a table of the answer alone, with a column for each condition."""
    short = [name.replace("severity", "s").removesuffix(" gyro").replace(" ", "") for name in names]
    yield "|answer|" + "|".join(short) + "|"
    yield "|---" * (1 + len(names)) + "|"
    columns = [cells([row for row in rows if GROUPS[name](row)], TABLED[:1]) for name in names]
    for name, values in zip(COLUMNS[2:], zip(*columns, strict=True), strict=True):
        yield (
            f"|{name}|"
            + "|".join(each.removeprefix("0").replace(" ", ",") for each in values)
            + "|"
        )


def worst_lines(rows: Sequence[Row]) -> Iterator[str]:
    """Yield a table with a row for each aircraft: mean and median size of wn's error, the worst."""
    yield "| aircraft | answers | mean % | off % | the worst answer |"
    yield "|---|---|---|---|---|"
    for name in dict.fromkeys(place[0] for place in PLACES):
        if some := estimates([row for row in rows if row["aircraft"] == name], "manoeuvre"):
            off = [abs(row["wn_error_pct"]) for row in some]
            bad = some[int(np.argmax(off))]
            said = (
                f"{bad['wn_error_pct']:+.1f} %, zeta {bad['zeta'] - bad['zeta_true']:+.3f}: flight "
                f"{bad['number']}, {bad['manoeuvre']}, severity {bad['severity']}, {bad['gyro']} "
                f"gyro, {bad['rate_hz']} Hz, at {bad['from_s']:.0f} s"
            )
            cells = len(some), f"{mean_pct(some):+.2f}", f"{float(np.median(off)):.2f}", said
            yield _line(name, cells)


def _wrong(row: Row) -> bool:
    error, z = row["wn_error_pct"], row["wn_z"]
    return error is not None and abs(error) > WRONG_PCT and (z is None or abs(z) > WRONG_Z)


def _right(row: Row) -> bool:
    return row["wn_error_pct"] is not None and abs(row["wn_error_pct"]) < RIGHT_PCT


def _share(hits: Sequence[Row], of: Sequence[Row]) -> tuple[str, float]:
    """Return a share as text and in %; it is 100 % if ``of`` is empty."""
    share = 100.0 * len(hits) / len(of) if of else 100.0
    return f"{share:.0f} % ({len(hits)} of {len(of)})", share


def warning_criteria(rows: Sequence[Row]) -> Iterator[Criterion]:
    """Yield the criteria of warnings by flights; then the same by manoeuvres, for comparison.

    A refused flight counts as wrong if any of its manoeuvres is wrong by its answering method.
    """
    manoeuvres = of_kind(rows, "manoeuvre")
    would = {row["number"] for row in manoeuvres if _wrong(row)}
    flights = of_kind(rows, "flight")
    for name, each in (("flights", flights), ("manoeuvres", manoeuvres)):
        right = [row for row in each if row["usable"] and _right(row)]
        wrong = [
            row
            for row in each
            if _wrong(row) or (name == "flights" and not row["usable"] and row["number"] in would)
        ]
        silent, silent_pct = _share([row for row in right if not row["warnings"]], right)
        seen = [row for row in wrong if row["warnings"] or not row["usable"]]
        warned, warned_pct = _share(seen, wrong)
        counts = name == "flights"
        needed = f">= {SILENT_PCT:g} %", f">= {WARNED_PCT:g} %"
        silent_met, warned_met = silent_pct >= SILENT_PCT, warned_pct >= WARNED_PCT
        yield (f"{name} less than {RIGHT_PCT:g} % off: no warning",
               needed[0] if counts else "", silent, silent_met or not counts)  # fmt: skip
        yield (f"{name} off by {WRONG_PCT:g} % and {WRONG_Z:g} sigma: warned or refused",
               needed[1] if counts else "", warned, warned_met or not counts)  # fmt: skip


def criteria(rows: Sequence[Row]) -> Iterator[Criterion]:
    """Yield all criteria."""
    air = {name: [row for row in rows if GROUPS[name](row)] for name in ANSWERED_PCT}
    for name, least in ANSWERED_PCT.items():
        share = answered_pct(air[name])
        yield f"answered, {name}", f">= {least:g} %", f"{share:.1f} %", share >= least
    for kind, called in KINDS.items():
        each = estimates(rows, kind)
        for what in ("wn", "zeta"):
            z, noise = rms(each, f"{what}_z"), rms(each, f"{what}_z_noise")
            said = f"{z:.2f} (noise alone {noise:.2f})"
            met = Z_FROM <= z <= Z_TO
            yield f"{called}, RMS z of {what}", f"{Z_FROM:g} to {Z_TO:g}", said, met
        for what in ("wn", "zeta"):
            share, noise = within(each, f"{what}_z"), within(each, f"{what}_z_noise")
            said = f"{share:.1f} % (noise alone {noise:.1f} %)"
            met = share >= COVERED_PCT
            yield f"{called}, {what} within 2 sigma", f">= {COVERED_PCT:g} %", said, met
        for name, most in SIGMA_PCT.items():
            sigma = sigma_pct(estimates(air[name], kind))
            what = f"{called}, median sigma of wn, {name}"
            # RML and ELS check the answer: their sigmas may be large if they are right.
            needed = f"<= {most:g} %" if called == "answer" else ""
            yield what, needed, f"{sigma:.2f} %", sigma <= most or not needed
    yield from warning_criteria(rows)


def criteria_lines(found: Sequence[Criterion]) -> Iterator[str]:
    """Yield the table of criteria."""
    yield "| criterion | needed | measured | met |"
    yield "|---|---|---|---|"
    for what, needed, said, met in found:
        yield _line(what, (needed, said, ("yes" if met else "NO") if needed else ""))


def flight_rows(folder: Path, seed: int, number: int) -> list[Row]:
    """Return the rows of one flight of the grid; fly it if the folder does not have it yet.

    Raises:
        SystemExit: the folder has another flight of that name.
    """
    log, truth = kept(folder, f"{number:03d}", partial(of_grid, seed, number))
    if (truth["seed"], truth["number"]) != (seed, number):
        raise SystemExit(f"{log} is flight {truth['number']} of seed {truth['seed']}, not {seed}")
    conditions = {name: truth[name] for name in CONDITIONS}
    return [conditions | row for row in judged(log, truth)]


def parse(arguments: list[str]) -> argparse.Namespace:
    """Return the options."""
    parser = argparse.ArgumentParser(
        prog="bench.py truth",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--seed", type=int, default=TABLE)
    parser.add_argument("--flights", type=int, default=COUNT, help=f"1 to {COUNT}: fewer, mixed")
    options_of(parser)
    parser.add_argument("--csv", type=Path, metavar="FILE", help="every row")
    options = parser.parse_args(arguments)
    if not 1 <= options.flights <= COUNT or options.jobs < 1:
        parser.error(f"--flights must be 1 to {COUNT}, --jobs 1 or 2")
    return options


def main(arguments: list[str]) -> Generator[str, None, str | None]:
    """Yield two tables of tools/README.md, that of README.md and the others, blank lines between.

    Return which criteria are not met, None if all are.
    """
    options = parse(arguments)
    numbers = sorted(i * STRIDE % COUNT for i in range(options.flights))
    with folder_of(options.logs) as folder:
        rows = in_processes(partial(flight_rows, folder, options.seed), numbers, options.jobs)
    if options.csv:
        write_csv(options.csv, rows)
    found = list(criteria(rows))
    air = ("all", *ANSWERED_PCT)
    yield from condition_lines(" ", rows, air)
    yield _line("needed", NEEDED)
    yield ""
    yield from across_lines(rows, [name for name in GROUPS if name not in air])
    yield ""
    yield from condition_lines(" JSBSim, answer / RML ", rows, air)
    yield ""
    yield from criteria_lines(found)
    yield ""
    yield from worst_lines(rows)
    failed = [what for what, _, _, met in found if not met]
    return f"not met: {'; '.join(failed)}" if failed else None
