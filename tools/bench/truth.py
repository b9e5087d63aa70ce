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

Each manoeuvre is compared with the truth at the airspeed at which it was flown; z is
(estimate - truth) / sqrt(sigma^2 + sigma of the truth^2). Estimates that count are the usable ones;
of ELS and RML they are all that have a number, and their sigma is that of noise. Other benches have
the same figures.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from functools import partial, reduce
from itertools import product
from pathlib import Path
from typing import NamedTuple

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

from bench.frame import FLOWN, Floats, all_rows, begin, head, known, line, options_of, rms, within

FAR = 3.5
MOST_Z, IN_2_PCT, LEAST_ROW = 1.3, 94.0, 20
"""Limits of the root mean square of z and of the share of z within 2, and the answers that a
condition needs for them to be criteria."""
COLUMNS = (
    "count", "answered %", "wn off %, median", "wn mean", "wn RMS", "zeta mean", "zeta RMS",
    "z wn, zeta", "in 2 sigma %", f"beyond {FAR:g}",
)  # fmt: skip
"""Of the errors of wn in % and of zeta: median size, mean, root mean square; then the root mean
square of z, the share of z within 2 (wn, zeta), and how many of both are beyond FAR."""
KEYS = {"wn": ("wn_error_pct", "wn_z"), "zeta": ("zeta_error", "zeta_z")} | {
    f"{name} of the mean": (error, f"{name}_z_mean")
    for name, error in (("wn", "wn_error_pct"), ("zeta", "zeta_error"))
}
"""The columns with error and z of a number; any other number has its own name in them."""
DRAWS, SEED = 500, 0
Figure = Callable[[Floats], float]
"""A figure of errors (n, 3)."""
FIGURES: dict[str, Figure] = {
    "median": lambda x: known(np.median, np.abs(x[:, 1])),
    "mean": lambda x: known(np.mean, x[:, 1]),
    "size of the mean": lambda x: abs(known(np.mean, x[:, 1])),
    "RMS": lambda x: rms(x[:, 1]),
    "z": lambda x: rms(x[:, 2]),
    "in 2 sigma %": lambda x: within(x[:, 2]),
    "beyond": lambda x: float(np.sum(np.abs(x[:, 2]) > FAR)),
}


def of_kind(rows: Iterable[Row], kind: str) -> list[Row]:
    """Return the rows of one kind of estimate."""
    return [row for row in rows if row["kind"] == kind]


def estimates(rows: Iterable[Row], kind: str) -> list[Row]:
    """Return the rows of one kind that have an estimate and a truth, and are usable if judged."""
    return [row for row in of_kind(rows, kind)
            if (row["usable"] or kind in METHODS) and row["wn_error_pct"] is not None]  # fmt: skip


def errors(rows: Sequence[Row], name: str) -> Floats:
    """Return flight, error and z (n, 3) of a number, of the rows that have it."""
    keys = ("number", *KEYS.get(name, (f"{name}_error_pct", f"{name}_z")))
    found = [[row[key] for key in keys] for row in rows if keys[1] in row]
    return np.array(found, float).reshape(-1, 3)


def cells(rows: Sequence[Row], kind: str, end: str = "") -> list[str]:
    """Return the cells of COLUMNS of one kind of estimate; a flight's mean has the ``end``."""
    some = estimates(rows, kind)
    wn, zeta = (errors(some, name + end) for name in ("wn", "zeta"))
    answered = 100.0 * len(some) / max(len(of_kind(rows, kind)), 1)
    median, mean, size = (FIGURES[name](wn) for name in ("median", "mean", "RMS"))
    mean_zeta, size_zeta = (FIGURES[name](zeta) for name in ("mean", "RMS"))
    z, inside, far = (
        [FIGURES[name](of) for of in (wn, zeta)] for name in ("z", "in 2 sigma %", "beyond")
    )
    off = f"{median:.2f}", f"{mean:+.2f}", f"{size:.2f}", f"{mean_zeta:+.4f}", f"{size_zeta:.4f}"
    both = f"{z[0]:.2f} {z[1]:.2f}", f"{inside[0]:.0f} {inside[1]:.0f}", f"{sum(far):.0f}"
    return [str(len(some)), f"{answered:.0f}", *off, *both]


class Criterion(NamedTuple):
    """A criterion: a figure and its own error, and the limit that it has to keep."""

    what: str
    value: float
    error: float
    limit: float

    @property
    def excess(self) -> float:
        """By how much the figure misses its limit beyond its own error, if positive.

        The limit of a share is the least value, not the largest.
        """
        return (self.value - self.limit) * (-1.0 if "%" in self.what else 1.0) - self.error

    def __str__(self) -> str:
        return f"{self.what}: {self.value:.3g} ± {self.error:.2g}, limit {self.limit:g}"


def criterion(what: str, figure: str, of: Floats, limit: float) -> Criterion:
    """Return the criterion that a figure of errors (n, 3) keeps a limit.

    Its own error is its standard deviation over DRAWS draws of the flights.
    """
    rng, value = np.random.default_rng(SEED), FIGURES[figure]
    flights = [np.flatnonzero(of[:, 0] == number) for number in np.unique(of[:, 0])]
    found = [
        value(of[np.concatenate([flights[i] for i in each])])
        for each in (rng.integers(len(flights), size=(DRAWS, len(flights))) if flights else ())
    ]
    error = float(np.std(found)) if found else np.nan
    return Criterion(f"{what}: {figure}", value(of), error, limit)


def missed(found: Iterable[Criterion]) -> str | None:
    """Return the criteria that are not met, in words; None if all are."""
    bad = [str(each) for each in found if not each.excess <= 0.0]
    return f"not met: {'; '.join(bad)}" if bad else None


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
