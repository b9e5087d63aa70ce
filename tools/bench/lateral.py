"""Judges the bare airframe of JSBSim's flights under a roll hold against their linearisation.

    python tools/bench.py lateral [--seed 913] [--flights 240] [--manoeuvres 3] [--logs DIR]
                                  [--fresh 0] [--sealed] [--jobs 2] [--csv FILE] [--readme]

The flights are those of flights/lateral.py: the roll hold hears the noisy signals. Of each flight
the first ``--manoeuvres`` are fitted, each alone, as ``--lateral auto`` does. Figures are of those
that pass all gates. z is (estimate - truth) / sigma. The criteria are for an aileron that is also
moved; the exit code is 1 if one is not met. The gates were chosen with seeds 701 and 812. With
``--fresh 1`` other aircraft fly, on which nothing was ever chosen, and with ``--sealed`` the sealed
ones (bench/sealed.py).
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Generator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from checks.judge import Row
from flights.lateral import (
    AILERONS,
    FRESH,
    LOGGED_S,
    MANOEUVRES_S,
    PER_PLACE,
    SEVERITIES,
    kept,
)
from flights.moved import PLACES
from flights.plan import FOOT, Place
from flights.sealed import sealed_places

from bench.sealed import begin
from bench.table import FLOWN, all_rows, column, head, known, line, options_of, rms, within
from yawid.lateral.fit import START_LAGS_S
from yawid.lateral.fit_airframe import fit_airframe
from yawid.lateral.motion import COMMAND_STEP_S, LEAD_S, Motion

SEED = 913
STRIDE = 7
"""Step between the numbers of the flights flown; coprime to that of the conditions, so that a few
mix all of them."""
SIZES = ("wn_pct", "zeta_error", "roll_pct", "n_dr_pct", "wn_z", "zeta_z")
COLUMNS = (
    "fits", "pass %", "wn %", "zeta", "roll mode %", "N_dr %", "z wn", "z zeta", "in 2 sigma %",
    "beyond 3 %", "worst wn %", "s a start",
)  # fmt: skip
"""Errors are medians of their sizes; z is the root mean square; ``in 2 sigma`` and ``beyond 3``
are of wn and of zeta; the last column is the CPU time of a fit from one start."""
HIGH_ZETA, ZETA_SHARE = 0.4, 0.03
LEAST = {"pass %": 70.0, "in 2 sigma %": 92.0}
MOST = {"wn %": 1.2, "zeta": 0.012, "roll mode %": 10.0, "N_dr %": 4.0, "beyond 3 %": 2.0}
Z_FROM, Z_TO, WRONG_PCT = 0.7, 1.3, 10.0


def motion(flight: dict[str, Any], number: int) -> Motion:
    """Return manoeuvre ``number`` (from 0) of a flight of ``flights.lateral``."""
    start_s = json.loads(str(flight["truth"]))["manoeuvres"][number]["start_s"]
    t_s = flight["attitude"][:, 0]
    its = flight["attitude"][(t_s > start_s - 1e-6) & (t_s < start_s + MANOEUVRES_S - 1e-6)]
    span_s = its[-1, 0] - its[0, 0]
    at = np.arange(round((LEAD_S + span_s) / COMMAND_STEP_S) + 2) * COMMAND_STEP_S - LEAD_S
    stamps, rudder, aileron = flight["servos"].T
    return Motion(
        sample_time_s=LOGGED_S, p=its[:, 1], q=its[:, 2], r=its[:, 3], roll=its[:, 4],
        pitch=its[:, 5], commands_start_s=-LEAD_S,
        rudder=np.interp(at + its[0, 0], stamps, rudder),
        aileron=np.interp(at + its[0, 0], stamps, aileron),
        airspeed_m_s=float(its[:, 6].mean()),
        climb=math.asin(np.polyfit(its[:, 0], its[:, 8] * FOOT, 1)[0] / its[:, 6].mean()),
    )  # fmt: skip


def rows_of(
    name: str, seed: int, manoeuvres: int, places: Sequence[Place], folder: Path, flight: int
) -> list[Row]:
    """Fly, or take from the folder, and fit; return a row for each manoeuvre."""
    flown = kept(folder, name, seed, flight, places)
    truth = json.loads(str(flown["truth"]))
    return [_row(truth, number, motion(flown, number)) for number in range(manoeuvres)]


def _row(truth: dict[str, Any], number: int, given: Motion) -> Row:
    start = time.process_time()
    found = fit_airframe([given])
    spent_s = time.process_time() - start
    A, controls = (np.array(truth["manoeuvres"][number][name]) for name in "AB")
    poles = np.linalg.eigvals(A)
    pair, roll = poles[np.argmax(poles.imag)], poles.real[np.abs(poles.imag) < 1e-6].min()
    wn, zeta, roll_s = found.wn_rad_s, found.zeta, found.roll_s
    true_wn, true_zeta = float(abs(pair)), float(-pair.real / abs(pair))
    conditions = ("aircraft", "speed_kt", "severity", "aileron", "seed", "number")
    return {name: truth[name] for name in conditions} | {
        "manoeuvre": number, "failed": " ".join(found.failed),
        "true_wn": true_wn, "true_zeta": true_zeta, "wn": wn.value, "wn_sigma": wn.std,
        "zeta": zeta.value, "zeta_sigma": zeta.std,
        "wn_pct": 100.0 * (wn.value / true_wn - 1.0), "zeta_error": zeta.value - true_zeta,
        "wn_z": (wn.value - true_wn) / wn.std, "zeta_z": (zeta.value - true_zeta) / zeta.std,
        "roll_pct": 100.0 * (-1.0 / roll_s.value / float(roll) - 1.0),
        "n_dr_pct": 100.0 * (found.derivatives["N_delta_r"].value / controls[2, 1] - 1.0),
        "rho1": found.rho1, "cpu_s": spent_s / len(START_LAGS_S),
    }  # fmt: skip


def figures(rows: Sequence[Row]) -> dict[str, tuple[float, ...]]:
    """Return the figures of COLUMNS by name, NaN where none passes; those of z have two."""
    good = [row for row in rows if not row["failed"]]
    size = {name: np.abs(column(good, name)) for name in SIZES}
    z = size["wn_z"], size["zeta_z"]
    return {
        "fits": (len(rows),), "pass %": (100.0 * len(good) / max(len(rows), 1),),
        "wn %": (known(np.median, size["wn_pct"]),),
        "zeta": (known(np.median, size["zeta_error"]),),
        "roll mode %": (known(np.median, size["roll_pct"]),),
        "N_dr %": (known(np.median, size["n_dr_pct"]),),
        "z wn": (rms(z[0]),), "z zeta": (rms(z[1]),),
        "in 2 sigma %": tuple(map(within, z)),
        "beyond 3 %": tuple(100.0 - within(each, 3.0) for each in z),
        "worst wn %": (known(np.max, size["wn_pct"]),),
        "s a start": (known(np.mean, column(rows, "cpu_s")),),
    }  # fmt: skip


def shown(rows: Sequence[Row]) -> dict[str, str]:
    """Return the figures of COLUMNS as texts."""
    forms = {"fits": "{:.0f}", "pass %": "{:.0f}", "zeta": "{:.4f}", "worst wn %": "{:.1f}",
             "in 2 sigma %": "{:.0f}", "beyond 3 %": "{:.0f}", "roll mode %": "{:.1f}"}  # fmt: skip
    return {column: " ".join(forms.get(column, "{:.2f}").format(x) for x in values)
            for column, values in figures(rows).items()}  # fmt: skip


def condition_line(name: str, rows: Sequence[Row]) -> str:
    """Return the line of one condition."""
    return line(name, *shown(rows).values())


def missed(rows: Sequence[Row]) -> list[str]:
    """Return which criteria are not met by flights whose aileron is also moved."""
    of, high = figures(rows), [r for r in rows if r["true_zeta"] > HIGH_ZETA and not r["failed"]]
    low = [row for row in rows if row["true_zeta"] <= HIGH_ZETA]
    of["zeta"] = figures(low)["zeta"]
    found = [f"{name} is {min(of[name]):.3g}, {limit:g} or more is needed"
             for name, limit in LEAST.items() if not min(of[name]) >= limit]  # fmt: skip
    found += [f"{name} is {max(of[name]):.3g}, {limit:g} or less is needed"
              for name, limit in MOST.items() if not max(of[name]) <= limit]  # fmt: skip
    found += [f"{name} is {of[name][0]:.2f}, {Z_FROM:g} to {Z_TO:g} is needed"
              for name in ("z wn", "z zeta") if not Z_FROM <= of[name][0] <= Z_TO]  # fmt: skip
    if high and np.median([abs(r["zeta_error"]) / r["true_zeta"] for r in high]) > ZETA_SHARE:
        found.append(f"zeta above {HIGH_ZETA:g} is off by more than {ZETA_SHARE:.0%}")
    if of["worst wn %"][0] > WRONG_PCT:
        found.append(f"wn is off by {of['worst wn %'][0]:.1f} %, {WRONG_PCT:g} is the most")
    return found


def table(rows: Sequence[Row]) -> Generator[str, None, str | None]:
    """Yield a table by aileron and severity and one by aircraft; return the criteria missed."""
    yield from head("", COLUMNS)
    for aileron in AILERONS:
        its = [row for row in rows if row["aileron"] == aileron]
        yield condition_line(f"aileron {aileron}", its)
        for severity in SEVERITIES:
            yield condition_line(
                f"severity {severity}", [r for r in its if r["severity"] == severity]
            )
    moved = [row for row in rows if row["aileron"] == AILERONS[0]]
    yield ""
    yield from head("aileron moved", COLUMNS)
    for name in dict.fromkeys(row["aircraft"] for row in moved):
        yield condition_line(name, [row for row in moved if row["aircraft"] == name])
    return "\n".join(missed(moved)) or None


def main(arguments: list[str]) -> Generator[str, None, str | None]:
    """Fly, fit, and yield the table."""
    own = {"seed": SEED, "flights": 0, "manoeuvres": 3, "fresh": 0, "sealed": False}
    options = options_of("lateral", __doc__, arguments, **own, **FLOWN)
    name, seed = "lateral", options.seed
    places: Sequence[Place] = PLACES
    if options.fresh:
        name, places = "fresh", FRESH
    if run := begin("lateral") if options.sealed else None:
        name, seed, places = "sealed", run.seed, sealed_places()
    count = PER_PLACE * len(places)
    flights = options.flights or (count // 2 if run else 2 * count)
    numbers = [i * STRIDE % count + i // count * count for i in range(flights)]
    rows = all_rows(options, partial(rows_of, name, seed, options.manoeuvres, places), numbers)
    if run:
        run.note(shown([row for row in rows if row["aileron"] == AILERONS[0]]))
    return (yield from table(rows))
