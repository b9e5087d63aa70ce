"""Flies JSBSim's aircraft in all conditions, and compares estimate and sigma with the truth.

    python tools/bench.py truth [--seed 162] [--flights N] [--lateral] [--sealed] [--logs DIR]
                                [--jobs 2] [--csv FILE] [--readme]

The flights are the grid of flights/moved.py, replayed with the default options; with --logs they
stay in DIR and are not flown again. Below the tables of the READMEs come the criteria and the worst
answer of each aircraft. (Recorded flights: the bench ``real``.)
With --sealed they are the sealed aircraft's (bench/sealed.py).
With --lateral the bare airframe of each manoeuvre is looked for, too, and has a table by itself.
The exit code is 1 if a criterion is not met. --csv has a row for each flight and estimate.

z is (estimate - truth) / sqrt(sigma^2 + sigma of the truth^2). The figures of the answer, of RML
and of ELS are over all usable manoeuvres, each compared with the truth at the airspeed at which it
was flown. The answer is output error's in calm air, else RML's.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from checks.judge import METHODS, Row, judged, kept
from flights.moved import (
    GYROS,
    PER_PLACE,
    PLACES,
    RATES_HZ,
    SEVERITIES,
    SHAPES,
    TABLE,
    Draw,
    of_grid,
)
from flights.sealed import sealed_places

from bench.sealed import begin
from bench.table import FLOWN, all_rows, column, head, known, line, options_of, rms, within
from yawid.config.run import RunConfig

CONDITIONS = (
    "number", "aircraft", "speed_kt", "manoeuvre", "severity", "gyro", "rate_hz", "amplitude",
    "seconds",
)  # fmt: skip
STRIDE = 97
"""Step between the numbers of the flights flown; coprime to their number, so that a few mix all
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
_Z = f"{Z_FROM:g} to {Z_TO:g}"
_ANSWERED, _SIGMA = (
    f"calm {each['calm']:g}, else {each['turbulence']:g}" for each in (ANSWERED_PCT, SIGMA_PCT)
)
NEEDED = ("", _ANSWERED, "", "", _SIGMA, _Z, _Z, f"{COVERED_PCT:g}")
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


def of_kind(rows: Iterable[Row], kind: str) -> list[Row]:
    """Return the rows of one kind of estimate."""
    return [row for row in rows if row["kind"] == kind]


def estimates(rows: Iterable[Row], kind: str) -> list[Row]:
    """Return the usable rows of one kind whose estimate has a known truth."""
    return [row for row in of_kind(rows, kind) if row["usable"] and row["wn_error_pct"] is not None]


def figures(some: Sequence[Row], z: str = "z") -> dict[str, float]:
    """Return the figures of estimates by their columns, the last one's for wn and for zeta apart.

    With the ``z`` of z_noise, sigma is that of noise alone. A figure is NaN without an estimate.
    """
    off, wn, zeta = (column(some, name) for name in ("wn_error_pct", f"wn_{z}", f"zeta_{z}"))
    sigma = 100.0 * column(some, "wn_sigma") / column(some, "wn")
    return {
        "off %": known(np.median, np.abs(off)), "mean %": known(np.mean, off),
        "sigma %": known(np.median, sigma), "z wn": rms(wn), "z zeta": rms(zeta),
        "wn in": within(wn), "zeta in": within(zeta),
    }  # fmt: skip


def answered_pct(rows: Iterable[Row]) -> float:
    """Return how many % of the flights have a usable answer."""
    return 100.0 * known(np.mean, column(of_kind(rows, "flight"), "usable"))


def cells(rows: Sequence[Row], kinds: Sequence[str]) -> list[str]:
    """Return the last six of COLUMNS, each cell with the kinds of estimate side by side."""
    each = [figures(estimates(rows, kind)) for kind in kinds]
    forms = [f"{{{name}:.2f}}" for name in ("off %", "sigma %", "z wn", "z zeta")]
    forms.insert(1, "{mean %:+.2f}")
    return [" / ".join(form.format(**of) for of in each)
            for form in (*forms, "{wn in:.0f} {zeta in:.0f}")]  # fmt: skip


def condition_line(name: str, rows: Sequence[Row]) -> str:
    """Return the line of one condition."""
    return line(name, *condition_cells(rows))


