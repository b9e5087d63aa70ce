"""Flies JSBSim's aircraft in all conditions, and compares estimate and sigma with the truth.

    python tools/bench.py truth [--seed 162] [--flights N] [--lateral] [--sealed] [--nonlinear]
                                [--logs DIR] [--jobs 2] [--csv FILE] [--readme]

The flights are the grid of flights/moved.py, replayed with the default options; with --logs they
stay in DIR and are not flown again. The tables are of the answers to manoeuvres and of flights, of
what ELS and RML of the stream had at each manoeuvre's end, of the answer in each condition, of the
response that it gives (checks/judge_response.py), of the criteria, and of the worst answer of each
aircraft. (Recorded flights: the bench ``real``.)
With --sealed they are the sealed aircraft's (bench/sealed.py); with --nonlinear, those whose mode
depends on the size of the motion (``nonlinear`` in flights/sealed.toml).
With --lateral the bare airframe of each manoeuvre is looked for, too, and has a table by itself.
The exit code is 1 if a criterion is not met. --csv has a row for each flight and estimate.

z is (estimate - truth) / sqrt(sigma^2 + sigma of the truth^2). Each manoeuvre is compared with the
truth at the airspeed at which it was flown. The answers counted are the usable ones; of ELS and RML
they are all that have a number, and their sigma is that of noise. A criterion is not met only where
the figure misses it by more than its own error: the scatter of DRAWS draws of the flights.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from functools import partial
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from checks.judge import METHODS, Row, judged, kept
from checks.judge_response import SHOWN, against
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
from flights.sealed import nonlinear_places, sealed_places

from bench.sealed import begin
from bench.table import (
    FLOWN,
    Floats,
    all_rows,
    column,
    head,
    known,
    line,
    options_of,
    rms,
    within,
)
from yawid.config.run import RunConfig

CONDITIONS = (
    "number", "aircraft", "speed_kt", "manoeuvre", "severity", "gyro", "rate_hz", "amplitude",
    "seconds",
)  # fmt: skip
STRIDE, OPENED_STRIDE = 97, 35
"""Step between the numbers of the flights flown; coprime to their number, so that a few mix all
conditions. With --nonlinear they are 96, of which a step of 97 would take the first ones."""
ANSWERED_PCT, MOST_Z, IN_2_PCT = 79.0, 1.3, 94.0
LIMITS = (
    (("calm",), "wn", "median", 0.75), (("calm",), "wn", "RMS", 1.6),
    (("calm",), "wn", "size of the mean", 0.4), (("calm",), "zeta", "RMS", 0.01),
    (("calm", "T38"), "zeta", "size of the mean", 0.025), (("turbulence",), "wn", "RMS", 3.1),
    (("turbulence",), "zeta", "RMS", 0.032),
    *(((), name, "in 2 sigma %", 90.0) for name in SHOWN[:-1]),
    ((), SHOWN[-1], "z", 1.3), ((), SHOWN[-1], "median", 5.0),
)  # fmt: skip
"""The criteria of the answers to manoeuvres: conditions, number, figure, and its limit."""
DRAWS, SEED = 500, 0
FAR = 3.5
LEAST_ROW = 20
"""The answers that a condition needs for its z to be a criterion."""
COLUMNS = (
    "count", "answered %", "wn off %, median", "wn mean", "wn RMS", "zeta mean", "zeta RMS",
    "z wn, zeta", "in 2 sigma %", f"beyond {FAR:g}",
)  # fmt: skip
"""Of the errors of wn in % and of zeta: median size, mean, root mean square; then the root mean
square of z, the share of z within 2 (wn, zeta), and how many of both are beyond FAR."""
Z = COLUMNS.index("z wn, zeta")
ACROSS = {"answered %", "wn off %, median", "wn RMS", "zeta RMS", COLUMNS[Z]}
"""The columns that are shown for each condition."""
KEYS = {"wn": ("wn_error_pct", "wn_z"), "zeta": ("zeta_error", "zeta_z")} | {
    f"{name} of the mean": (error, f"{name}_z_mean")
    for name, error in (("wn", "wn_error_pct"), ("zeta", "zeta_error"))
}
"""The columns with error and z of a number; any other number has its own name in them."""


class Criterion(NamedTuple):
    """A criterion: a figure and its own error, and the limit that it has to keep."""

    what: str
    figure: str
    value: float
    error: float
    limit: float

    @property
    def is_share(self) -> bool:
        """Whether the limit is the least value, not the largest."""
        return "%" in self.figure

    @property
    def excess(self) -> float:
        """By how much the figure misses its limit beyond its own error, if positive."""
        return (self.value - self.limit) * (-1.0 if self.is_share else 1.0) - self.error


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
AIR = ("all", "calm", "turbulence")


def of_kind(rows: Iterable[Row], kind: str) -> list[Row]:
    """Return the rows of one kind of estimate."""
    return [row for row in rows if row["kind"] == kind]


def in_group(rows: Iterable[Row], name: str) -> list[Row]:
    """Return the rows of one of GROUPS, or of the aircraft of that name."""
    return [row for row in rows if GROUPS.get(name, _where("aircraft", name))(row)]


def estimates(rows: Iterable[Row], kind: str) -> list[Row]:
    """Return the rows of one kind that have an estimate and a truth, and are usable if judged."""
    return [row for row in of_kind(rows, kind)
            if (row["usable"] or kind in METHODS) and row["wn_error_pct"] is not None]  # fmt: skip


def errors(rows: Sequence[Row], name: str) -> Floats:
    """Return flight, error and z (n, 3) of a number, of the rows that have it."""
    keys = ("number", *KEYS.get(name, (f"{name}_error_pct", f"{name}_z")))
    return np.array([[row[key] for key in keys] for row in rows if keys[1] in row], float).reshape(
        -1, 3
    )


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


def scatter(figure: Figure, of: Floats) -> float:
    """Return the standard deviation of a figure over draws of the flights of errors (n, 3)."""
    rng = np.random.default_rng(SEED)
    flights = [np.flatnonzero(of[:, 0] == number) for number in np.unique(of[:, 0])]
    if not flights:
        return np.nan
    draws = rng.integers(len(flights), size=(DRAWS, len(flights)))
    return float(np.std([figure(of[np.concatenate([flights[i] for i in each])]) for each in draws]))


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


def across_lines(rows: Sequence[Row], names: Sequence[str]) -> Iterator[str]:
    """Yield a table of the answer alone, with a column for each condition."""
    short = [name.replace("severity", "s").removesuffix(" gyro").replace(" ", "") for name in names]
    yield "|answer|" + "|".join(short) + "|"
    yield "|---" * (1 + len(names)) + "|"
    columns = [cells(in_group(rows, name), "manoeuvre") for name in names]
    for name, values in zip(COLUMNS, zip(*columns, strict=True), strict=True):
        if name not in ACROSS:
            continue
        of = ("z wn", "z zeta") if name == COLUMNS[Z] else (name,)
        for which, parts in zip(of, zip(*map(str.split, values), strict=True), strict=True):
            shown = "|".join(parts).replace("0.", ".").replace("+nan", "-").replace("nan", "-")
            yield f"|{which}|{shown}|"


def response_lines(rows: Sequence[Row]) -> Iterator[str]:
    """Yield the table of the response that the answer gives, by the air."""
    yield from head("response", ("answers", "off %: median", "mean", "z", "in 2 sigma %"))
    for name in SHOWN:
        for air in AIR:
            of = errors(estimates(in_group(rows, air), "manoeuvre"), name)
            median, mean, z, inside = (
                FIGURES[each](of) for each in ("median", "mean", "z", "in 2 sigma %")
            )
            each = f"{median:.1f}", f"{mean:+.1f}", f"{z:.2f}", f"{inside:.0f}"
            yield line(f"{name}, {air}", len(of), *each)


def worst_lines(rows: Sequence[Row]) -> Iterator[str]:
    """Yield a table with a row for each aircraft: the worst answer, and all beyond FAR sigmas."""
    yield from head("aircraft", ("answers", "the worst answer, and what is far off in sigmas"))
    for name in dict.fromkeys(row["aircraft"] for row in rows):
        if some := estimates(in_group(rows, name), "manoeuvre"):
            worst = some[int(np.argmax(np.abs(column(some, "wn_error_pct"))))]
            far = [row for row in some if max(abs(row["wn_z"]), abs(row["zeta_z"])) > FAR]
            said = (
                f"{bad['wn_error_pct']:+.1f} % ({bad['wn_z']:.1f} sigma), zeta "
                f"{bad['zeta_error']:+.3f} ({bad['zeta_z']:.1f}): flight {bad['number']}, "
                f"{bad['manoeuvre']}, severity {bad['severity']}, {bad['gyro']} gyro, "
                f"{bad['rate_hz']} Hz, at {bad['from_s']:.0f} s"
                for bad in (worst, *(row for row in far if row is not worst))
            )
            yield line(name, len(some), "; ".join(said))


def _held(what: str, figure: str, of: Floats, limit: float) -> Criterion:
    """Return the criterion that a figure of errors (n, 3) keeps a limit."""
    of_all = FIGURES[figure]
    return Criterion(what, figure, of_all(of), scatter(of_all, of), limit)


def _worst(rows: Sequence[Row], number: str, figure: str, limit: float) -> Iterator[Criterion]:
    """Yield the criterion of the condition, of those with enough answers, that is worst."""
    found = []
    for name in dict.fromkeys([*GROUPS, *(row["aircraft"] for row in rows)]):
        of = errors(estimates(in_group(rows, name), "manoeuvre"), number)
        if len(of) >= LEAST_ROW:
            found.append(_held(f"{number}, every condition, worst: {name}", figure, of, limit))
    yield from sorted(found, key=lambda each: -each.excess)[:1]


def criteria(rows: Sequence[Row]) -> Iterator[Criterion]:
    """Yield all criteria."""
    found = of_kind(rows, "manoeuvre")
    usable = [(row["number"], 100.0 * row["usable"], 0.0) for row in found]
    of = np.array(usable, float).reshape(-1, 3)
    mean = FIGURES["mean"]
    yield Criterion("manoeuvres", "answered %", mean(of), scatter(mean, of), ANSWERED_PCT)
    for names, number, figure, limit in LIMITS:
        some = [row for row in found if all(GROUPS[name](row) for name in names)]
        if some:
            of = errors(estimates(some, "manoeuvre"), number)
            yield _held(", ".join([number, *names]), figure, of, limit)
    of_z = [(figure, limit) for figure, limit in (("z", MOST_Z), ("in 2 sigma %", IN_2_PCT))]
    for number in ("wn", "zeta"):
        for figure, limit in of_z:
            yield from _worst(rows, number, figure, limit)
        far = FIGURES["beyond"](errors(estimates(rows, "manoeuvre"), number))
        yield Criterion(number, f"beyond {FAR:g} sigma", far, 0.0, 0.0)
    for number in KEYS:
        for figure, limit in of_z:
            yield _held(
                f"flight, {number}", figure, errors(estimates(rows, "flight"), number), limit
            )


def criteria_lines(found: Sequence[Criterion]) -> Iterator[str]:
    """Yield the table of criteria."""
    yield from head("criterion", ("needed", "measured", "met"))
    for each in found:
        needed = f"{'>=' if each.is_share else '<='} {each.limit:g}"
        measured = f"{each.value:.3g} ± {each.error:.2g}"
        met = "yes" if each.excess <= 0.0 else "NO"
        yield line(f"{each.what}: {each.figure}", needed, measured, met)


def bare_lines(rows: Sequence[Row]) -> Iterator[str]:
    """Yield the table of the bare airframe's figures, over the manoeuvres that pass its gates."""
    yield from head("bare airframe", COLUMNS)
    for name in AIR:
        yield line(name, *cells(in_group(rows, name), "bare"))


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
    return [conditions | against(row, truth) for row in judged(log, truth, config)]


