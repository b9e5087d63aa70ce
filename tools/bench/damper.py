"""Compares what yawid damper predicts with JSBSim's linearisation with ArduPlane's damper closed.

    python tools/bench.py damper [--cases 100] [--logs DIR]

For each place (aircraft and airspeed) a flight without the damper, in which the aileron is moved
as well, is replayed, and predicts wn and zeta for gains that add .08 to .35 of zeta: on the bare
airframe where that is known, and by the answer as flown. The truth is the linearisation with roll
hold and damper closed, at the airspeed flown: washout, scaling, loop rate, and servos that lag.
zeta is right within the larger of .05 and 15 %. The equations of the damper are written from
ArduPlane's source, not taken from src/yawid/damper, which they check.
"""

from __future__ import annotations

import math
from argparse import Namespace
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import control
import numpy as np
from flights.flight import Flight, Hands
from flights.fly import Made
from flights.linear import GRAVITY
from flights.moved import CONDITIONS, KEPT, UNITS
from flights.plan import KNOT, STEP_S, FlightPlan, Floats, Link, count, excitation
from flights.surgery import join
from flights.telemetry import telemetry
from flights.truth import (
    PHI,
    R,
    after_lead_in,
    dutch_roll,
    mean_plan,
    with_roll_hold,
)
from msgspec.structs import replace as change

from bench.frame import NOT_MET, Row, Truth, all_rows, groups, known, table
from yawid.damper.study import Study
from yawid.tables.replay import replay

SEED = 3201
ADDED = (0.08, 0.15, 0.25, 0.35)
"""What the gains of a place add to zeta."""
LAGS_S, LOOPS_HZ, GYROS = (0.02, 0.05, 0.08), (50, 100, 200), (0.001, 0.003)
RIGHT, RIGHT_SHARE = 0.05, 0.15
LEAST = {"right": 0.85, "within": 0.9}
"""The least shares of all cases."""
REST_S = 10.0
ROLL, ROLL_S, ROLL_EVERY_S = 0.08, 0.4, 4.0
"""The aileron's doublets: their size, the length of a side, and the time from one to the next."""


def held(plan: FlightPlan, lag_s: float) -> tuple[Floats, Floats]:
    """Return A and the rudder's column at a plan's trim, with its roll hold behind a servo's lag.

    The states are those of LATERAL and the aileron.
    """
    (bare, rudder), (without_lag, _) = with_roll_hold(plan)
    aileron = (bare - without_lag)[:, [PHI]] / plan.roll_gain
    hold = np.array([[0.0, plan.roll_gain, plan.roll_rate_gain, 0.0, 1.0]])
    return np.vstack([np.hstack([bare, aileron]), -hold / lag_s]), np.append(rudder, 0.0)


def pole_of(plan: FlightPlan, lag_s: float) -> complex:
    """Return the Dutch roll's pole at a plan's trim, with its roll hold and no damper."""
    mode = dutch_roll(*held(plan, lag_s), R)
    assert mode is not None
    return mode["wn_rad_s"] * complex(-mode["zeta"], math.sqrt(1.0 - mode["zeta"] ** 2))


