"""Closes ArduPlane's yaw damper in JSBSim, and compares what yawid damper predicts with that.

    python tools/bench.py damper [--cases 100] [--logs DIR] [--jobs 2] [--csv FILE] [--readme]

For each place (aircraft and airspeed) a flight without the damper is replayed, and predicts wn and
zeta for gains that add .08 to .35 of zeta. Each of these is flown with the damper closed: washout
of each call, scaling, loop rate, a servo that lags, noisy signals. The truth is JSBSim's
linearisation with the damper closed, at the airspeed flown. Compared, too: the answers of both
flights, which have to be the same; a damped sine fitted to the decay in flight with the same fit of
the predicted response; and the advice, which may not lower zeta.

zeta is right within the larger of .05 and 15 %.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from checks.judge import Row, kept
from flights.damped import GRAVITY, DampedFlight, Damper, linear
from flights.flight import Hands
from flights.fly import Made
from flights.moved import CONDITIONS
from flights.plan import STEP_S, FlightPlan, excitation
from flights.surgery import join
from flights.telemetry import Link, telemetry
from flights.truth import after_lead_in, linear_dutch_rolls, mean_plan

from bench.table import FLOWN, all_rows, head, known, line, options_of
from yawid.damper.decay import damped_sine
from yawid.damper.loop import closed_response
from yawid.damper.study import Study
from yawid.tables.replay import replay
from yawid.tables.run import Run

SEED = 3201
ADDED = (0.08, 0.15, 0.25, 0.35)
"""What the gains of a place add to zeta."""
LAGS_S, LOOPS_HZ, GYROS = (0.02, 0.05, 0.08), (50, 100, 200), (0.001, 0.003)
RIGHT, RIGHT_SHARE = 0.05, 0.15
LEAST_ZETA = 0.15
NEEDED = {"right": 85.0, "within": 90.0}
REST_S = 10.0
COLUMNS = (
    "cases", "refused", "zeta right", "within 2 sigma", "wn off, median", "decays alike", "z ≤ 2",
)  # fmt: skip


def plan_of(place: int) -> tuple[FlightPlan, Damper, Link]:
    """Return the flight of a place, its damper without gain, and its link."""
    rng = np.random.default_rng([SEED, place])
    aircraft, altitude_ft, speed_kt = CONDITIONS[place % len(CONDITIONS)]
    plan = FlightPlan(
        aircraft=aircraft, altitude_ft=altitude_ft, heading_deg=float(rng.integers(0, 360)),
        speed_kt=speed_kt * (1.0 if place < len(CONDITIONS) else 1.05),
        amplitude=round(float(rng.uniform(0.12, 0.25)), 3),
    )  # fmt: skip
    mode = linear_dutch_rolls(plan)["dutch_roll"]
    assert mode is not None
    period_s = math.tau / mode["wn_rad_s"]
    seconds = min(max(round(15.0 + 18.0 * period_s), 60), 100)
    plan = replace(plan, step_s=round(0.3 * period_s, 3), seconds=float(seconds))
    scaling = round(speed_kt * 0.514444 * float(rng.uniform(0.8, 1.2)), 1)
    damper = Damper(0.0, int(rng.choice(LOOPS_HZ)), scaling, float(rng.choice(LAGS_S)))
    link = Link(50, 50, rate_noise=float(rng.choice(GYROS)), seed=int(rng.integers(1, 2**31)))
    return plan, damper, link


def gain_for(plan: FlightPlan, damper: Damper, added: float) -> float:
    """Return the gain that adds about ``added`` to zeta in the linearisation at trim."""
    model, top = linear(plan, damper.servo_lag_s), 0.05
    start = _zeta(model.dutch_roll(damper))
    while top < 20.0 and _zeta(model.dutch_roll(replace(damper, gain=top))) - start < added:
        top *= 1.3
    return round(top, 3)


def _zeta(pole: complex) -> float:
    return -pole.real / abs(pole)


def flown(place: int, gain: float, number: int) -> Made:
    """Fly a place with a gain; the truth has the closed and the open Dutch roll as flown."""
    plan, damper, link = plan_of(place)
    damper = replace(damper, gain=gain)
    rudder = excitation(plan)
    rest = round(REST_S / STEP_S)
    rudder[-rest:] = 0.0
    link = replace(link, seed=link.seed + number)
    flight = DampedFlight(plan, Hands(rudder), link, damper)
    log = join(telemetry(link, flight))
    model = linear(mean_plan(plan, after_lead_in(flight.flown)), damper.servo_lag_s)
    poles = model.dutch_roll(damper), model.dutch_roll(replace(damper, gain=0.0))
    pairs = {name: [abs(p), _zeta(p)] for name, p in zip(("closed", "open"), poles, strict=True)}
    ends = [plan.seconds - REST_S + link.boot_s, plan.seconds + link.boot_s]
    return Made(log, pairs | {
        "aircraft": plan.aircraft, "speed_kt": plan.speed_kt, "place": place, "gain": gain,
        "loop_hz": damper.loop_hz, "servo_lag_s": damper.servo_lag_s, "rest": ends,
    })  # fmt: skip


def place_rows(gains: int, folder: Path, place: int) -> list[Row]:
    """Return a row for each gain of a place."""
    log, truth = kept(folder, f"{place:03d}_0", partial(flown, place, 0.0, 0))
    before = replay(log)
    plan, damper, _ = plan_of(place)
    rows: list[Row] = []
    for number, added in enumerate(ADDED[:gains], 1):
        gain = gain_for(plan, damper, added)
        make = partial(flown, place, gain, number)
        after_log, after = kept(folder, f"{place:03d}_{number}", make)
        conditions = ("aircraft", "speed_kt", "place", "servo_lag_s", "loop_hz")
        row = {name: truth[name] for name in conditions}
        row |= {"gain": gain, "added": added, "closed": after["closed"], "open": truth["open"]}
        found = before.damper(gains=[gain])
        if found.predicted is None:
            rows.append(row | {"refused": found.report.verdict.reasons[0].id})
        else:
            rows.append(row | _compared(found, before, after_log, after))
    return rows


def _compared(found: Study, before: Run, log: Path, truth: dict[str, Any]) -> Row:
    """Return what was predicted for a gain, and what the flight with it shows."""
    closed = found.predicted.closed if found.predicted is not None else None
    assert closed is not None
    row = int(np.argmin(np.abs(closed.gains - truth["gain"])))
    zeta, std = float(closed.zeta[0, row]), float(closed.zeta_std[0, row])
    wn = float(closed.wn_rad_s[0, row])
    result: Row = {"wn": wn, "zeta": zeta, "zeta_std": std, "refused": "", **_advice(found, truth)}
    after = replay(log)
    result["z"] = _apart(before, after)
    result |= _decays(found, after, truth)
    return result


def _advice(found: Study, truth: dict[str, Any]) -> Row:
    """Return the gains advised, with the zeta that the linearisation has with them."""
    advised = found.report.recommended
    if advised is None:
        return {"advised": None}
    plan, damper, _ = plan_of(truth["place"])
    model = linear(plan, damper.servo_lag_s)
    zeta = [_zeta(model.dutch_roll(replace(damper, gain=gain)))
            for gain in (0.0, advised.low, advised.high, advised.next)]  # fmt: skip
    return {"advised": [advised.low, advised.high, advised.next], "advised_zeta": zeta}


def _apart(before: Run, after: Run) -> list[float] | None:
    """Return by how many sigmas wn and zeta of two flights differ, None without both."""
    rolls = [run.flight.dutch_roll for run in (before, after)]
    if any(roll is None or roll.wn_std is None or roll.zeta_std is None for roll in rolls):
        return None
    one, other = rolls
    assert one is not None
    assert other is not None
    pairs = ((one.wn_rad_s, other.wn_rad_s, one.wn_std, other.wn_std),
             (one.zeta, other.zeta, one.zeta_std, other.zeta_std))  # fmt: skip
    return [abs(a - b) / math.hypot(s or 0.0, t or 0.0) for a, b, s, t in pairs]


def _decays(found: Study, after: Run, truth: dict[str, Any]) -> Row:
    """Return the damped sine of the decay after the last movement: in flight, and predicted."""
    predicted, samples = found.predicted, after.samples
    assert predicted is not None
    # The damper's loop is closed on the yaw rate less the wanted turn.
    t, rudder = samples.t, samples.rudder
    r = samples.r - GRAVITY / samples.airspeed * np.sin(samples.roll)
    plan, _, _ = plan_of(truth["place"])
    stick = excitation(plan)
    stick[-round(REST_S / STEP_S) :] = 0.0
    step = predicted.manoeuvre.sample_time_s
    # The pilot's own rudder on the grid, as the damper's part is in the servo's output.
    first = t[0] - truth["rest"][1] + plan.seconds
    edges = first + step * np.arange(len(t) + 1)
    total = np.concatenate([[0.0], np.cumsum(stick) * STEP_S])
    mean = np.diff(np.interp(edges, STEP_S * np.arange(len(total)), total)) / step
    law = predicted.laws[0]
    response = closed_response(predicted.aircraft.central, law, truth["gain"], mean, step)
    # From the last movement of the stick on.
    last = float(STEP_S * np.flatnonzero(stick)[-1]) - first + t[0]
    rows = (
        (t > last + step) & (t < last + 2.5 * math.tau / truth["closed"][0]) & np.isfinite(rudder)
    )
    fits = [damped_sine([x[rows]], step, truth["closed"][0]) for x in (r, response)]
    modes = [None if fit is None else [fit.wn_rad_s, fit.zeta] for fit in fits]
    return {"decay": modes[0], "decay_predicted": modes[1]}


def is_right(zeta: float, true: float) -> bool:
    """Return whether a damping ratio is as near to the truth as it has to be."""
    return abs(zeta - true) <= max(RIGHT, RIGHT_SHARE * abs(true))


def is_within(row: Row) -> bool:
    """Return whether a prediction is within 2 sigma of the truth."""
    return bool(abs(row["zeta"] - row["closed"][1]) <= 2.0 * row["zeta_std"])


def table(rows: list[Row]) -> Iterator[str]:
    """Yield the table of the results by aircraft, and of all."""
    yield from head("", COLUMNS)
    for name in [*dict.fromkeys(row["aircraft"] for row in rows), "all"]:
        some = [row for row in rows if name in (row["aircraft"], "all")]
        yield line(name, *_cells(some))


def _cells(rows: list[Row]) -> list[str]:
    predicted = [row for row in rows if not row["refused"]]
    right = [row for row in predicted if is_right(row["zeta"], row["closed"][1])]
    within = [row for row in predicted if is_within(row)]
    # A predicted pair that became two real poles has no wn; its zeta counts as wrong.
    off = known(np.median, np.array([abs(row["wn"] / row["closed"][0] - 1.0) for row in predicted]))
    decays = [row for row in predicted if row["decay"] and row["decay_predicted"]]
    alike = [row for row in decays if is_right(row["decay_predicted"][1], row["decay"][1])]
    answered = [row for row in predicted if row["z"]]
    same = [row for row in answered if max(row["z"]) <= 2.0]
    median = f"{100.0 * off:.1f} %".replace("nan %", "-")
    shares = (right, predicted), (within, predicted), (alike, decays), (same, answered)
    said = [f"{len(some)} of {len(of)}" for some, of in shares]
    return [str(len(rows)), str(len(rows) - len(predicted)), *said[:2], median, *said[2:]]


def harmful(row: Row) -> bool:
    """Return whether an advice lowers zeta, or leaves it below .15 where it was not."""
    if row["refused"] or row.get("advised") is None:
        return False
    start, *with_it = row["advised_zeta"]
    return any(zeta < start or zeta < min(LEAST_ZETA, start) for zeta in with_it)


def main(arguments: list[str]) -> Generator[str, None, str | None]:
    """Yield the table; return which aims were missed."""
    options = options_of("damper", __doc__, arguments, cases=100, **FLOWN)
    gains = min(options.cases, len(ADDED))
    places = range(-(-options.cases // gains))
    rows = all_rows(options, partial(place_rows, gains), places)[: options.cases]
    yield from table(rows)
    predicted = [row for row in rows if not row["refused"]]
    right = [is_right(row["zeta"], row["closed"][1]) for row in predicted]
    missed = [
        f"{sum(hits)} of {len(hits)} {what}"
        for what, hits in (("right", right), ("within", [is_within(row) for row in predicted]))
        if 100.0 * sum(hits) < NEEDED[what] * len(hits)
    ]
    if bad := [f"{row['aircraft']} {row['gain']:g}" for row in rows if harmful(row)]:
        missed.append(f"harmful advice: {', '.join(bad)}")
    return "; ".join(missed) or None
