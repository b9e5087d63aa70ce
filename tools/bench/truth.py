"""Flies JSBSim's aircraft in all conditions, and compares estimate and sigma with the truth.

    python tools/bench.py truth [--seed 162] [--flights N] [--sealed] [--nonlinear]
                                [--logs DIR] [--jobs 2] [--csv FILE] [--readme]

The flights are the grid of flights/moved.py, replayed with the default options; with --logs they
stay in DIR and are not flown again. The tables are of the answers to manoeuvres and of flights, of
what ELS and RML of the stream had at each manoeuvre's end, of the answer in each condition, and of
the response that it gives (checks/judge.py); then the answers that are far off.
With --sealed they are the sealed aircraft's (bench/frame.py); with --nonlinear, those whose mode
depends on the size of the motion (``nonlinear`` in flights/sealed.toml).
The exit code is 1 if a criterion is not met, which is so only where the figure misses it by more
than its own error. --csv has a row for each flight and estimate.

Each manoeuvre is compared with the truth at the airspeed at which it was flown.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from functools import partial, reduce
from itertools import product
from pathlib import Path

import numpy as np
from checks.judge import METHODS, SHOWN, Row, against, judged, kept
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
from flights.plan import nonlinear_places, sealed_places

from bench.figures import (
    COLUMNS,
    FAR,
    FIGURES,
    IN_2_PCT,
    KEYS,
    LEAST_ROW,
    MOST_Z,
    Criterion,
    cells,
    criterion,
    errors,
    estimates,
    missed,
    of_kind,
)
from bench.frame import FLOWN, all_rows, begin, head, line, options_of

CONDITIONS = (
    "number", "aircraft", "speed_kt", "manoeuvre", "severity", "gyro", "rate_hz", "amplitude",
    "seconds",
)  # fmt: skip
STRIDE, OPENED_STRIDE = 97, 35
"""Step between the numbers of the flights flown; coprime to their number, so that a few mix all
conditions. With --nonlinear they are 96, of which a step of 97 would take the first ones."""
ANSWERED_PCT = 79.0
LIMITS = (
    (("calm",), "wn", "median", 0.75), (("calm",), "wn", "RMS", 1.6),
    (("calm",), "wn", "size of the mean", 0.4), (("calm",), "zeta", "RMS", 0.01),
    (("calm", "T38"), "zeta", "size of the mean", 0.025), (("turbulence",), "wn", "RMS", 3.1),
    (("turbulence",), "zeta", "RMS", 0.032),
    *(((), name, "in 2 sigma %", 90.0) for name in SHOWN[:-1]),
    ((), SHOWN[-1], "z", 1.3), ((), SHOWN[-1], "median", 5.0),
)  # fmt: skip
"""The criteria of the answers to manoeuvres: conditions, number, figure, and its limit."""
ACROSS = ("answered %", "wn off %, median", "wn RMS", "zeta RMS", "z wn, zeta")
"""The columns that are shown for each condition."""
Z = COLUMNS.index("z wn, zeta")


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
}
AIR = ("all", "calm", "turbulence")


def in_group(rows: Iterable[Row], name: str) -> list[Row]:
    """Return the rows of one of GROUPS, or of the aircraft of that name."""
    return [row for row in rows if GROUPS.get(name, _where("aircraft", name))(row)]


def air_lines(rows: Sequence[Row]) -> Iterator[str]:
    """Yield the table of answers, ELS, RML and flights by the air."""
    yield from head("", COLUMNS)
    for air in AIR:
        yield line(f"answer, {air}", *cells(in_group(rows, air), "manoeuvre"))
    for method, air in product(METHODS, AIR[1:]):
        yield line(f"{method.upper()}, {air}", *cells(in_group(rows, air), method))
    flight, mean = (cells(rows, "flight", end) for end in ("", " of the mean"))
    flight[Z:] = [f"{one}, {other}" for one, other in zip(flight[Z:], mean[Z:], strict=True)]
    yield line("flight; then its mean", *flight)


def condition_lines(rows: Sequence[Row]) -> Iterator[str]:
    """Yield the table of the answer in each condition, and of each aircraft."""
    yield from head("answer", ACROSS)
    for name in dict.fromkeys([*GROUPS, *(row["aircraft"] for row in rows)]):
        if name not in AIR and (its := in_group(rows, name)):
            by_name = dict(zip(COLUMNS, cells(its, "manoeuvre"), strict=True))
            yield line(name, *(by_name[each] for each in ACROSS))


def response_lines(rows: Sequence[Row]) -> Iterator[str]:
    """Yield the table of the response that the answer gives, by the air."""
    figures = ("median", "mean", "z", "in 2 sigma %")
    yield from head("response", ("answers", *figures))
    for name, air in product(SHOWN, AIR):
        of = errors(estimates(in_group(rows, air), "manoeuvre"), name)
        yield line(f"{name}, {air}", len(of), *(f"{FIGURES[each](of):.2f}" for each in figures))


def far_lines(rows: Sequence[Row]) -> Iterator[str]:
    """Yield the answers beyond FAR sigmas, in words."""
    for row in estimates(rows, "manoeuvre"):
        if max(abs(row["wn_z"]), abs(row["zeta_z"])) > FAR:
            where = "{aircraft}, flight {number}, {manoeuvre}, severity {severity}, {gyro} gyro, "
            off = "{rate_hz} Hz, at {from_s:.0f} s: {wn_error_pct:+.1f} % ({wn_z:.1f} sigma), "
            yield (where + off + "zeta {zeta_error:+.3f} ({zeta_z:.1f})").format(**row)


def criteria(rows: Sequence[Row]) -> Iterator[Criterion]:
    """Yield all criteria."""
    found = of_kind(rows, "manoeuvre")
    usable = [(row["number"], 100.0 * row["usable"], 0.0) for row in found]
    yield criterion("answered %", "mean", np.array(usable, float).reshape(-1, 3), ANSWERED_PCT)
    for names, number, figure, limit in LIMITS:
        if some := reduce(in_group, names, found):
            what = ", ".join([number, *names])
            yield criterion(what, figure, errors(estimates(some, "manoeuvre"), number), limit)
    of_z = ("z", MOST_Z), ("in 2 sigma %", IN_2_PCT)
    conditions = dict.fromkeys([*GROUPS, *(row["aircraft"] for row in rows)])
    for number, (figure, limit) in product(("wn", "zeta"), of_z):
        for name in conditions:
            of = errors(estimates(in_group(rows, name), "manoeuvre"), number)
            if len(of) >= LEAST_ROW:
                yield criterion(f"{number}, {name}", figure, of, limit)
    for number in ("wn", "zeta"):
        far = FIGURES["beyond"](errors(estimates(rows, "manoeuvre"), number))
        yield Criterion(f"{number}: beyond {FAR:g} sigma", far, 0.0, 0.0)
    for number, (figure, limit) in product(KEYS, of_z):
        of = errors(estimates(rows, "flight"), number)
        yield criterion(f"flight, {number}", figure, of, limit)


def flight_rows(draw: Draw, folder: Path, number: int) -> list[Row]:
    """Return the rows of one flight of the grid; fly it if the folder does not have it yet."""
    log, truth = kept(folder, f"{draw.seed}_{number:03d}", partial(of_grid, draw, number))
    conditions = {name: truth[name] for name in CONDITIONS}
    return [conditions | against(row, truth) for row in judged(log, truth)]


def main(arguments: list[str]) -> Generator[str, None, str | None]:
    """Yield two tables of tools/README.md and another, blank lines between.

    Return which criteria are not met, None if all are.
    """
    own = {"seed": TABLE, "flights": 0, "sealed": False, "nonlinear": False}
    options = options_of("truth", __doc__, arguments, **own, **FLOWN)
    run = begin("truth") if options.sealed else None
    own_places = nonlinear_places() if options.nonlinear else PLACES
    draw = Draw(run.seed, sealed_places()) if run else Draw(options.seed, own_places)
    count = PER_PLACE * len(draw.places)
    flights = min(options.flights or (count // 4 if run else count), count)
    stride = OPENED_STRIDE if options.nonlinear else STRIDE
    numbers = sorted(i * stride % count for i in range(flights))
    rows = all_rows(options, partial(flight_rows, draw), numbers)
    if run:
        run.note(dict(zip(COLUMNS, cells(rows, "manoeuvre"), strict=True)))
    for lines in (air_lines, condition_lines, response_lines, far_lines):
        yield from lines(rows)
        yield ""
    return missed(criteria(rows))