def plan_of(place: int) -> tuple[FlightPlan, float, Link]:
    """Return the flight of a place with a damper without gain, its servo's lag in s, its link."""
    rng = np.random.default_rng([SEED, place])
    aircraft, altitude_ft, speed_kt = CONDITIONS[place % len(CONDITIONS)]
    plan = FlightPlan(
        aircraft=aircraft, altitude_ft=altitude_ft, heading_deg=float(rng.integers(0, 360)),
        speed_kt=speed_kt * (1.0 if place < len(CONDITIONS) else 1.05),
        amplitude=round(float(rng.uniform(0.12, 0.25)), 3),
    )  # fmt: skip
    lag_s = float(rng.choice(LAGS_S))
    period_s = math.tau / abs(pole_of(plan, lag_s))
    scaling = round(speed_kt * KNOT * float(rng.uniform(0.8, 1.2)), 1)
    parameters = {
        "YAW2SRV_DAMP": 0.0, "YAW2SRV_RLL": 1.0, "YAW2SRV_INT": 0.0, "YAW2SRV_SLIP": 0.0,
        "YAW_RATE_ENABLE": 0.0, "SCALING_SPEED": scaling, "AIRSPEED_MIN": 0.6 * scaling,
        "AIRSPEED_MAX": 2.0 * scaling, "SCHED_LOOP_RATE": float(rng.choice(LOOPS_HZ)),
    }  # fmt: skip
    plan = replace(
        plan, step_s=round(0.3 * period_s, 3), parameters=tuple(parameters.items()),
        seconds=float(min(max(round(15.0 + 18.0 * period_s), 60), 100)),
    )  # fmt: skip
    gyro, seed = float(rng.choice(GYROS)), int(rng.integers(1, 2**31))
    return plan, lag_s, Link(25, 25, rate_noise=gyro, seed=seed)


class LaggingFlight(Flight):
    """A flight whose servos follow their commands with a lag."""

    def __init__(self, plan: FlightPlan, hands: Hands, link: Link, lag_s: float) -> None:
        super().__init__(plan, hands, link)
        self._share = -math.expm1(-STEP_S / lag_s)
        trims = plan.rudder.unit(self.rudder_us), plan.aileron.unit(self.aileron_us)
        self._servos = np.array(trims)

    def _moved(self, *commands: float) -> Sequence[float]:
        self._servos += (commands - self._servos) * self._share
        return tuple(self._servos)


def rolls(seconds: float) -> Floats:
    """Return the aileron (n,) of a doublet after each ROLL_EVERY_S, to both sides in turn."""
    side = np.repeat([ROLL, -ROLL], round(ROLL_S / STEP_S))
    rest = np.zeros(round(ROLL_EVERY_S / STEP_S) - len(side))
    return np.resize(np.concatenate([rest, side, rest, -side]), count(seconds))


def flown(place: int) -> Made:
    """Fly a place; the truth has the mean airspeed and altitude flown."""
    plan, lag_s, link = plan_of(place)
    rudder, aileron = excitation(plan), rolls(plan.seconds)
    rudder[-round(REST_S / STEP_S) :] = aileron[-round(REST_S / STEP_S) :] = 0.0
    flight = LaggingFlight(plan, Hands(rudder, aileron), link, lag_s)
    log = join(telemetry(link, flight))
    mean = mean_plan(plan, after_lead_in(flight.flown))
    return Made(log, {"place": place, "speed_kt": mean.speed_kt, "altitude_ft": mean.altitude_ft})


def closed(plan: FlightPlan, lag_s: float, gain: float) -> tuple[float, float]:
    """Return wn and zeta of the Dutch roll with the damper, followed from a gain of 0.

    The scaling by the airspeed is far from the limits that AIRSPEED_MIN and AIRSPEED_MAX set it.
    """
    A, rudder = held(plan, lag_s)
    own, speed, pole = dict(plan.parameters), plan.speed_kt * KNOT, pole_of(plan, lag_s)
    seen = np.zeros(len(A))
    seen[[R, PHI]] = 1.0, -GRAVITY / speed
    loop = (
        control.ss(A, -rudder[:, None], seen[None], 0.0)
        * control.tf([1.0], [lag_s, 1.0])
        * control.tf([1.0, 0.0], [1.0, -math.log(KEPT) * own["SCHED_LOOP_RATE"]])
        * control.tf(*control.pade(0.5 / own["SCHED_LOOP_RATE"], 2))
    )
    top = UNITS * gain * (own["SCALING_SPEED"] / speed) ** 2
    for k in np.linspace(0.0, top, 41):
        poles = np.linalg.eigvals(loop.A - k * loop.B @ loop.C)
        pole = complex(poles[np.argmin(np.abs(poles - pole))])
    return abs(pole), -pole.real / abs(pole)