def condition_cells(rows: Sequence[Row]) -> list[str]:
    """Return the cells of COLUMNS."""
    flights = str(len(of_kind(rows, "flight")))
    return [flights, f"{answered_pct(rows):.0f}", *cells(rows, TABLED)]


def aircraft_lines(rows: Sequence[Row]) -> Iterator[str]:
    """Yield a table with a row for each aircraft, answer / RML."""
    yield from head("aircraft", COLUMNS)
    for name in dict.fromkeys(row["aircraft"] for row in rows):
        yield condition_line(name, [row for row in rows if row["aircraft"] == name])


def condition_lines(rows: Sequence[Row], names: Iterable[str]) -> Iterator[str]:
    """Yield a table with a row for each condition, answer / RML."""
    yield from head("", COLUMNS)
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
        shown = (each.removeprefix("0").replace(" ", ",") for each in values)
        yield f"|{name}|{'|'.join(shown)}|".replace("+nan", "-").replace("nan", "-")


def worst_lines(rows: Sequence[Row]) -> Iterator[str]:
    """Yield a table with a row for each aircraft: mean and median size of wn's error, the worst."""
    yield from head("aircraft", ("answers", "mean %", "off %", "the worst answer"))
    for name in dict.fromkeys(place[0] for place in PLACES):
        if some := estimates([row for row in rows if row["aircraft"] == name], "manoeuvre"):
            of, off = figures(some), np.abs(column(some, "wn_error_pct"))
            bad = some[int(np.argmax(off))]
            said = (
                f"{bad['wn_error_pct']:+.1f} %, zeta {bad['zeta'] - bad['zeta_true']:+.3f}: flight "
                f"{bad['number']}, {bad['manoeuvre']}, severity {bad['severity']}, {bad['gyro']} "
                f"gyro, {bad['rate_hz']} Hz, at {bad['from_s']:.0f} s"
            )
            yield line(name, len(some), f"{of['mean %']:+.2f}", f"{of['off %']:.2f}", said)


def _wrong(row: Row) -> bool:
    error, z = row["wn_error_pct"], row["wn_z"]
    return error is not None and abs(error) > WRONG_PCT and (z is None or abs(z) > WRONG_Z)


def _right(row: Row) -> bool:
    return row["wn_error_pct"] is not None and abs(row["wn_error_pct"]) < RIGHT_PCT


def _share(hits: Sequence[Row], of: Sequence[Row], least: float, name: str) -> Criterion:
    """Return the criterion of a share in %, which is 100 if ``of`` is empty; 0 asks for nothing."""
    share = 100.0 * len(hits) / len(of) if of else 100.0
    needed = f">= {least:g} %" if least else ""
    return name, needed, f"{share:.0f} % ({len(hits)} of {len(of)})", share >= least


def warning_criteria(rows: Sequence[Row]) -> Iterator[Criterion]:
    """Yield the criteria of warnings by flights; then the same by manoeuvres, for comparison.

    A refused flight counts as wrong if any of its manoeuvres is wrong by its answering method.
    """
    manoeuvres, flights = of_kind(rows, "manoeuvre"), of_kind(rows, "flight")
    would = {row["number"] for row in manoeuvres if _wrong(row)}
    lost = [row for row in flights if not row["usable"] and row["number"] in would]
    for name, each, counts in (("flights", flights, 1.0), ("manoeuvres", manoeuvres, 0.0)):
        right = [row for row in each if row["usable"] and _right(row)]
        wrong = [row for row in each if _wrong(row) or (counts and row in lost)]
        silent = [row for row in right if not row["warnings"]]
        seen = [row for row in wrong if row["warnings"] or not row["usable"]]
        what = f"{name} less than {RIGHT_PCT:g} % off: no warning"
        yield _share(silent, right, counts * SILENT_PCT, what)
        what = f"{name} off by {WRONG_PCT:g} % and {WRONG_Z:g} sigma: warned or refused"
        yield _share(seen, wrong, counts * WARNED_PCT, what)