def main(arguments: list[str]) -> Generator[str, None, str | None]:
    """Yield two tables of tools/README.md and the others, blank lines between.

    Return which criteria are not met, None if all are.
    """
    own = {"seed": TABLE, "flights": 0, "lateral": False, "sealed": False, "nonlinear": False}
    options = options_of("truth", __doc__, arguments, **own, **FLOWN)
    run = begin("truth") if options.sealed else None
    own_places = nonlinear_places() if options.nonlinear else PLACES
    draw = Draw(run.seed, sealed_places()) if run else Draw(options.seed, own_places)
    count = PER_PLACE * len(draw.places)
    flights = min(options.flights or (count // 4 if run else count), count)
    stride = OPENED_STRIDE if options.nonlinear else STRIDE
    numbers = sorted(i * stride % count for i in range(flights))
    rows = all_rows(options, partial(flight_rows, draw, options.lateral), numbers)
    if run:
        run.note(dict(zip(COLUMNS, cells(rows, "manoeuvre"), strict=True)))
    yield from air_lines(rows)
    yield ""
    aircraft = dict.fromkeys(row["aircraft"] for row in rows)
    names = (
        [*aircraft] if run or options.nonlinear else [name for name in GROUPS if name not in AIR]
    )
    yield from across_lines(rows, names)
    yield ""
    yield from response_lines(rows)
    yield ""
    found = list(criteria(rows))
    yield from criteria_lines(found)
    yield ""
    yield from worst_lines(rows)
    if options.lateral:
        yield ""
        yield from bare_lines(rows)
    failed = [f"{each.what}: {each.figure}" for each in found if not each.excess <= 0.0]
    return f"not met: {'; '.join(failed)}" if failed else None
