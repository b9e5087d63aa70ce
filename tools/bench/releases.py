"""The classic flight test: a doublet of the rudder, then hands off, of a lightly damped aircraft.

    python tools/bench.py releases [--flights 36] [--seed 9001] [--jobs 2] [--csv FILE] [--readme]

The aircraft are those of flights/records.py: wn .5 to 6 rad/s, zeta .02 to .15, a noise of up to
3 % of the peak, hands off for 5 to 20 s. Each is simulated exactly and replayed as a record at 10,
20 and 50 Hz; every second one has all four lateral states, and p and roll in its record. An answer
is wrong if it is off by more than 2 % of wn and two sigmas of it, or by .02 of zeta and two sigmas
of it. Below the table are the reasons that refused, with the flights that each refused, and what
was said of clocks. The exit code is 1 unless 97 % are answered, none of them wrong, and no clock is
named: rudder and yaw rate have the same.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Generator, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from flights.records import SAID, release

import yawid
from bench.table import Row, column, head, in_processes, known, line, options_of, write_csv

RATES_HZ = (10, 20, 50)
ANSWERED_PCT, WRONG_PCT, WRONG_ZETA = 97.0, 2.0, 0.02
SLOW_RAD_S = 1.0
COLUMNS = ("releases", "answered %", "wn off %, median", "most", "zeta off, most", "wrong")


def row_of(seed: int, task: tuple[int, int]) -> list[Row]:
    """Return the row of one release at one rate, which has no wn where it is refused."""
    number, hz = task
    columns, true = release(seed, number, hz, rolls=number % 2 == 1)
    summary = yawid.replay(columns, **SAID).summary
    verdict, flight = summary.deciding, summary.flight
    said = [*verdict.reasons, *(r for m in summary.manoeuvres or () for r in m.verdict.reasons)]
    row: Row = {"number": number, "rate_hz": hz, "rolls": number % 2 == 1, "answered": False}
    row |= {"wn_true": true.wn, "zeta_true": true.zeta, "wn_off_pct": None, "zeta_off": None}
    row["fatal"] = " ".join(reason.id for reason in verdict.fatal)
    row |= {"wrong": False, "clock": next((r.text for r in said if "clock" in r.text.lower()), "")}
    if not verdict.usable or flight is None or (roll := flight.dutch_roll) is None:
        return [row]
    wn_off, zeta_off = roll.wn_rad_s - true.wn, roll.zeta - true.zeta
    wn_most = WRONG_PCT / 100.0 * true.wn + 2.0 * (roll.wn_std or 0.0)
    zeta_most = WRONG_ZETA + 2.0 * (roll.zeta_std or 0.0)
    row |= {"wn": roll.wn_rad_s, "wn_std": roll.wn_std, "wn_off_pct": 100.0 * wn_off / true.wn}
    row |= {"zeta": roll.zeta, "zeta_std": roll.zeta_std, "zeta_off": zeta_off}
    wrong = abs(wn_off) > wn_most or abs(zeta_off) > zeta_most
    return [row | {"answered": True, "wrong": wrong}]


def cells(rows: Sequence[Row]) -> list[str]:
    """Return the cells of COLUMNS."""
    wn, zeta = (np.abs(column(rows, name)) for name in ("wn_off_pct", "zeta_off"))
    off = f"{known(np.median, wn):.2f}", f"{known(np.max, wn):.2f}", f"{known(np.max, zeta):.4f}"
    answered = f"{100.0 * known(np.mean, column(rows, 'answered')):.0f}"
    return [str(len(rows)), answered, *off, str(sum(row["wrong"] for row in rows))]


def main(arguments: list[str]) -> Generator[str, None, str | None]:
    """Yield the table, then what refused and what was said of clocks; return what is missed."""
    options = options_of("releases", __doc__, arguments, flights=36, seed=9001, jobs=2, csv=Path)
    tasks = [(number, hz) for number in range(options.flights) for hz in RATES_HZ]
    rows = in_processes(partial(row_of, options.seed), tasks, options.jobs)
    if options.csv:
        write_csv(options.csv, rows)
    yield from head("", COLUMNS)
    yield line("all", *cells(rows))
    for hz in RATES_HZ:
        yield line(f"{hz} Hz", *cells([row for row in rows if row["rate_hz"] == hz]))
    slow = [row for row in rows if row["wn_true"] < SLOW_RAD_S]
    yield line(f"below {SLOW_RAD_S:g} rad/s", *cells(slow))
    yield ""
    refused = [row["fatal"] for row in rows if not row["answered"]]
    for fatal, count in Counter(refused).most_common():
        yield f"{fatal or 'no reason'} refused {count}"
    wrong, clocks = ([row for row in rows if row[name]] for name in ("wrong", "clock"))
    for row in wrong:
        yield f"release {row['number']} at {row['rate_hz']} Hz is wrong"
    for row in clocks:
        yield f"release {row['number']} at {row['rate_hz']} Hz: {row['clock']}"
    if 100.0 * (1.0 - len(refused) / len(rows)) >= ANSWERED_PCT and not wrong and not clocks:
        return None
    return f"{len(refused)} of {len(rows)} refused, {len(wrong)} wrong, {len(clocks)} name a clock"