def criteria(rows: Sequence[Row]) -> Iterator[Criterion]:
    """Yield all criteria."""
    air = {name: [row for row in rows if GROUPS[name](row)] for name in ANSWERED_PCT}
    for name, least in ANSWERED_PCT.items():
        share = answered_pct(air[name])
        yield f"answered, {name}", f">= {least:g} %", f"{share:.1f} %", share >= least
    for kind, called in KINDS.items():
        each = estimates(rows, kind)
        total, noise = figures(each), figures(each, "z_noise")
        for what in ("wn", "zeta"):
            z = total[f"z {what}"]
            said = f"{z:.2f} (noise alone {noise[f'z {what}']:.2f})"
            met = Z_FROM <= z <= Z_TO
            yield f"{called}, RMS z of {what}", _Z, said, met
        for what in ("wn", "zeta"):
            share = total[f"{what} in"]
            said = f"{share:.1f} % (noise alone {noise[f'{what} in']:.1f} %)"
            met = share >= COVERED_PCT
            yield f"{called}, {what} within 2 sigma", f">= {COVERED_PCT:g} %", said, met
        for name, most in SIGMA_PCT.items():
            sigma = figures(estimates(air[name], kind))["sigma %"]
            what = f"{called}, median sigma of wn, {name}"
            # RML and ELS check the answer: their sigmas may be large if they are right.
            needed = f"<= {most:g} %" if called == "answer" else ""
            yield what, needed, f"{sigma:.2f} %", sigma <= most or not needed
    yield from warning_criteria(rows)


def criteria_lines(found: Sequence[Criterion]) -> Iterator[str]:
    """Yield the table of criteria."""
    yield from head("criterion", ("needed", "measured", "met"))
    for what, needed, said, met in found:
        yield line(what, needed, said, ("yes" if met else "NO") if needed else "")


def bare_lines(rows: Sequence[Row]) -> Iterator[str]:
    """Yield the table of the bare airframe's figures, over the manoeuvres that pass its gates."""
    yield from head("bare airframe", ("manoeuvres", "known %", *COLUMNS[2:]))
    for name in ("all", *ANSWERED_PCT):
        its = of_kind([row for row in rows if GROUPS[name](row)], "bare")
        share = f"{100.0 * known(np.mean, column(its, 'usable')):.0f}"
        yield line(name, len(its), share, *cells(its, ("bare",)))


def flight_rows(draw: Draw, lateral: bool, folder: Path, number: int) -> list[Row]:
    """Return the rows of one flight of the grid; fly it if the folder does not have it yet.

    Raises:
        SystemExit: the folder has another flight of that name.
    """
    log, truth = kept(folder, f"{number:03d}", partial(of_grid, draw, number))
    if (truth["seed"], truth["number"]) != (draw.seed, number):
        raise SystemExit(
            f"{log} is flight {truth['number']} of seed {truth['seed']}, not {draw.seed}"
        )
    conditions = {name: truth[name] for name in CONDITIONS}
    config = RunConfig(lateral="auto" if lateral else None)
    return [conditions | row for row in judged(log, truth, config)]


def main(arguments: list[str]) -> Generator[str, None, str | None]:
    """Yield two tables of tools/README.md and the others, blank lines between.

    Return which criteria are not met, None if all are.
    """
    own = {"seed": TABLE, "flights": 0, "lateral": False, "sealed": False}
    options = options_of("truth", __doc__, arguments, **own, **FLOWN)
    run = begin("truth") if options.sealed else None
    draw = Draw(run.seed, sealed_places()) if run else Draw(options.seed, PLACES)
    count = PER_PLACE * len(draw.places)
    flights = min(options.flights or (count // 4 if run else count), count)
    numbers = sorted(i * STRIDE % count for i in range(flights))
    rows = all_rows(options, partial(flight_rows, draw, options.lateral), numbers)
    if run:
        run.note(dict(zip(COLUMNS, condition_cells(rows), strict=True)))
    found = list(criteria(rows))
    air = ("all", *ANSWERED_PCT)
    yield from condition_lines(rows, air)
    yield line("needed", *NEEDED)
    yield ""
    if run:
        yield from aircraft_lines(rows)
    else:
        yield from across_lines(rows, [name for name in GROUPS if name not in air])
    yield ""
    yield from criteria_lines(found)
    yield ""
    yield from worst_lines(rows)
    if options.lateral:
        yield ""
        yield from bare_lines(rows)
    failed = [what for what, _, _, met in found if not met]
    return f"not met: {'; '.join(failed)}" if failed else None