def gain_for(plan: FlightPlan, lag_s: float, added: float) -> float:
    """Return the gain that adds about ``added`` to zeta in the linearisation at trim."""
    top, start = 0.05, closed(plan, lag_s, 0.0)[1]
    while top < 20.0 and closed(plan, lag_s, top)[1] - start < added:
        top *= 1.3
    return round(top, 3)


def gains(log: Path, truth: Truth) -> list[Row]:
    """Return rows for each gain of a place, and whether its zeta is right and its sigma holds.

    The first rows are the advice, the others that on the answer as flown.
    """
    plan, lag_s, _ = plan_of(truth.pop("place"))
    asked = [gain_for(plan, lag_s, added) for added in ADDED]
    true = np.transpose([closed(replace(plan, **truth), lag_s, gain) for gain in asked])
    run = replay(log, lateral="auto")
    rows = {"now": judged(run.damper(gains=asked), asked, true)}
    run.summary = change(run.summary, bare=None)
    rows["as flown"] = judged(run.damper(gains=asked), asked, true)
    on = {"aircraft": plan.aircraft, "airframe": rows["now"][0].get("of") == "airframe"}
    return [on | {"advice": name} | row for name, its in rows.items() for row in its]


def judged(study: Study, asked: Sequence[float], true: Floats) -> list[Row]:
    """Return a row for each gain, of whose closed loop ``true`` (2, n) are wn and zeta."""
    if study.predicted is None:
        return [{}] * len(asked)
    found, (wn, zeta) = study.predicted.closed, true
    at = [int(np.argmin(np.abs(found.gains - gain))) for gain in asked]
    off = np.abs(found.zeta[0, at] - zeta)
    columns = {
        "zeta_true": zeta, "wn_off_pct": 100.0 * np.abs(found.wn_rad_s[0, at] / wn - 1.0),
        "zeta_off": off, "right": off <= np.maximum(RIGHT, RIGHT_SHARE * np.abs(zeta)),
        "within": off <= 2.0 * found.zeta_std[0, at],
    }  # fmt: skip
    return [{"of": study.report.aircraft} | {name: of[i] for name, of in columns.items()}
            for i in range(len(asked))]  # fmt: skip


def shown(rows: Sequence[Row]) -> dict[str, object]:
    """Return the cells of some cases by column."""
    some = [row for row in rows if "right" in row]
    right, within = (f"{sum(row[of] for row in some)} of {len(some)}" for of in LEAST)
    # A predicted pair that became two real poles has no wn; its zeta counts as wrong.
    off = known(np.median, np.array([row["wn_off_pct"] for row in some]))
    zeta = known(np.median, np.array([row["zeta_off"] for row in some]))
    return {
        "cases": len(rows), "refused": len(rows) - len(some), "zeta right": right,
        "within 2 sigma": within, "wn off, median": f"{off:.1f} %",
        "zeta off, median": f"{zeta:.3f}",
    }  # fmt: skip


def damper(options: Namespace) -> list[Iterable[str]]:
    """Compare what a flight without the damper predicts for gains of it with the closed loop."""
    every = all_rows(options, gains, {
        f"damper_{i:03d}": partial(flown, i) for i in range(options.cases // len(ADDED))
    })  # fmt: skip
    rows, before = ([row for row in every if row["advice"] == of] for of in ("now", "as flown"))
    found = groups(rows, [("{}", "aircraft", ())]) | {"all": rows, "all, as flown": before}
    for name, some in {"on the airframe": rows, "these, as flown": before}.items():
        found[name] = [row for row in some if row["airframe"]]
    some = [row for row in rows if "right" in row]
    counts = {name: sum(row[name] for row in some) for name in LEAST}
    return [
        table("", {name: shown(its) for name, its in found.items()}),
        (f"{NOT_MET}{count} of {len(some)} {name}"
         for name, count in counts.items() if count < LEAST[name] * len(some)),
    ]  # fmt: skip
